"""A scene that ``init`` wrote, read again as it is now: what a person changed in ``scene.yaml`` counts."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import takewhile
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
from pacnerf_lpo.data.pac_nerf import PLATE, Files, choose_files, load_valid
from pacnerf_lpo.data.recordings.files import entry, number_at, numbers
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.scene_folder import find_scene_file

GRAVITY = [0.0, -9.8, 0.0]
"""Of ``Physics``, where scene.yaml has none [m/s^2]."""
HIDDEN = 0.1
"""Where an image is transparent and fewer pixels than this part differ from the others, they are filling."""
DIFFER = 3.0 / 255.0
"""Difference of colours that rounding cannot make."""
NEXT = "\n#   "
"""Between two lines of a comment about one thing."""
HEADER = re.compile(rf"^# ([a-z]+): (.+(?:{NEXT}.*)*)", re.MULTILINE)
"""Lines at the top of the file about something that is no value, such as the cameras."""


@dataclass(frozen=True)
class Value:
    """One value of the file: its dotted key, as it is written, and the comment on it ("" where there is none)."""

    key: str
    text: str
    why: str


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
    files: Files
    times: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    hit_frame: int
    ground_height: float
    gravity: np.ndarray

    def pixels(self, view: View, frame: int) -> np.ndarray:
        """Colour and opacity of an image [0..1, (H, W, 4)]; ``frame`` counts from 0."""
        path = self.files.image(view.number, self.files.frames[frame])
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
    index = read_index(folder if (folder / INDEX_NAME).exists() else Path(str(entry(str(path), config, "data.root"))))
    files = choose_files(index, None, None, "auto")
    checks.check_cameras(index, files.views, files.frames)
    notes = header(text)
    names = {int(number): name for number, name in re.findall(r"(\d+) ([^,;]+)", notes.get("cameras", ""))}
    views = []
    for number in files.views:
        shot, size = index.camera(number), image_size(files.image(number, files.frames[0]))
        valid, behind = load_valid(files, number, size, size).numpy(), files.image(number, PLATE)
        plate = read_png(behind)[..., :3] if behind.exists() else None
        name = names.get(number, str(number))
        views.append(View(number, name, shot.intrinsic, shot.camera_to_world, valid, plate, shot.offset))
    lower, upper = (_corner(path, config, f"data.box_{side}") for side in ("lower", "upper"))
    checks.check_box(lower.tolist(), upper.tolist())
    hit = number_at(str(path), config, "phases.velocity.init_args.hit_frame")
    if not (hit == int(hit) and 1 <= hit < len(files.frames)):
        raise UserInputError(
            f"{path}: phases.velocity.init_args.hit_frame = {hit:g}; give a frame in 1..{len(files.frames) - 1}"
        )
    source, layout = first.groups() if first else ("", "")
    times = np.array(checks.check_times(index, files.views, files.frames))
    ground = number_at(str(path), config, "physics.ground_height", 0.0)
    gravity = _corner(path, {"physics.gravity": GRAVITY, **config}, "physics.gravity")
    about = index.path.parent, source, layout, notes, values, tuple(views), files, times
    return WrittenScene(*about, lower, upper, int(hit), ground, gravity)


def picture(pixels: np.ndarray, plate: np.ndarray | None) -> np.ndarray:
    """What the camera saw, as far as it was kept [0..1, (h, w, 3)], from colour and opacity [0..1, (h, w, 4)].

    The object is put on its plate [0..1, (h, w, 3)]; without one, images that were cut out by masks still have their
    background under the transparency; else it is put on white.
    """
    colour, opacity = pixels[..., :3], pixels[..., 3:]
    behind = colour[opacity[..., 0] == 0.0]
    if plate is None and len(behind):
        differ = np.abs(behind - np.median(behind, axis=0)).max(axis=1) > DIFFER
        if differ.mean() > HIDDEN:
            return colour
    return opacity * colour + (1.0 - opacity) * (1.0 if plate is None else plate)


def _corner(path: Path, config: Mapping[str, Any], key: str) -> np.ndarray:
    return numbers(f"{path}, {key}, [x, y, z]", entry(str(path), config, key), (3,))


def header(text: str) -> dict[str, str]:
    """What the comments at the top of the file say, by their first words."""
    top = "".join(takewhile(lambda line: line.startswith("#"), text.splitlines(keepends=True)))
    return {word: said.replace(NEXT, "; ") for word, said in HEADER.findall(top)}


def annotated(text: str) -> list[Value]:
    """Every value in order; one without a comment has that of the one before it in its section, else the section's."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    return [] if root is None else list(_walk(root, text, text.splitlines(), "", ""))


def _walk(node: yaml.Node, text: str, lines: list[str], key: str, why: str) -> Iterator[Value]:
    if isinstance(node, yaml.ScalarNode) or getattr(node, "flow_style", False):
        yield Value(key, text[node.start_mark.index : node.end_mark.index].strip(), why)
    elif isinstance(node, yaml.SequenceNode):
        for number, item in enumerate(node.value):
            yield from _walk(item, text, lines, f"{key}[{number}]", why)
    elif isinstance(node, yaml.MappingNode):
        before = why
        for name, value in node.value:
            leaf = isinstance(value, yaml.ScalarNode) or value.flow_style
            begin, end = name.start_mark, value.end_mark if leaf else name.end_mark
            behind = lines[end.line][end.column :].partition("#")[2].strip() if end.line < len(lines) else ""
            above = [line.strip() for line in reversed(lines[: begin.line] if begin.column else [])]  # an indented key
            comments = takewhile(lambda line: line.startswith("#"), above)
            own = behind or " ".join(reversed([line.lstrip("# ") for line in comments]))
            yield from _walk(value, text, lines, f"{key}.{name.value}" if key else name.value, own or before)
            before = own if own and leaf else before
