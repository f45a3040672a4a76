"""Videos, or folders of images, with a calibration in TOML: Anipose and aniposelib, or caliscope."""

from pathlib import Path
from typing import Any

from pacnerf_lpo.data.recordings.files import entry, read_values
from pacnerf_lpo.data.recordings.readers.layout import Layout
from pacnerf_lpo.data.recordings.readers.media_folder import camera_of, media_in, say_what_is_not_read
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.errors import UserInputError


def read(folder: Path) -> Recording:
    """OpenCV's world-to-camera poses in the unit of the calibration board; rotations as vectors or matrices."""
    found = _files(folder)
    if len(found) != 1:
        raise UserInputError(f"{folder}: {' and '.join(p.name for p in found) or 'no TOML'}: one calibration is needed")
    used = {key: values for key, values in _cameras(found[0]).items() if not values.get("ignore", False)}
    cameras = [camera_of(folder, _name(key, own), f"{found[0]}, {key}", own) for key, own in used.items()]
    say_what_is_not_read(folder, cameras)
    return Recording(LAYOUT.name, folder, tuple(cameras), metric=True)


def _cameras(path: Path) -> dict[str, dict[str, Any]]:
    """The tables that describe a camera: ``[cam_0]``, ``[cameras.0]`` or ``[0]``."""
    values = read_values(path)
    tables = values.get("cameras", values)
    found = {key: table for key, table in tables.items() if isinstance(table, dict) and "matrix" in table}
    if not found:
        entry(str(path), values, "cam_0")
    return found


def _name(key: str, values: dict[str, Any]) -> str:
    """Anipose names its cameras; caliscope counts ports, whose videos are ``port_1.mp4`` or ``cam_1.mp4``."""
    return str(values.get("name", values.get("port", values.get("cam_id", key.removeprefix("cam_")))))


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix == ".toml")


LAYOUT = Layout(
    "toml",
    "videos or folders of images with a calibration in TOML (Anipose, caliscope)",
    lambda folder: bool(_files(folder)) and bool(media_in(folder)),
    read,
)
