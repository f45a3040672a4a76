"""COLMAP: a sparse model, binary or text, next to images in one folder per camera, or one video per camera."""

import shutil
import struct
import tempfile
from pathlib import Path, PurePosixPath
from typing import Any

from pacnerf_lpo.data.recordings.conventions import intrinsic_matrix, pose_from_opencv
from pacnerf_lpo.data.recordings.media import frames_of, images_in, library, videos_in
from pacnerf_lpo.data.recordings.readers.layout import Layout
from pacnerf_lpo.data.recordings.readers.poses import still_cameras
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Lens, Recording
from pacnerf_lpo.errors import UserInputError

MODELS = ("sparse/0", "sparse", ".")
DISTORTION = {"SIMPLE_PINHOLE": 0, "PINHOLE": 0, "SIMPLE_RADIAL": 1, "RADIAL": 2, "OPENCV": 4, "OPENCV_FISHEYE": 4}
"""How many parameters of a lens model, the last ones, are distortion; OpenCV has the same two radial ones first."""


def read(folder: Path) -> Recording:
    """OpenCV's world-to-camera poses; neither scale nor axes mean anything.

    An image of the model stands for all images in its folder, or for the frames of the video of its name: cameras stand
    still, so one registered image of each is enough.
    """
    model = open_model(next(folder / place for place in MODELS if _is_model(folder / place)))
    shots = [_shot(folder, model, image) for image in sorted(model.images.values(), key=lambda image: image.name)]
    cameras = tuple(shots) if all(len(shot.frames) > 1 for shot in shots) else still_cameras(folder, shots)
    return Recording(LAYOUT.name, folder, cameras)


def open_model(folder: Path) -> Any:
    """pycolmap's reconstruction in a folder, perhaps without points; UserInputError where it is missing or damaged."""
    pycolmap = library("pycolmap", f"{folder}: reading a COLMAP model")
    if not _is_model(folder):
        raise UserInputError(f"{folder}: no COLMAP model; expected cameras.bin and images.bin, or .txt")
    with tempfile.TemporaryDirectory() as copy:
        suffix = "bin" if (folder / "images.bin").is_file() else "txt"
        for file in folder.glob(f"*.{suffix}"):
            shutil.copy(file, copy)
        points = Path(copy, f"points3D.{suffix}")
        if not points.exists():
            points.write_bytes(struct.pack("<Q", 0) if suffix == "bin" else b"")
        try:
            return pycolmap.Reconstruction(copy)
        except Exception as error:  # pycolmap raises whatever the damage leads to
            raise UserInputError(f"{folder}: a damaged COLMAP model ({error}); export it again") from None


def _is_model(folder: Path) -> bool:
    return any(all((folder / f"{name}.{end}").is_file() for name in ("cameras", "images")) for end in ("bin", "txt"))


def _shot(folder: Path, model: Any, image: Any) -> Camera:
    lens, world_to_camera = model.cameras[image.camera_id], image.cam_from_world()
    name, kind = PurePosixPath(image.name), lens.model.name
    if kind not in DISTORTION:
        raise UserInputError(f"{folder}: lens model {kind} is not supported; undistort the images with COLMAP first")
    coefficients = tuple(float(value) for value in lens.params[len(lens.params) - DISTORTION[kind] :])
    if "FISHEYE" not in kind:
        coefficients += (0.0,) * (4 - len(coefficients))
    return Camera(
        name.parent.name or name.stem,
        intrinsic_matrix(lens.focal_length_x, lens.focal_length_y, lens.principal_point_x, lens.principal_point_y),
        pose_from_opencv(world_to_camera.rotation.matrix(), world_to_camera.translation),
        _frames(folder, name),
        Lens("fisheye" if "FISHEYE" in kind else "opencv", coefficients),
        size=(lens.width, lens.height),
    )


def _frames(folder: Path, name: PurePosixPath) -> tuple[Frame, ...]:
    """Of the video of this camera's name; else all images of its folder, where it has one; else this image alone."""
    for place in (folder, folder / "videos"):
        for video in videos_in(place):
            if video.stem in (name.stem, name.parent.name):
                return frames_of(video)
    if name.parent.name and images_in(folder / "images" / name.parent):
        return frames_of(folder / "images" / name.parent)
    return (Frame(folder / "images" / name, None),)


LAYOUT = Layout(
    "colmap",
    "a COLMAP model (cameras and images, .bin or .txt) in sparse/0, sparse or here",
    lambda folder: any(_is_model(folder / place) for place in MODELS),
    read,
)
