"""Spring-Gaus, real captures: ``dynamic/cameras_calib.json``, sequences of images, and the lens of a static COLMAP."""

from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.recordings.conventions import intrinsic_matrix, pose_from_opencv, rotation_from_vector
from pacnerf_lpo.data.recordings.files import entry, numbers, read_values
from pacnerf_lpo.data.recordings.readers.colmap import open_model
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.errors import UserInputError

FRAME_RATE = 120.0
"""Of all captures [1/s]."""


def read(folder: Path) -> Recording:
    """OpenCV's world-to-camera poses; gravity is along +z, the unit is not stated (about 0.75 m).

    Focal lengths are those of the static COLMAP model, scaled to the size of the video, with a centred principal point.
    """
    sequence = _only_sequence(folder)
    model = open_model(folder / "static" / "colmap" / sequence.parent.name)
    static = min(model.cameras.values(), key=lambda camera: camera.camera_id)
    focal = np.array([static.focal_length_x / static.width, static.focal_length_y / static.height])
    calibration = read_values(folder / "dynamic" / "cameras_calib.json")
    listed = {name: files for name, files in read_values(sequence).items() if isinstance(files, list)}
    cameras = tuple(_camera(folder / "dynamic", name, calibration, files, focal) for name, files in listed.items())
    return Recording(LAYOUT.name, folder, cameras, up=(0.0, 0.0, -1.0))


def _camera(folder: Path, name: str, calibration: Any, files: list[str], focal: np.ndarray) -> Camera:
    where = f"{folder / 'cameras_calib.json'}, camera {name}"
    pose = entry(str(folder / "cameras_calib.json"), calibration, name)
    rotation = rotation_from_vector(numbers(f"{where}, rvecs", entry(where, pose, "rvecs"), (3,)))
    translation = numbers(f"{where}, tvecs", entry(where, pose, "tvecs"), (3,))
    images = [folder / "videos_images" / name / file for file in files]
    masks = [folder / "videos_masks" / name / f"{Path(file).stem}.png" for file in files]
    height, width = image_size(images[0])
    intrinsic = intrinsic_matrix(focal[0] * width, focal[1] * height, width / 2, height / 2)
    frames = tuple(
        Frame(image, number / FRAME_RATE, mask=mask if mask.is_file() else None)
        for number, (image, mask) in enumerate(zip(images, masks, strict=True))
    )
    return Camera(name, intrinsic, pose_from_opencv(rotation, translation), frames)


def _only_sequence(folder: Path) -> Path:
    found = sorted(folder.glob("dynamic/sequences/*/*.json"))
    if len(found) != 1:
        names = ", ".join(f"{path.parent.name}/{path.name}" for path in found) or "none"
        raise UserInputError(
            f"{folder}/dynamic/sequences: one sequence is needed, but there are: {names}; copy the folder and leave one"
        )
    return found[0]


NAME = "dynamic/cameras_calib.json"
LAYOUT = Layout("spring-gaus-real", NAME, has(NAME), read)
