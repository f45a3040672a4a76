"""The figures of a suite's runs, read from their results."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pacnerf_lpo.evaluation.evaluate import RESULTS_FILE
from pacnerf_lpo.evaluation.tables import view_rows
from pacnerf_lpo.paper_tables.execution import Outcome
from pacnerf_lpo.paper_tables.plan import LABEL_FILE, PlannedRun
from pacnerf_lpo.paper_tables.tables import Column, Entry, run_of


@dataclass(frozen=True)
class Figures:
    """What a run's results say about one of its phases."""

    results: dict[str, Any]
    phase: dict[str, Any]
    key: str

    def views(self, of: str) -> list[int]:
        """File ids of the views of a set, ``train`` or ``test``."""
        return self.results["views"][of]

    def image(self, metric: str, views: Sequence[int], first_frame: bool = False) -> Entry:
        """Mean of an image metric over these views, over all frames or over the first."""
        if "error" in self.phase:
            return Entry(note=self.phase["error"], key=self.key)
        table = self.phase["images"].get(metric)
        if table is None:
            said = str((self.phase["first_frame_metrics"]["train"] or {}).get(metric, "not measured"))
            return Entry(note=said.removeprefix("n/a (").removesuffix(")"), key=self.key)
        rows, _, _ = view_rows(self.results)
        values = [table[rows.index(view)][: 1 if first_frame else None] for view in views]
        numbers = [math.inf if value is None else value for row in values for value in row]
        return Entry(sum(numbers) / len(numbers), key=self.key)

    def parameter(self, name: str) -> Entry:
        """An identified parameter [SI, degrees]."""
        found = self.phase["parameters"].get(name)
        return Entry(note="not a parameter of the model") if found is None else Entry(found["value"], key=self.key)

    def error(self, name: str) -> Entry:
        """Distance of a parameter from the truth, in its measure."""
        errors = self.phase.get("truth_errors")
        if errors is None:
            return Entry(note="no truth.json", key=self.key)
        return Entry(errors[name]["error"], key=self.key) if name in errors else Entry(note="not in truth.json")

    def true_values(self) -> dict[str, float]:
        """True parameters by name, as far as there is a truth; not those that the run was given."""
        given = self.phase["parameters"].keys() - self.results["free"]
        errors = self.phase.get("truth_errors", {})
        return {name: error["true"] for name, error in errors.items() if name not in given}


class Book:
    """The figures of a table, of the suite's own runs alone; ``outcomes`` say by directory how they ended just now."""

    def __init__(self, runs: Sequence[PlannedRun], outcomes: Mapping[Path, Outcome]):
        self.runs, self.outcomes = {run.name: run for run in runs}, outcomes

    def figures(self, scene: str, column: Column, views: str = "") -> Figures | Entry:
        """The results of a column for a scene; an entry that says why where there are none. Raises ValueError where the
        key that lies next to them is not that of the plan.
        """
        run = self.runs[run_of(scene, column, views)]
        path = run.run_dir / RESULTS_FILE
        for phase in _read(path)["phases"] if path.exists() else ():
            if phase["round"] == column.round and phase["phase"] == column.phase:
                found = json.loads((run.run_dir / LABEL_FILE).read_text())["key"]
                if found != run.key:
                    raise ValueError(f"{run.run_dir}: its results have the key {found}, but {run.key} is wanted")
                return Figures(_read(path), phase, found)
        outcome = self.outcomes.get(run.run_dir)
        if outcome is not None and outcome.status == "failed":
            return Entry(note=f"failed: {outcome.error}", key=run.key)
        return Entry(note=f"round {column.round} was not run" if path.exists() else "not run yet", key=run.key)


@cache
def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())
