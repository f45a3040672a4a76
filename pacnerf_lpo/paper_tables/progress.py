"""One view of all runs: what is done, what is running and in which phase, and how long it may take."""

import json
import re
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import TextIO

from pacnerf_lpo.manifest import FILE_NAME
from pacnerf_lpo.outer_loop import PhaseStep, algorithm_1
from pacnerf_lpo.paper_tables.cells import NO_CORRECTION
from pacnerf_lpo.paper_tables.execution import Outcome
from pacnerf_lpo.paper_tables.plan import BEGINNING, PlannedRun

TERMINAL_SECONDS = 1.0
FILE_SECONDS = 10.0
TIMES = " | "


class Progress:
    """While entered, shows the state of all runs on standard error, again and again.

    In a terminal the view is replaced in place; elsewhere it is printed when it changes. The runner fills ``outcomes``
    meanwhile with those that have ended; ``jobs`` run at the same time.
    """

    def __init__(
        self, runs: Sequence[PlannedRun], outcomes: Mapping[Path, Outcome], jobs: int, stream: TextIO | None = None
    ):
        self.runs, self.outcomes, self.jobs = runs, outcomes, jobs
        self.stream = stream or sys.stderr
        self._end, self._lines, self._shown = threading.Event(), 0, ""
        self._started = time.monotonic()
        self._thread = threading.Thread(target=self._loop, daemon=True)

    def __enter__(self) -> "Progress":
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._end.set()
        self._thread.join()
        self._show()

    def text(self) -> str:
        """The view as it is now."""
        ended = [outcome.status for outcome in self.outcomes.values()]
        going = [
            (run, phase) for run in self.runs if run.run_dir not in self.outcomes and (phase := current_phase(run))
        ]
        waiting = len(self.runs) - len(ended) - len(going) + ended.count("stopped")
        counts = {"done": ended.count("finished"), "running": len(going), "failed": ended.count("failed")}
        said = ", ".join(f"{number} {word}" for word, number in {**counts, "waiting": waiting}.items())
        times = f"{_clock(time.monotonic() - self._started)} elapsed"
        left = self.seconds_left()
        times += "" if left is None else f", about {_clock(left)} left"
        return "\n".join(
            [f"{len(self.runs)} runs: {said}{TIMES}{times}", *(f"  {run.name}: {phase}" for run, phase in going)]
        )

    def seconds_left(self) -> float | None:
        """Phases still to come, each as long as similar ones have taken here; None while that is unknown."""
        seen: dict[str, list[float]] = defaultdict(list)
        missing: list[str] = []
        for run in self.runs:
            records = _records(run)
            for record in records:
                if record["status"] == "done" and not record["copied_from"]:
                    seen[record["phase"]].append(record["seconds"])
            if run.run_dir in self.outcomes and self.outcomes[run.run_dir].status != "stopped":
                continue
            done = sum(record["status"] == "done" for record in records)
            done = max(done, BEGINNING) if run.start is not None else done
            missing += [step.role for step in _steps(run)[done:]]
        if not missing or any(role not in seen for role in missing):
            return None
        return sum(sum(seen[role]) / len(seen[role]) for role in missing) / self.jobs

    def _loop(self) -> None:
        terminal = self.stream.isatty()
        while not self._end.wait(TERMINAL_SECONDS if terminal else FILE_SECONDS):
            self._show()

    def _show(self) -> None:
        text = self.text()
        if self.stream.isatty():
            self.stream.write(f"\x1b[{self._lines}F\x1b[J" if self._lines else "")
            self._lines = text.count("\n") + 1
        elif self._shown == (shown := re.sub(rf"{re.escape(TIMES)}.*", "", text)):
            return
        else:
            self._shown = shown
        self.stream.write(text + "\n")
        self.stream.flush()


def current_phase(run: PlannedRun) -> str | None:
    """The phase a run is in, by its manifest; None when it is in none."""
    records = _records(run)
    for record in records:
        if record["status"] == "running":
            return record["phase"] if record["round"] == 0 else f"round {record['round']}, {record['phase']}"
    return "evaluation" if len(records) == len(_steps(run)) else None


def _steps(run: PlannedRun) -> list[PhaseStep]:
    correction = run.name.correction not in ("", NO_CORRECTION)
    return algorithm_1(run.rounds, correction, run.config["outer_loop"]["carry"] == "refit_grid")


def _records(run: PlannedRun) -> list[dict]:
    path = run.run_dir / FILE_NAME
    return json.loads(path.read_text())["phases"] if path.exists() else []


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
