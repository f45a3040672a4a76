"""Videos, or folders of images, with a calibration of OpenCV's kind in YAML or JSON."""

from pathlib import Path
from typing import Any

from pacnerf_lpo.data.recordings.files import read_values
from pacnerf_lpo.data.recordings.readers.layout import Layout
from pacnerf_lpo.data.recordings.readers.media_folder import camera_of, media_in, say_what_is_not_read
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.errors import UserInputError

ENDS = (".yml", ".yaml", ".json")
NAMES = ("calibration", "calib", "cameras", "extrinsics")
"""One file for all cameras; or each camera has its own, next to its video and named as it."""


def read(folder: Path) -> Recording:
    """OpenCV's world-to-camera poses; neither unit nor axes are stated."""
    cameras = [camera_of(folder, name, where, values) for name, where, values in _calibrations(folder)]
    say_what_is_not_read(folder, cameras)
    return Recording(LAYOUT.name, folder, tuple(cameras), metric=True)


def _calibrations(folder: Path) -> list[tuple[str, str, dict[str, Any]]]:
    files = _files(folder)
    shared = [path for path in files if path.stem in NAMES]
    if not shared:
        return [(path.stem, str(path), _mapping(path, read_values(path))) for path in files]
    if len(shared) > 1:
        raise UserInputError(f"{folder}: {' and '.join(path.name for path in shared)} are both calibrations; leave one")
    values = _mapping(shared[0], read_values(shared[0]))
    cameras = values.get("cameras", values)
    if isinstance(cameras, list):
        cameras = {str(one.get("name", number)): one for number, one in enumerate(cameras)}
    return [(str(name), f"{shared[0]}, camera {name}", own) for name, own in cameras.items() if isinstance(own, dict)]


def _mapping(path: Path, values: Any) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise UserInputError(f"{path}: expected a mapping of cameras, or of K, dist, R and t; write it again")
    return values


def _files(folder: Path) -> list[Path]:
    """Calibration files: those with a calibration's name, and those named as a video or folder of images."""
    names = {*NAMES, *(path.stem for path in media_in(folder))}
    return sorted(path for path in folder.iterdir() if path.suffix in ENDS and path.stem in names)


LAYOUT = Layout(
    "opencv",
    "videos or folders of images with calibration.yml or .json, or one such file per camera",
    lambda folder: bool(_files(folder)) and bool(media_in(folder)),
    read,
)
