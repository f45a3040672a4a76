"""nerfstudio and instant-ngp: ``transforms.json`` with intrinsics for all frames or for each. D-NeRF:
``transforms_<split>.json`` with one field of view, and a pose and a time per image.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.index import NAME as PAC_NERF
from pacnerf_lpo.data.recordings.conventions import centred_intrinsic, intrinsic_matrix
from pacnerf_lpo.data.recordings.files import entry, number_at, numbers, read_values
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.readers.poses import still_cameras, with_suffix
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Lens, Recording
from pacnerf_lpo.errors import UserInputError

NAME = "transforms.json"
OPENCV_KEYS = ("k1", "k2", "p1", "p2", "k3")
FISHEYE_KEYS = ("k1", "k2", "k3", "k4")
SPLITS = ("train", "val", "test")
PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "")


def read(folder: Path) -> Recording:
    """OpenGL cameras in a world with z up, of any scale. Its masks mark pixels to ignore, so they are no mattes."""
    path = folder / NAME
    values = read_values(path)
    frames = entry(str(path), values, "frames")
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise UserInputError(f"{path}: 'frames' must be a list of {{file_path, transform_matrix}}; write it again")
    shots = [shot_of(path, number, {**values, **frame}) for number, frame in enumerate(frames)]
    return Recording(LAYOUT.name, folder, still_cameras(path, shots), up=(0.0, 0.0, 1.0))


def read_d_nerf(folder: Path) -> Recording:
    """OpenGL cameras of all splits. Its times go from 0 to 1 whatever the length, so they are the order alone."""
    shots = []
    for path in (folder / f"transforms_{split}.json" for split in SPLITS):
        if path.is_file():
            values = read_values(path)
            number_at(str(path), values, "camera_angle_x")
            for number, frame in enumerate(entry(str(path), values, "frames")):
                number_at(f"{path}, frame {number}", frame, "time")
                shots.append(shot_of(path, number, {**values, **frame}))
    found = still_cameras(folder, shots)
    cameras = (replace(one, frames=tuple(replace(frame, time=None) for frame in one.frames)) for one in found)
    return Recording(D_NERF.name, folder, tuple(cameras))


def shot_of(path: Path, number: int, values: dict[str, Any]) -> Camera:
    """A camera with one frame, from the values of that and of the whole file."""
    where = f"{path}, frame {number}"
    file = with_suffix(path.parent / str(entry(where, values, "file_path")))
    pose = numbers(f"{where}, transform_matrix", entry(where, values, "transform_matrix"), (4, 4), (3, 4))[:3]
    frame = Frame(file, None if values.get("time") is None else number_at(where, values, "time"))
    if "w" in values and "h" in values:
        size = round(number_at(where, values, "w")), round(number_at(where, values, "h"))
    else:
        size = image_size(file)[::-1]
    return Camera(file.parent.name, _intrinsic(where, values, size), pose, (frame,), _lens(where, values), size=size)


def _intrinsic(where: str, values: dict[str, Any], size: tuple[int, int]) -> np.ndarray:
    width, height = size
    if "fl_x" not in values and "camera_angle_x" in values:
        return centred_intrinsic(number_at(where, values, "camera_angle_x"), width, height)
    fx = number_at(where, values, "fl_x")
    centre = number_at(where, values, "cx", width / 2), number_at(where, values, "cy", height / 2)
    return intrinsic_matrix(fx, number_at(where, values, "fl_y", fx), *centre)


def _lens(where: str, values: dict[str, Any]) -> Lens:
    model = str(values.get("camera_model", ""))
    if model == "OPENCV_FISHEYE" or values.get("is_fisheye"):
        return Lens("fisheye", tuple(number_at(where, values, key, 0.0) for key in FISHEYE_KEYS))
    if model not in PINHOLES or number_at(where, values, "k4", 0.0):
        raise UserInputError(f"{where}: lens model {model or 'with k4'} is not supported; undistort its images first")
    return Lens("opencv", tuple(number_at(where, values, key, 0.0) for key in OPENCV_KEYS))


LAYOUT = Layout("nerfstudio", NAME, has(NAME), read)
D_NERF = Layout("d-nerf", "transforms_train.json", has("transforms_train.json", without=PAC_NERF), read_d_nerf)
