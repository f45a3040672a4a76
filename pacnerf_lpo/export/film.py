"""Films of the modelled motion, alone and next to what was measured."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from pacnerf_lpo.evaluation.prediction import Prediction, predict, to_bytes
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.export.files import whole_file
from pacnerf_lpo.export.motion import Subject
from pacnerf_lpo.report.residual_colours import residual_colours, residual_scale, signed_residual

SLOW_MOTION = 4
LEAST_HEIGHT = 320
CAPTION = 26


def export_video(run: Run, stage: Stage, view_id: int) -> Path:
    """Write ``videos/view_<id>.mp4``: measured | model | signed residual, four times slower than life. Raises
    UserInputError where the run has no such view.
    """
    view = run.view_index(view_id)
    path = run.run_dir / "videos" / f"view_{view_id}.mp4"
    frames = comparison_frames(run, predict(run, stage), view)
    write_film(path, frames, run.physics.frame_rate / SLOW_MOTION)
    return path


def comparison_frames(run: Run, prediction: Prediction, view: int) -> Iterable[np.ndarray]:
    """Captioned triples of one view, [0..255, (H', W', 3)] per frame."""
    video = run.data.video
    images = torch.from_numpy(np.array(prediction.images[view], dtype=np.float32) / 255)
    measured = video.images[view, : len(images)]
    residuals = signed_residual(images, measured) * video.valid[view]
    scale = residual_scale(residuals)
    for frame, (image, truth, residual) in enumerate(zip(images, measured, residuals, strict=True)):
        parts = [to_bytes(part) for part in (truth, image, residual_colours(residual, scale))]
        when = f"view {video.view_ids[view]}, frame {video.frame_ids[frame]}, {video.times[frame]:.3f} s"
        yield captioned(parts, (f"measured: {when}", "model", f"model - measured, full colour at {scale:g}"))


def captioned(parts: list[np.ndarray], captions: Iterable[str]) -> np.ndarray:
    """Pictures side by side, enlarged to at least 320 pixels of height, each with a caption below."""
    factor = max(1, -(-LEAST_HEIGHT // parts[0].shape[0]))
    height, width = parts[0].shape[0] * factor, parts[0].shape[1] * factor
    even = (width * len(parts) + 1) // 2 * 2, (height + CAPTION + 1) // 2 * 2
    sheet = Image.new("RGB", even, "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=13)
    for index, (part, caption) in enumerate(zip(parts, captions, strict=True)):
        picture = Image.fromarray(np.ascontiguousarray(part)).resize((width, height), Image.Resampling.NEAREST)
        sheet.paste(picture, (index * width, 0))
        pen.text((index * width + 8, height + 5), caption, fill=(70, 75, 82), font=font)
    return np.asarray(sheet)


def write_mp4(subject: Subject, path: Path) -> None:
    """Write the modelled motion alone as one camera of the recording sees it, four times slower than life."""
    pictures = predict(subject.run, subject.stage).images[subject.view]
    height, width = pictures.shape[1:3]
    factor = max(1, -(-LEAST_HEIGHT // height))
    size = width * factor // 2 * 2, height * factor // 2 * 2
    enlarged = (np.asarray(Image.fromarray(p).resize(size, Image.Resampling.BICUBIC)) for p in pictures)
    write_film(path, enlarged, subject.run.physics.frame_rate / SLOW_MOTION)


def write_film(path: Path, frames: Iterable[np.ndarray], frame_rate: float) -> None:
    """Write an H.264 film that browsers play.

    Args:
        frames: [0..255, (H, W, 3), uint8], even height and width.
        frame_rate: [1/s]
    """
    options: Any = {"codec": "libx264", "quality": 8, "macro_block_size": 2, "ffmpeg_log_level": "error"}
    with whole_file(path) as part:
        writer: Any = imageio.get_writer(part, "FFMPEG", fps=frame_rate, **options)
        with writer:
            for frame in frames:
                writer.append_data(np.ascontiguousarray(frame))
