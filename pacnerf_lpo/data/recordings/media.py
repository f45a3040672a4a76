"""Image folders and video files: what frames they hold, when they were taken, and their pixels."""

import re
from collections.abc import Iterator, Sequence
from importlib import import_module
from itertools import count
from pathlib import Path
from types import ModuleType

import numpy as np

from pacnerf_lpo.data.images import read_png
from pacnerf_lpo.data.recordings.recording import Frame
from pacnerf_lpo.errors import UserInputError

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm")
LOST = 0.1
"""Part of the announced frames of a video that may be missing: containers count a few too many."""


def library(name: str, what_for: str, extra: str = "recordings") -> ModuleType:
    """An optional library. Raises UserInputError that says how to install it."""
    try:
        return import_module(name)
    except ImportError:
        raise UserInputError(f"{what_for} needs {name}; pip install 'pacnerf-lpo[{extra}]'") from None


def in_order(paths: list[Path]) -> list[Path]:
    """Sorted by name, numbers by their value: 2 before 10."""
    return sorted(paths, key=lambda path: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", path.name)])


def images_in(folder: Path, endings: Sequence[str] = IMAGES) -> list[Path]:
    """Files of a folder with these endings, in order; none where there is no such folder."""
    inside = folder.iterdir() if folder.is_dir() else ()
    return in_order([path for path in inside if path.suffix.lower() in endings])


def videos_in(folder: Path) -> list[Path]:
    """Video files of a folder, in order; none where there is no such folder."""
    return images_in(folder, VIDEOS)


def frames_of(path: Path) -> tuple[Frame, ...]:
    """The frames of a video with its times, or of a folder of images; UserInputError where it is damaged or cut off."""
    if path.is_dir():
        return tuple(Frame(image, None) for image in images_in(path))
    cv2 = library("cv2", f"{path}: reading a video")
    video = cv2.VideoCapture(str(path))
    announced, times = video.get(cv2.CAP_PROP_FRAME_COUNT), []
    while video.isOpened() and video.grab():
        times.append(video.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
    video.release()
    if not times:
        raise UserInputError(f"{path}: the video is damaged or of an unknown kind; copy it again or convert it to mp4")
    if len(times) < (1.0 - LOST) * announced:
        raise UserInputError(
            f"{path}: the video announces {announced:.0f} frames but only {len(times)} can be read; copy it again"
        )
    if len(times) > 1 and not np.all(np.diff(times) > 0):
        raise UserInputError(f"{path}: its time stamps do not increase; give --fps, or convert the video")
    return tuple(Frame(path, time, place) for place, time in enumerate(times))


def read_frames(frames: tuple[Frame, ...]) -> Iterator[np.ndarray]:
    """Pixels of every frame [0..1, (H, W, 3), or (H, W, 4) with transparency], in the order given. Raises
    UserInputError where a file is missing or damaged.
    """
    playing: Iterator[tuple[int, np.ndarray]] = iter(())
    now = Path(), 0
    for frame in frames:
        if frame.place is None:
            yield read_png(frame.file)
            continue
        if now[0] != frame.file or now[1] >= frame.place:
            playing = _play(frame.file)
        now = frame.file, frame.place
        pixels = next((pixels for place, pixels in playing if place == frame.place), None)
        if pixels is None:
            raise UserInputError(f"{frame.file}: frame {frame.place} cannot be read; copy the video again")
        yield pixels


def _play(path: Path) -> Iterator[tuple[int, np.ndarray]]:
    video = library("cv2", f"{path}: reading a video").VideoCapture(str(path))
    for place in count():
        found, pixels = video.read()
        if not found:
            break
        yield place, pixels[..., ::-1].astype(np.float32) / 255.0
    video.release()
