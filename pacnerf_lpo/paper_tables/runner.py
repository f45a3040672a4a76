"""All runs of a plan, by joblib; one failed run does not end the others."""

import contextlib
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Literal

from joblib import Parallel, delayed, parallel_config

from pacnerf_lpo.errors import Interrupted, UserInputError
from pacnerf_lpo.paper_tables import execution
from pacnerf_lpo.paper_tables.execution import Outcome, Status, Task, execute
from pacnerf_lpo.paper_tables.plan import PlannedRun
from pacnerf_lpo.paper_tables.progress import Progress

Backend = Literal["loky", "dask", "ray"]


@dataclass(frozen=True)
class Resources:
    """How runs share the machine.

    jobs: runs at the same time.
    backend: what starts them when there are several.
    memory: limit of each run's resident memory [bytes]; None for no limit.
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
    """Run what is missing: first the beginnings, then what starts from them.

    Returns:
        The outcome of every run by its directory.

    Raises:
        Interrupted: a second Ctrl-C; after the first, runs write a checkpoint and their outcome is ``stopped``.
    """
    outcomes = {run.run_dir: Outcome(run.run_dir, "finished") for run in runs if run.is_finished()}
    with _engine(resources), _stop_file(output) as stop, Progress(runs, outcomes, resources.jobs):
        for starts in (False, True):
            wave = [run for run in runs if (run.start is not None) == starts and run.run_dir not in outcomes]
            outcomes.update(
                {run.run_dir: Outcome(run.run_dir, *cause) for run in wave if (cause := _hindered(run, outcomes))}
            )
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


def _hindered(run: PlannedRun, outcomes: Mapping[Path, Outcome]) -> tuple[Status, str] | None:
    """Why a run cannot begin: what it would start from is not there."""
    if run.start is None or run.run_dir.exists() or outcomes[run.start.run_dir].status == "finished":
        return None
    return outcomes[run.start.run_dir].status, f"{run.start.name}, from which it starts, did not finish"


@contextlib.contextmanager
def _engine(resources: Resources) -> Iterator[None]:
    """joblib with the chosen backend."""
    options: dict[str, Any] = {"n_jobs": resources.jobs}
    try:
        if resources.backend == "dask":
            from dask.distributed import Client

            with Client(n_workers=resources.jobs, threads_per_worker=1), parallel_config("dask", **options):
                yield
            return
        if resources.backend == "ray":
            from ray.util.joblib import register_ray

            register_ray()
    except ImportError as error:
        package = {"dask": "dask[distributed]", "ray": "ray"}[resources.backend]
        raise UserInputError(
            f"--backend {resources.backend}: {error.name} is not installed; pip install '{package}'"
        ) from None
    with parallel_config(resources.backend, **options):
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
