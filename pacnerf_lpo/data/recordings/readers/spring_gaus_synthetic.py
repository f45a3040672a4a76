"""Spring-Gaus, synthetic: ``camera.json`` [{camera, K, c2w}] next to one folder of transparent images per camera."""

from pathlib import Path
from typing import Any

from pacnerf_lpo.data.recordings.files import entry, numbers, read_values
from pacnerf_lpo.data.recordings.media import images_in
from pacnerf_lpo.data.recordings.readers.layout import Layout
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.errors import UserInputError


def read(folder: Path) -> Recording:
    """OpenGL cameras, y up; the layout has no times and no unit."""
    found = _object_folders(folder)
    if len(found) != 1:
        several = ", ".join(str(path.relative_to(folder)) for path in found) or "none"
        raise UserInputError(f"{folder}: one object is needed, but there are: {several}; give the folder of one")
    path = found[0] / "camera.json"
    cameras = tuple(_camera(path, number, values) for number, values in enumerate(read_values(path)))
    return Recording(LAYOUT.name, folder, cameras, up=(0.0, 1.0, 0.0))


def _camera(path: Path, number: int, values: Any) -> Camera:
    where = f"{path}, camera {number}"
    name = str(entry(where, values, "camera"))
    intrinsic = numbers(f"{where}, K", entry(where, values, "K"), (3, 3))
    pose = numbers(f"{where}, c2w", entry(where, values, "c2w"), (4, 4), (3, 4))[:3]
    return Camera(name, intrinsic, pose, tuple(Frame(image, None) for image in images_in(path.parent / name)))


def _object_folders(folder: Path) -> list[Path]:
    if (folder / "camera.json").is_file():
        return [folder]
    return sorted(path.parent for path in folder.glob("render/*/camera.json"))


LAYOUT = Layout(
    "spring-gaus-synthetic",
    "camera.json, here or in render/<object>",
    lambda folder: bool(_object_folders(folder)),
    read,
)
