"""DyNeRF: ``poses_bounds.npy`` with a row per camera, and ``cam*.mp4``."""

from pathlib import Path

import numpy as np

from pacnerf_lpo.data.recordings.conventions import intrinsic_matrix, pose_from_llff
from pacnerf_lpo.data.recordings.files import numbers
from pacnerf_lpo.data.recordings.media import frames_of, videos_in
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Recording
from pacnerf_lpo.errors import UserInputError

NAME = "poses_bounds.npy"


def read(folder: Path) -> Recording:
    """LLFF's rows of 17: pose (3, 4) with height, width and focal length [pixels] as fifth column, near and far."""
    path = folder / NAME
    try:
        rows = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise UserInputError(f"{path}: no array of numbers ({error}); write it again") from None
    videos = [video for video in videos_in(folder) if video.stem.startswith("cam")]
    if rows.ndim != 2 or rows.shape[1] != 17 or len(rows) != len(videos):
        raise UserInputError(
            f"{path}: shape {rows.shape}, but there are {len(videos)} videos cam*.mp4; expected one row of 17 for each"
        )
    cameras = []
    for row, video in zip(rows[:, :15].reshape(-1, 3, 5), videos, strict=True):
        height, width, focal = numbers(f"{path}, camera {video.stem}", row, (3, 5))[:, 4]
        intrinsic = intrinsic_matrix(focal, focal, width / 2, height / 2)
        size = (round(width), round(height))
        cameras.append(Camera(video.stem, intrinsic, pose_from_llff(row[:, :4]), frames_of(video), size=size))
    return Recording(LAYOUT.name, folder, tuple(cameras))


LAYOUT = Layout("dynerf", NAME, has(NAME), read)
