"""Spring-Gaus. Synthetic: ``camera.json`` [{camera, K, c2w}] next to one folder of transparent images per camera. Real
captures: ``dynamic/cameras_calib.json``, sequences of images, and the lens of a static COLMAP.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.data.recordings.conventions import intrinsic_matrix, pose_from_opencv, rotation_from_vector
from pacnerf_lpo.data.recordings.files import entry, numbers, read_values
from pacnerf_lpo.data.recordings.media import images_in
from pacnerf_lpo.data.recordings.readers.colmap import open_model
from pacnerf_lpo.data.recordings.readers.layout import Layout, has
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.errors import UserInputError

SYNTHETIC_NAME, REAL_NAME = "camera.json", "dynamic/cameras_calib.json"
FRAME_RATE = 120.0
"""Of all real captures [1/s]."""


def read_synthetic(folder: Path) -> Recording:
    """OpenGL cameras, y up; the layout has no times and no unit."""
    path = _only(_object_folders(folder), folder, "object", "give the folder of one") / SYNTHETIC_NAME
    cameras = []
    for number, values in enumerate(read_values(path)):
        where = f"{path}, camera {number}"
        name = str(entry(where, values, "camera"))
        intrinsic = numbers(f"{where}, K", entry(where, values, "K"), (3, 3))
        pose = numbers(f"{where}, c2w", entry(where, values, "c2w"), (4, 4), (3, 4))[:3]
        frames = tuple(Frame(image, None) for image in images_in(path.parent / name))
        cameras.append(Camera(name, intrinsic, pose, frames))
    return Recording(SYNTHETIC.name, folder, tuple(cameras), up=(0.0, 1.0, 0.0))


def _object_folders(folder: Path) -> list[Path]:
    if (folder / SYNTHETIC_NAME).is_file():
        return [folder]
    return sorted(path.parent for path in folder.glob(f"render/*/{SYNTHETIC_NAME}"))


def read_real(folder: Path) -> Recording:
    """OpenCV's world-to-camera poses; gravity is along +z, the unit is not stated (about 0.75 m).

    Focal lengths are those of the static COLMAP model, scaled to the size of the video, with a centred principal point.
    """
    sequences = folder / "dynamic" / "sequences"
    sequence = _only(sorted(sequences.glob("*/*.json")), sequences, "sequence", "copy the folder and leave one")
    model = open_model(folder / "static" / "colmap" / sequence.parent.name)
    static = min(model.cameras.values(), key=lambda camera: camera.camera_id)
    focal = np.array([static.focal_length_x / static.width, static.focal_length_y / static.height])
    calibration = read_values(folder / REAL_NAME)
    listed = {name: files for name, files in read_values(sequence).items() if isinstance(files, list)}
    cameras = tuple(_real_camera(folder, name, calibration, files, focal) for name, files in listed.items())
    return Recording(REAL.name, folder, cameras, up=(0.0, 0.0, -1.0))


def _real_camera(folder: Path, name: str, calibration: Any, files: list[str], focal: np.ndarray) -> Camera:
    where = f"{folder / REAL_NAME}, camera {name}"
    pose = entry(str(folder / REAL_NAME), calibration, name)
    rotation = rotation_from_vector(numbers(f"{where}, rvecs", entry(where, pose, "rvecs"), (3,)))
    translation = numbers(f"{where}, tvecs", entry(where, pose, "tvecs"), (3,))
    images = [folder / "dynamic" / "videos_images" / name / file for file in files]
    masks = [folder / "dynamic" / "videos_masks" / name / f"{Path(file).stem}.png" for file in files]
    height, width = image_size(images[0])
    intrinsic = intrinsic_matrix(focal[0] * width, focal[1] * height, width / 2, height / 2)
    frames = tuple(
        Frame(image, number / FRAME_RATE, mask=mask if mask.is_file() else None)
        for number, (image, mask) in enumerate(zip(images, masks, strict=True))
    )
    return Camera(name, intrinsic, pose_from_opencv(rotation, translation), frames)


def _only(found: list[Path], below: Path, what: str, remedy: str) -> Path:
    if len(found) != 1:
        names = ", ".join(str(path.relative_to(below)) for path in found) or "none"
        raise UserInputError(f"{below}: one {what} is needed, but there are: {names}; {remedy}")
    return found[0]


SYNTHETIC = Layout(
    "spring-gaus-synthetic",
    f"{SYNTHETIC_NAME}, here or in render/<object>",
    lambda folder: bool(_object_folders(folder)),
    read_synthetic,
)
REAL = Layout("spring-gaus-real", REAL_NAME, has(REAL_NAME), read_real)
