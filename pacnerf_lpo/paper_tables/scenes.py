"""The scenes of a data folder, and which of them are the paper's own recordings."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pacnerf_lpo.data.assets import PREFIX
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.evaluate import DEMO_TRUTH
from pacnerf_lpo.evaluation.parameter_errors import TRUTH_KEYS
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.paper_tables.tables import paper_truth

TRUTH_FILE = "truth.json"
FLUIDS = ("droplet", "letter")


@dataclass(frozen=True)
class Scene:
    """A scene to run: its configuration files, in order, and what ``data.root`` and ``truth`` are set to; only the
    evaluation at the end of a run opens the truth. ``original``: it is the paper's recording, so that the paper's
    figures can stand next to ours.
    """

    name: str
    root: str
    configs: tuple[Path, ...]
    truth: str
    original: bool


def asset_scene(name: str) -> Scene:
    """A scene shipped with the package; its configuration belongs to the suite."""
    return Scene(name, PREFIX + name, (), DEMO_TRUTH, original=False)


def find_scenes(data_root: Path, names: Sequence[str], configs: Path, truths: Path) -> list[Scene]:
    """The scenes of these names that ``data_root`` has. Raises UserInputError where there is no such folder, or none of
    the scenes in it.

    A scene that brings a truth.json is another recording than the paper's, of the same name: it takes
    ``configs/shared/NAME.yaml`` on top of the paper's settings. For the paper's recordings a truth.json with the values
    of its appendix E.1 is written to ``truths``.
    """
    if not data_root.is_dir():
        raise UserInputError(f"--data-root {data_root}: there is no such folder; it holds one folder per scene")
    found = [_scene(data_root / name, configs, truths) for name in names if (data_root / name).is_dir()]
    if not found:
        raise UserInputError(f"--data-root {data_root}: none of the suite's scenes is there ({', '.join(names)})")
    return found


def _scene(folder: Path, configs: Path, truths: Path) -> Scene:
    name = folder.name
    settings = configs / "scenes" / f"{name}.yaml"
    if (folder / TRUTH_FILE).exists():
        files = (settings, configs / "shared" / f"{name}.yaml")
        return Scene(name, str(folder.resolve()), files, str((folder / TRUTH_FILE).resolve()), original=False)
    keys = {ours: theirs for theirs, ours in TRUTH_KEYS.items()}
    content = {
        "material": "newtonian" if name in FLUIDS else "solid",
        "parameters": {keys[parameter]: value for parameter, value in paper_truth(name).items()},
    }
    path = (truths / f"{name}.json").resolve()
    write_atomically(path, json.dumps(content, indent=1).encode())
    return Scene(name, str(folder.resolve()), (settings,), str(path), original=True)
