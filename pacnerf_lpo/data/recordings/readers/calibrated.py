"""Videos, or folders of images, with a calibration: of OpenCV's kind in YAML or JSON, or in TOML as of Anipose."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pacnerf_lpo.data.recordings.files import entry, read_values
from pacnerf_lpo.data.recordings.readers.layout import Layout
from pacnerf_lpo.data.recordings.readers.media_folder import camera_of, media_in, say_what_is_not_read
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.errors import UserInputError

ENDS = (".yml", ".yaml", ".json")
NAMES = ("calibration", "calib", "cameras", "extrinsics")
"""One file for all cameras; or each camera has its own, next to its video and named as it."""
Calibrations = list[tuple[str, str, dict[str, Any]]]
"""Of each camera its name, where its values stand, and these."""


def _layout(
    name: str,
    calibration: str,
    files: Callable[[Path], list[Path]],
    calibrations: Callable[[Path, list[Path]], Calibrations],
) -> Layout:
    """OpenCV's world-to-camera poses in the unit of the calibration board, whose name and axes are not stated."""

    def read(folder: Path) -> Recording:
        cameras = [camera_of(folder, *one) for one in calibrations(folder, files(folder))]
        say_what_is_not_read(folder, cameras)
        return Recording(name, folder, tuple(cameras), metric=True)

    looks_for = f"videos or folders of images with {calibration}"
    return Layout(name, looks_for, lambda folder: bool(files(folder)) and bool(media_in(folder)), read)


def _opencv_files(folder: Path) -> list[Path]:
    """Calibration files: those with a calibration's name, and those named as a video or folder of images."""
    names = {*NAMES, *(path.stem for path in media_in(folder))}
    return sorted(path for path in folder.iterdir() if path.suffix in ENDS and path.stem in names)


def _opencv(folder: Path, files: list[Path]) -> Calibrations:
    shared = [path for path in files if path.stem in NAMES]
    if not shared:
        return [(path.stem, str(path), _mapping(path)) for path in files]
    if len(shared) > 1:
        raise UserInputError(f"{folder}: {' and '.join(path.name for path in shared)} are both calibrations; leave one")
    values = _mapping(shared[0])
    cameras = values.get("cameras", values)
    if isinstance(cameras, list):
        cameras = {str(one.get("name", number)): one for number, one in enumerate(cameras)}
    return [(str(name), f"{shared[0]}, camera {name}", own) for name, own in cameras.items() if isinstance(own, dict)]


def _mapping(path: Path) -> dict[str, Any]:
    values = read_values(path)
    if not isinstance(values, dict):
        raise UserInputError(f"{path}: expected a mapping of cameras, or of K, dist, R and t; write it again")
    return values


def _toml(folder: Path, files: list[Path]) -> Calibrations:
    """Of the tables that describe a camera, and are not ignored: ``[cam_0]``, ``[cameras.0]`` or ``[0]``."""
    if len(files) != 1:
        raise UserInputError(f"{folder}: {' and '.join(p.name for p in files) or 'no TOML'}: one calibration is needed")
    values = read_values(files[0])
    tables = values.get("cameras", values)
    cameras = {key: table for key, table in tables.items() if isinstance(table, dict) and "matrix" in table}
    if not cameras:
        entry(str(files[0]), values, "cam_0")
    used = {key: own for key, own in cameras.items() if not own.get("ignore", False)}
    return [(_toml_name(key, own), f"{files[0]}, {key}", own) for key, own in used.items()]


def _toml_name(key: str, values: dict[str, Any]) -> str:
    """Anipose names its cameras; caliscope counts ports, whose videos are ``port_1.mp4`` or ``cam_1.mp4``."""
    return str(values.get("name", values.get("port", values.get("cam_id", key.removeprefix("cam_")))))


OPENCV = _layout("opencv", "calibration.yml or .json, or one such file per camera", _opencv_files, _opencv)
TOML = _layout("toml", "a calibration in TOML (Anipose, caliscope)", lambda path: sorted(path.glob("*.toml")), _toml)
