"""All runs of a plan, by joblib; one failed run does not end the others. Meanwhile one view says what is done, what is
running and in which phase, and how long it may take.
"""

import contextlib
import json
import os
import re
import signal
import statistics
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from types import FrameType
from typing import Literal

from joblib import Parallel, delayed, parallel_config

from pacnerf_lpo.errors import Interrupted, UserInputError
from pacnerf_lpo.manifest import FILE_NAME
from pacnerf_lpo.outer_loop import PhaseStep, algorithm_1
from pacnerf_lpo.paper_tables import execution
from pacnerf_lpo.paper_tables.execution import Outcome, Task, execute
from pacnerf_lpo.paper_tables.plan import BEGINNING, PlannedRun
from pacnerf_lpo.paper_tables.tables import NO_CORRECTION

Backend = Literal["loky", "dask", "ray"]
TERMINAL_SECONDS = 1.0
FILE_SECONDS = 10.0
TIMES = " | "


@dataclass(frozen=True)
class Resources:
    """How runs share the machine: how many run at the same time, what starts them when there are several, and a limit
    of each one's resident memory [bytes] or None.
    """

    jobs: int = 1
    backend: Backend = "loky"
    memory: int | None = None

    def __post_init__(self) -> None:
        if self.jobs < 1:
            raise UserInputError(f"--jobs {self.jobs}: give 1 or more")

    @property
    def threads(self) -> int:
        """CPU threads of each run."""
        return max(1, len(os.sched_getaffinity(0)) // self.jobs)


def run_all(runs: Sequence[PlannedRun], output: Path, resources: Resources) -> dict[Path, Outcome]:
    """Run what is missing: first the beginnings, then what starts from them; the outcome of every run by its directory.
    Raises Interrupted at a second Ctrl-C; after the first, runs write a checkpoint and their outcome is ``stopped``.
    """
    outcomes = {run.run_dir: Outcome(run.run_dir, "finished") for run in runs if run.is_finished()}
    with _engine(resources), _stop_file(output) as stop, Progress(runs, outcomes, resources.jobs):
        for starts in (False, True):
            wave = [run for run in runs if (run.start is not None) == starts and run.run_dir not in outcomes]
            outcomes |= {run.run_dir: cause for run in wave if (cause := _hindered(run, outcomes))}
            parallel = Parallel(batch_size=1, pre_dispatch="n_jobs", return_as="generator_unordered")
            tasks = (_task(run, resources, stop) for run in wave if run.run_dir not in outcomes)
            for outcome in parallel(delayed(execute)(task) for task in tasks):
                outcomes[outcome.run_dir] = outcome
    return outcomes


def _task(run: PlannedRun, resources: Resources, stop: Path) -> Task:
    """Make the run directory at the last moment: what it starts from is copied, and that takes room."""
    if not stop.exists():
        run.prepare()
    return Task(run.run_dir, execution.FIT, resources.threads, resources.memory, stop)


def _hindered(run: PlannedRun, outcomes: Mapping[Path, Outcome]) -> Outcome | None:
    """Why a run cannot begin: what it would start from is not there."""
    if run.start is None or run.run_dir.exists() or outcomes[run.start.run_dir].status == "finished":
        return None
    reason = f"{run.start.name}, from which it starts, did not finish"
    return Outcome(run.run_dir, outcomes[run.start.run_dir].status, reason)


@contextlib.contextmanager
def _engine(resources: Resources) -> Iterator[None]:
    """joblib with the chosen backend."""
    with contextlib.ExitStack() as stack:
        try:
            if resources.backend == "dask":
                from dask.distributed import Client

                stack.enter_context(Client(n_workers=resources.jobs, threads_per_worker=1))
            elif resources.backend == "ray":
                from ray.util.joblib import register_ray

                register_ray()
        except ImportError as error:
            package = {"dask": "dask[distributed]", "ray": "ray"}[resources.backend]
            raise UserInputError(
                f"--backend {resources.backend}: {error.name} is not installed; pip install '{package}'"
            ) from None
        stack.enter_context(parallel_config(resources.backend, n_jobs=resources.jobs))
        yield


@contextlib.contextmanager
def _stop_file(output: Path) -> Iterator[Path]:
    """A file that appears with the first Ctrl-C; the second one raises Interrupted."""
    path = output / ".stop"
    output.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)

    def handle(number: int, frame: FrameType | None) -> None:
        if path.exists():
            raise Interrupted
        path.touch()

    previous = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)
        for number, handler in previous.items():
            signal.signal(number, handler)


class Progress:
    """While entered, shows the state of all runs on standard error, again and again.

    In a terminal the view is replaced in place; elsewhere it is printed when it changes. The runner fills ``outcomes``
    meanwhile with those that have ended; ``jobs`` run at the same time.
    """

    def __init__(self, runs: Sequence[PlannedRun], outcomes: Mapping[Path, Outcome], jobs: int):
        self.runs, self.outcomes, self.jobs, self.stream = runs, outcomes, jobs, sys.stderr
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
        done, failed = ended.count("finished"), ended.count("failed")
        said = f"{done} done, {len(going)} running, {failed} failed, {waiting} waiting"
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
        return sum(statistics.fmean(seen[role]) for role in missing) / self.jobs

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
