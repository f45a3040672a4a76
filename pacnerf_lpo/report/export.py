"""Particles as PLY files, one per frame, and films that set measured and modelled views side by side."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import imageio_ffmpeg
import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont
from plyfile import PlyData, PlyElement

from pacnerf_lpo.evaluation.prediction import Prediction, StateRenderer, predict, to_bytes
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.report.residual_colours import residual_colours, residual_scale, signed_residual

SLOW_MOTION = 4
LEAST_HEIGHT = 320
CAPTION = 26
VERTEX = [
    *((name, "f4") for name in ("x", "y", "z", "vx", "vy", "vz")),
    *((name, "u1") for name in ("red", "green", "blue")),
    ("density", "f4"),
]


def export_particles(run: Run, stage: Stage) -> Path:
    """Write ``particles/<stem>/frame_000.ply`` and so on; returns the folder.

    A vertex holds its position x, y, z [m], velocity vx, vy, vz [m/s], colour and raw volume density.
    """
    positions = np.asarray(predict(run, stage).positions)
    colours = to_bytes(StateRenderer(stage.state).particle_colours())
    velocities = frame_velocities(
        positions, stage.state.velocity.numpy(), run.data.video.times.numpy()[: len(positions)]
    )
    folder = run.run_dir / "particles" / stage.stem
    folder.mkdir(parents=True, exist_ok=True)
    vertices = np.empty(positions.shape[1], dtype=VERTEX)
    vertices["density"] = stage.state.density.numpy()
    for column, name in enumerate(("red", "green", "blue")):
        vertices[name] = colours[:, column]
    for frame, (points, moving) in enumerate(zip(positions, velocities, strict=True)):
        for column, name in enumerate("xyz"):
            vertices[name], vertices[f"v{name}"] = points[:, column], moving[:, column]
        PlyData([PlyElement.describe(vertices, "vertex")]).write(folder / f"frame_{frame:03d}.ply")
    return folder


def frame_velocities(positions: np.ndarray, initial: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Velocity at every frame [m/s, (F, N, 3)]: the known one at frame 0, second-order differences in time after it.

    Args:
        positions: [m, (F, N, 3)]
        initial: at frame 0 [m/s, (N, 3)]
        times: [s, (F,)]
    """
    if len(positions) < 2:
        return np.broadcast_to(initial, positions.shape)
    order: Literal[1, 2] = 2 if len(positions) > 2 else 1
    velocities = np.gradient(positions, times, axis=0, edge_order=order)
    velocities[0] = initial
    return velocities


def export_video(run: Run, stage: Stage, view_id: int) -> Path:
    """Write ``videos/view_<id>.mp4``: measured | model | signed residual, four times slower than life.

    Raises:
        UserInputError: the run has no such view.
    """
    view = run.view_index(view_id)
    path = run.run_dir / "videos" / f"view_{view_id}.mp4"
    path.parent.mkdir(parents=True, exist_ok=True)
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


def write_film(path: Path, frames: Iterable[np.ndarray], frame_rate: float) -> None:
    """Write an H.264 film that browsers play.

    Args:
        frames: [0..255, (H, W, 3), uint8], even height and width.
        frame_rate: [1/s]
    """
    writer = None
    try:
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = imageio_ffmpeg.write_frames(
                    str(path),
                    size,
                    fps=frame_rate,
                    codec="libx264",
                    quality=8,
                    macro_block_size=2,
                    ffmpeg_log_level="error",
                )
                writer.send(None)
            writer.send(np.ascontiguousarray(frame))
    finally:
        if writer is not None:
            writer.close()
