"""A folder with a video or a folder of images per camera: finds what belongs to a camera of a calibration."""

import logging
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.recordings.conventions import half_pixel_centres, pose_from_opencv, rotation_from_vector
from pacnerf_lpo.data.recordings.files import entry, numbers
from pacnerf_lpo.data.recordings.media import VIDEOS, frames_of, images_in, videos_in
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Lens
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.scene_folder import SCENE_FILE

log = logging.getLogger(__name__)

MASKS, PLATES = "masks", "backgrounds"
FULL_TURN = 2.0 * np.pi + 1e-3
"""No rotation vector is longer [rad]."""
PLACES = (".", "videos", "images", "recordings")


def camera_of(folder: Path, name: str, where: str, values: dict[str, Any]) -> Camera:
    """A camera of OpenCV's kind with its frames, its masks and its background. Raises UserInputError where a value is
    missing or wrong, or frames and masks do not go together.

    folder: of the recording. Frames: the video, or the folder of images, of the camera's name; masks:
    ``masks/<camera>/``, one image for each frame, in order; background: ``backgrounds/<camera>.png`` (or .jpg).
    values: K, distortion, R or a rotation vector, t, perhaps a size, by any of their usual names.
    """
    name = name.removesuffix(Path(name).suffix) if Path(name).suffix.lower() in VIDEOS else name
    intrinsic = numbers(f"{where}, K", entry(where, values, "K", "camera_matrix", "matrix", "mtx", "intrinsic"), (3, 3))
    lens = _first(values, "dist", "distortions", "distortion_coefficients", "distortion", "D", "dist_coeffs")
    turn = entry(where, values, "R", "rotation", "rvec", "r")
    rotation = numbers(f"{where}, rotation", turn, (3, 3), (9,), (3,))
    if rotation.size == 3 and np.linalg.norm(rotation) > FULL_TURN:
        raise UserInputError(
            f"{where}: its rotation vector turns by {np.linalg.norm(rotation):.0f} radians; it may be in degrees or "
            "hold Euler angles; write OpenCV's rvec in radians, or the 3 x 3 rotation"
        )
    rotation = rotation_from_vector(rotation) if rotation.size == 3 else rotation.reshape(3, 3)
    translation = numbers(f"{where}, translation", entry(where, values, "t", "T", "translation", "tvec"), (3,))
    size = _first(values, "size", "image_size", "resolution")
    if size is None and "image_width" in values and "image_height" in values:
        size = [values["image_width"], values["image_height"]]
    size = None if size is None else numbers(f"{where}, size", size, (2,))
    fisheye = bool(values.get("fisheye")) or values.get("model") == "fisheye"
    coefficients = () if lens is None else numbers(f"{where}, distortion", lens, (np.size(lens),)).tolist()
    return Camera(
        name,
        half_pixel_centres(intrinsic),
        pose_from_opencv(rotation, translation),
        _with_masks(folder, name, _frames(folder, name)),
        Lens("fisheye" if fisheye else "opencv", tuple(coefficients)),
        plate=next((path for path in images_in(folder / PLATES) if path.stem == name), None),
        size=None if size is None else (round(size[0]), round(size[1])),
    )


def say_what_is_not_read(folder: Path, cameras: Sequence[Camera]) -> None:
    """Warn of folders with images, of masks and of backgrounds, that belong to no camera."""
    read = {path for camera in cameras for path in camera.frames[0].file.parents} | {folder / MASKS, folder / PLATES}
    names = {camera.name for camera in cameras}
    left = [path for path in sorted(folder.iterdir()) if path not in read and _holds_images(path)]
    for part in (folder / MASKS, folder / PLATES):
        left += [path for path in (sorted(part.iterdir()) if part.is_dir() else ()) if path.stem not in names]
    if left:
        log.warning(
            f"{folder}: not read: {', '.join(str(path.relative_to(folder)) for path in left)}; masks are looked for in "
            f"{MASKS}/CAMERA/, one image for each frame, and images of the empty background in {PLATES}/CAMERA.png, "
            f"with the names of the calibration: {', '.join(sorted(names))}"
        )


def _holds_images(path: Path) -> bool:
    """Whether a folder, which is no scene of ``init``, has images or folders of images."""
    if not path.is_dir() or (path / SCENE_FILE).exists():
        return False
    return any(images_in(place) for place in (path, *path.iterdir()))


def _first(values: dict[str, Any], *names: str) -> Any:
    return next((values[name] for name in names if values.get(name) is not None), None)


def media_in(folder: Path) -> list[Path]:
    """Videos, and folders of images, that are neither masks nor backgrounds."""
    found = []
    for place in (folder / name for name in PLACES):
        found += videos_in(place)
        if place.is_dir():
            folders = [path for path in sorted(place.iterdir()) if path.name not in (MASKS, PLATES, *PLACES)]
            found += [path for path in folders if images_in(path)]
    return found


def _frames(folder: Path, name: str) -> tuple[Frame, ...]:
    media = media_in(folder)
    own = [path for path in media if path.stem == name]
    own = own or [path for path in media if name in re.split(r"[-_. ]", path.stem)]
    if len(own) > 1:
        listed = ", ".join(str(path.relative_to(folder)) for path in own)
        raise UserInputError(f"{folder}: camera {name} could be any of {listed}; leave one of them")
    if not own:
        listed = ", ".join(path.name for path in media) or "no videos and no folders of images"
        raise UserInputError(f"{folder}: no video and no folder named {name}; there are: {listed}; rename them")
    return frames_of(own[0])


def _with_masks(folder: Path, name: str, frames: tuple[Frame, ...]) -> tuple[Frame, ...]:
    masks = images_in(folder / MASKS / name)
    if not masks:
        return frames
    if len(masks) != len(frames):
        raise UserInputError(
            f"{folder / MASKS / name}: {len(masks)} masks for {len(frames)} frames; give one for each, or none"
        )
    return tuple(replace(frame, mask=mask) for frame, mask in zip(frames, masks, strict=True))
