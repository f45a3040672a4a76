"""What a session is about: the problem of a run, of a study or of measured flights, and what a diagnosis has stored."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pacnerf_lpo.data.trajectories.scene import scenes_in
from pacnerf_lpo.diagnosis.diagnose import Options, prepare
from pacnerf_lpo.diagnosis.run_problem import RunProblem
from pacnerf_lpo.diagnosis.settings import FILE, Settings
from pacnerf_lpo.diagnosis.store import FOLDER, Store
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.manifest import FILE_NAME, INTERVALS_FILE
from pacnerf_lpo.scene_folder import run_directory


@dataclass(frozen=True)
class Source:
    """A problem and where it came from.

    store: of the steps of its diagnosis, which has these options.
    runs: folders of the recordings.
    phase: of the runs; None: the last before a correction.
    """

    problem: Problem
    store: Store
    runs: tuple[str, ...]
    phase: str | None
    options: Options

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """90 % intervals that the fit of a single run has stored for the phase in question [SI]; else none."""
        if not isinstance(self.problem, RunProblem):
            return {}
        path = self.problem.run.run_dir / INTERVALS_FILE
        content: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
        if content.get("phase") != self.problem.stage.stem:
            return {}
        return {name: (one["low"], one["high"]) for name, one in content["parameters"].items()}


def open_source(
    given: Sequence[str | Path], phase: str | None = None, options: Options | None = None, out: str | None = None
) -> Source:
    """Read what is given, arguments as of :meth:`Session.open`; results of a diagnosis go into the folder ``out``, when
    not given into the run, or into ``explored`` next to the first of several. Raises UserInputError where it can be
    none of these, or a diagnosis could not use it.
    """
    folders = [str(folder) for folder in given]
    for folder in folders:
        if not Path(folder).exists():
            raise UserInputError(f"explore: {folder}: no such folder; give a run, a scene or a study")
    if not any(scenes_in(Path(folder)) for folder in folders):
        folders = [run_directory(folder) for folder in folders]
    home = Path(folders[0])
    out = out or str(home if len(folders) == 1 else home.parent / "explored")
    stored = Settings.read(home / FOLDER) if len(folders) == 1 and (home / FOLDER / FILE).is_file() else None
    if stored is not None and not (home / FILE_NAME).is_file() and not scenes_in(home):
        folders = stored.runs
    if stored is not None and options is None and (phase is None or phase == stored.phase):
        phase, options = stored.phase, _readable(stored.options)
    options = options or Options()
    problem, store = prepare(folders, phase, options, out)
    return Source(problem, store, tuple(folders), phase, options)


def _readable(options: Options) -> Options:
    """Options of a stored diagnosis without files that are no longer there."""
    files = {name: getattr(options, name) for name in ("candidates", "tracks", "clouds")}
    gone: dict[str, Any] = {name: None for name, path in files.items() if path is None or not Path(path).exists()}
    return replace(options, until="refit", profile=None, **gone)
