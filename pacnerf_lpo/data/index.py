"""``all_data.json`` of PAC-NeRF's layout: one pose, intrinsic matrix and time per image."""

import difflib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.recordings.files import number_at, numbers, read_values
from pacnerf_lpo.errors import UserInputError

NAME = "all_data.json"
SHAPES = {"c2w": (3, 4), "intrinsic": (3, 3)}
KEYS = ("file_path", *SHAPES, "time")
IMAGE_NAME = re.compile(r"[rm]_(\d+)_(-?\d+)\.png$")


@dataclass(frozen=True)
class Shot:
    """One line of the file: where it stands there, pose [(3, 4), metres], intrinsics [(3, 3), pixels], time [s], and
    how much later than that it was taken [s], by ``time_offset`` where the file has it.
    """

    entry: int
    camera_to_world: np.ndarray
    intrinsic: np.ndarray
    time: float
    offset: float = 0.0


@dataclass(frozen=True)
class Index:
    """All shots by (camera, frame)."""

    path: Path
    shots: dict[tuple[int, int], Shot]

    def views(self) -> list[int]:
        """Camera ids that have at least one video frame."""
        return sorted({view for view, frame in self.shots if frame >= 0})

    def frames(self) -> list[int]:
        """Frame ids, background plates and occluders left out."""
        return sorted({frame for _, frame in self.shots if frame >= 0})

    def where(self, view: int, frame: int) -> str:
        """File and entry of a shot, for messages."""
        return f"{self.path}, entry {self.shots[view, frame].entry} (view {view}, frame {frame})"

    def camera(self, view: int) -> Shot:
        """The camera at its first video frame."""
        return self.shots[view, min(frame for v, frame in self.shots if v == view and frame >= 0)]


def read_index(root: Path) -> Index:
    """Read and check ``root/all_data.json``. Raises UserInputError that names the folder, the entry or the key."""
    path = root / NAME
    if not root.is_dir():
        siblings = [folder.name for folder in root.parent.iterdir() if folder.is_dir()] if root.parent.is_dir() else []
        near = difflib.get_close_matches(root.name, siblings, n=1)
        hint = f" (did you mean {root.parent / near[0]}?)" if near else ""
        raise UserInputError(f"data.root: there is no folder {root}{hint}; set data.root to the scene")
    if not any(root.iterdir()):
        raise UserInputError(f"data.root: the folder {root} is empty; expected {NAME} and data/ with the images")
    if not path.is_file():
        raise UserInputError(f"{path}: missing; PAC-NeRF's layout keeps poses and times there, next to data/")
    entries = read_values(path)
    if not isinstance(entries, list) or not entries:
        raise UserInputError(f"{path}: expected a list of images, one {{file_path, c2w, intrinsic, time}} for each")
    shots: dict[tuple[int, int], Shot] = {}
    for number, entry in enumerate(entries):
        key, shot = _read_entry(path, number, entry)
        if key in shots:
            raise UserInputError(
                f"{path}: view {key[0]}, frame {key[1]} is listed twice (entries {shots[key].entry} and {number}); "
                "remove one of them"
            )
        shots[key] = shot
    return Index(path, shots)


def entry_of(view: int, frame: int, time: float, pose: np.ndarray, intrinsic: np.ndarray) -> dict[str, Any]:
    """What the file says of one image; arguments as of :class:`Shot`."""
    path = f"./data/r_{view}_{frame}.png"
    return {"file_path": path, "time": float(time), "c2w": pose.tolist(), "intrinsic": intrinsic.tolist()}


def check_unused(folder: Path) -> None:
    """Raise UserInputError where a folder for a new scene holds something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserInputError(f"{folder}: is there already and not empty; choose another folder or remove it")


def _read_entry(path: Path, number: int, entry: Any) -> tuple[tuple[int, int], Shot]:
    where = f"{path}, entry {number}"
    if not isinstance(entry, dict):
        raise UserInputError(f"{where}: expected an object with the keys {', '.join(KEYS)}")
    for key in KEYS:
        if key not in entry:
            near = difflib.get_close_matches(key, [str(k) for k in entry if k not in KEYS], n=1, cutoff=0.5)
            mend = f"rename '{near[0]}' to '{key}'" if near else f"add it to {', '.join(map(repr, entry))}"
            raise UserInputError(f"{where}: the key '{key}' is missing; {mend}")
    match = IMAGE_NAME.search(str(entry["file_path"]))
    if match is None:
        raise UserInputError(
            f"{where}: file_path '{entry['file_path']}' does not read ./data/r_<camera>_<frame>.png; rename the image"
        )
    pose, intrinsic = (numbers(f"{where}, '{key}'", entry[key], shape) for key, shape in SHAPES.items())
    times = (number_at(where, entry, "time"), number_at(where, entry, "time_offset", 0.0))
    return (int(match[1]), int(match[2])), Shot(number, pose, intrinsic, *times)
