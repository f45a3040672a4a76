"""A scene that ``init`` wrote, read again as it is now: what a person changed in ``scene.yaml`` counts."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pacnerf_lpo.config_layers import flat
from pacnerf_lpo.data import checks
from pacnerf_lpo.data.images import image_size, on_white, read_png
from pacnerf_lpo.data.index import NAME as INDEX_NAME
from pacnerf_lpo.data.index import read_index
from pacnerf_lpo.data.matting import matte
from pacnerf_lpo.data.pac_nerf import OCCLUDER, OCCLUDER_ALPHA, PLATE
from pacnerf_lpo.data.recordings.scene_values import Value, annotated, header
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.scene_folder import find_scene_file

GRAVITY = [0.0, -9.8, 0.0]
"""Of ``Physics``, where scene.yaml has none [m/s^2]."""
HIDDEN = 0.1
"""Where an image is transparent and fewer pixels than this part differ from the others, they are filling."""
DIFFER = 3.0 / 255.0
"""Difference of colours that rounding cannot make."""


@dataclass(frozen=True)
class View:
    """A camera of a scene.

    number, name: in the file names, and as the recording called it
    intrinsic: [pixels, (3, 3)], pixel centres at +0.5
    pose: camera to world, OpenGL axes [rotation and metres, (3, 4)]
    valid: False where the image was extended or undistortion left nothing [(H, W), bool]
    plate: the empty background [0..1, (H, W, 3)]; None where there is none
    offset: how much later than stamped its frames were taken [s]
    """

    number: int
    name: str
    intrinsic: np.ndarray
    pose: np.ndarray
    valid: np.ndarray
    plate: np.ndarray | None
    offset: float = 0.0

    def after(self, motion: np.ndarray) -> "View":
        """The camera to which a body looks here as it does to this one after a motion [m, (3,)]."""
        return replace(self, pose=np.column_stack((self.pose[:, :3], self.pose[:, 3] - motion)))


@dataclass(frozen=True)
class WrittenScene:
    """A scene folder.

    source, layout: of the recording; "" where scene.yaml does not say
    notes: the comments at the top of scene.yaml, by their first words
    values: of scene.yaml with where they come from
    times: of the frames [s, (F,)]
    lower, upper: corners of the box at frame 0 [m, (3,) each]
    hit_frame: first frame on the ground
    ground_height: of the ground plane along y [m]
    gravity: [m/s^2, (3,)]
    """

    folder: Path
    source: str
    layout: str
    notes: Mapping[str, str]
    values: tuple[Value, ...]
    views: tuple[View, ...]
    frames: tuple[int, ...]
    times: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    hit_frame: int
    ground_height: float
    gravity: np.ndarray

    def pixels(self, view: View, frame: int) -> np.ndarray:
        """Colour and opacity of an image [0..1, (H, W, 4)]; ``frame`` counts from 0."""
        path = _image(self.folder, view.number, self.frames[frame])
        pixels = read_png(path)
        if pixels.shape[:2] != view.valid.shape:
            raise UserInputError(f"{path}: not of the size of the other images; run init again")
        if view.plate is not None and path.name.startswith("r_"):
            return np.dstack((pixels[..., :3], matte(pixels[..., :3], view.plate)[1]))
        return pixels if pixels.shape[-1] == 4 else np.dstack(on_white(pixels))


def read_written_scene(folder: Path) -> WrittenScene:
    """Read scene.yaml and the cameras. Raises UserInputError for a missing or damaged file, or an impossible value."""
    path = find_scene_file(folder)
    text = path.read_text()
    try:
        content = yaml.safe_load(text)
        config = flat(content) if isinstance(content, dict) else {}
        values = tuple(annotated(text))
    except yaml.YAMLError as error:
        raise UserInputError(f"{path}: no valid YAML ({' '.join(str(error).split())}); mend that line") from None
    first = re.match(r"# Written by pacnerf-lpo init from (.*), layout (\S+)\.", text)
    index = read_index(folder if (folder / INDEX_NAME).exists() else Path(str(_value(path, config, "data.root"))))
    numbers, frames = index.views(), checks.check_frames(index, None)
    checks.check_cameras(index, numbers, frames)
    notes = header(text)
    names = {int(number): name for number, name in re.findall(r"(\d+) ([^,;]+)", notes.get("cameras", ""))}
    views = []
    for number in numbers:
        shot = index.camera(number)
        valid, plate = _valid_and_plate(index.path.parent, number, frames[0])
        name = names.get(number, str(number))
        views.append(View(number, name, shot.intrinsic, shot.camera_to_world, valid, plate, shot.offset))
    box = checks.check_box(*(_corner(path, config, f"data.box_{side}") for side in ("lower", "upper")))
    hit = _number(path, "phases.velocity.init_args.hit_frame", config)
    if not (hit == int(hit) and 1 <= hit < len(frames)):
        raise UserInputError(
            f"{path}: phases.velocity.init_args.hit_frame = {hit:g}; give a frame in 1..{len(frames) - 1}"
        )
    source, layout = first.groups() if first else ("", "")
    times = np.array(checks.check_times(index, numbers, frames))
    ground = _number(path, "physics.ground_height", config, 0.0)
    gravity = np.array(_corner(path, config, "physics.gravity", GRAVITY))
    about = index.path.parent, source, layout, notes, values, tuple(views), frames, times
    return WrittenScene(*about, np.array(box.lower), np.array(box.upper), int(hit), ground, gravity)


def picture(pixels: np.ndarray, plate: np.ndarray | None) -> np.ndarray:
    """What the camera saw, as far as it was kept [0..1, (h, w, 3)].

    The object is put on its plate; without one, images that were cut out by masks still have their background under the
    transparency; else it is put on white.

    Args:
        pixels: colour and opacity [0..1, (h, w, 4)].
        plate: the empty background [0..1, (h, w, 3)].
    """
    colour, opacity = pixels[..., :3], pixels[..., 3:]
    behind = colour[opacity[..., 0] == 0.0]
    if plate is None and len(behind):
        differ = np.abs(behind - np.median(behind, axis=0)).max(axis=1) > DIFFER
        if differ.mean() > HIDDEN:
            return colour
    return opacity * colour + (1.0 - opacity) * (1.0 if plate is None else plate)


def _image(folder: Path, number: int, frame: int) -> Path:
    """The matted image where there is one, else the raw one."""
    matted = folder / "data" / f"m_{number}_{frame}.png"
    return matted if matted.exists() else matted.with_name(f"r_{number}_{frame}.png")


def _valid_and_plate(folder: Path, number: int, frame: int) -> tuple[np.ndarray, np.ndarray | None]:
    data = folder / "data"
    size = image_size(_image(folder, number, frame))
    occluder, plate = (data / f"r_{number}_{kind}.png" for kind in (OCCLUDER, PLATE))
    valid = read_png(occluder)[..., 3] <= OCCLUDER_ALPHA if occluder.exists() else np.ones(size, bool)
    return valid, read_png(plate)[..., :3] if plate.exists() else None


def _value(path: Path, config: Mapping[str, Any], key: str, default: Any = None) -> Any:
    found = config.get(key)
    if found is None and default is None:
        raise UserInputError(f"{path}: {key} is missing; write it as pacnerf-lpo init does")
    return default if found is None else found


def _number(path: Path, key: str, config: Mapping[str, Any], default: float | None = None) -> float:
    found = _value(path, config, key, default)
    if isinstance(found, bool) or not isinstance(found, int | float) or not np.isfinite(found):
        raise UserInputError(f"{path}: {key} = {found!r}; give one number")
    return float(found)


def _corner(path: Path, config: Mapping[str, Any], key: str, default: list[float] | None = None) -> list[float]:
    found = _value(path, config, key, default)
    if not (isinstance(found, list) and len(found) == 3 and all(isinstance(part, int | float) for part in found)):
        raise UserInputError(f"{path}: {key} = {found!r}; give three numbers in brackets, [x, y, z]")
    return [float(part) for part in found]
