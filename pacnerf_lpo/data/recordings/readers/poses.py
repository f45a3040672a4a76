"""Lists of images with a pose each, gathered into cameras that stand still."""

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.recordings.media import IMAGES, in_order
from pacnerf_lpo.data.recordings.recording import Camera, Frame
from pacnerf_lpo.errors import UserInputError

SAME_POSE = 6
"""Digits to which the poses of one camera agree."""


def still_cameras(source: Path, shots: Iterable[Camera]) -> tuple[Camera, ...]:
    """Shots (each a camera with one frame) of one pose are the frames of one camera, in the order of time where it is
    known, else of file names.

    Cameras are named after what the files of each have in common and others have not: their folder, or the beginning of
    their names; and numbered where that is the same for several. Raises UserInputError where the camera moves, so that
    every pose has one image.
    """
    groups: dict[bytes, list[Camera]] = {}
    for shot in shots:
        key = np.concatenate((shot.pose.ravel(), shot.intrinsic.ravel())).round(SAME_POSE) + 0.0
        groups.setdefault(key.tobytes(), []).append(shot)
    if groups and all(len(group) == 1 for group in groups.values()):
        raise UserInputError(
            f"{source}: every one of its {len(groups)} poses has one image, so the camera moves; several cameras that "
            "stand still are needed, with all frames of each"
        )
    names = [_name(group) for group in groups.values()]
    if len(set(names)) < len(names):
        names = [str(number) for number in range(len(names))]
    return tuple(_joined(name, group) for name, group in zip(names, groups.values(), strict=True))


def _name(group: list[Camera]) -> str:
    files = [shot.frames[0].file for shot in group]
    shared = os.path.commonprefix([file.stem for file in files]).rstrip("_-. ")  # noqa: RUF071  (letters count)
    return shared if shared and len(files) > 1 and shared not in ("r", "frame", "image") else files[0].parent.name


def _joined(name: str, group: list[Camera]) -> Camera:
    frames = {shot.frames[0].file: shot.frames[0] for shot in group}
    ordered: list[Frame] = [frames[file] for file in in_order(list(frames))]
    if all(frame.time is not None for frame in ordered):
        ordered.sort(key=lambda frame: frame.time or 0.0)
    return replace(group[0], name=name, frames=tuple(ordered))


def with_suffix(path: Path) -> Path:
    """The image of this name, whose extension the file may leave out."""
    if path.suffix.lower() in IMAGES:
        return path
    possible = [path.with_name(path.name + suffix) for suffix in IMAGES]
    return next((image for image in possible if image.is_file()), possible[0])
