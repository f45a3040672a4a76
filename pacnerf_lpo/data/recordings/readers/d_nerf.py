"""D-NeRF: ``transforms_<split>.json`` with one field of view, and a pose and a time per image."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.index import NAME as PAC_NERF
from pacnerf_lpo.data.recordings.conventions import centred_intrinsic
from pacnerf_lpo.data.recordings.files import entry, number_at, numbers, read_values
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.readers.poses import still_cameras, with_suffix
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording

SPLITS = ("train", "val", "test")


def read(folder: Path) -> Recording:
    """OpenGL cameras of all splits. Its times go from 0 to 1 whatever the length, so they are the order alone."""
    shots = []
    for path in (folder / f"transforms_{split}.json" for split in SPLITS):
        if path.is_file():
            values = read_values(path)
            angle = number_at(str(path), values, "camera_angle_x")
            frames = entry(str(path), values, "frames")
            shots += [_shot(path, number, frame, angle) for number, frame in enumerate(frames)]
    found = still_cameras(folder, shots)
    cameras = (replace(one, frames=tuple(replace(frame, time=None) for frame in one.frames)) for one in found)
    return Recording(LAYOUT.name, folder, tuple(cameras))


def _shot(path: Path, number: int, values: dict[str, Any], angle: float) -> Camera:
    where = f"{path}, frame {number}"
    file = with_suffix(path.parent / str(entry(where, values, "file_path")))
    pose = numbers(f"{where}, transform_matrix", entry(where, values, "transform_matrix"), (4, 4))[:3]
    height, width = image_size(file)
    frame = Frame(file, number_at(where, values, "time"))
    return Camera(file.parent.name, centred_intrinsic(angle, width, height), pose, (frame,), size=(width, height))


LAYOUT = Layout("d-nerf", "transforms_train.json", has("transforms_train.json", without=PAC_NERF), read)
