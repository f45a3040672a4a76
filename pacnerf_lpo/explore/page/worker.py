"""One thread that does what hands ask for, one thing after the other, the newest wish of a kind only."""

import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from time import monotonic

from pacnerf_lpo.errors import Interrupted, RunError, SimulationError, UserInputError

EXPLAINED = (UserInputError, RunError, SimulationError, OSError)
"""Errors whose message is written for a user."""


def one_line(error: BaseException) -> str:
    """What a person reads of an error; one that no message explains names its kind and place."""
    text = " ".join(str(error).split())
    if isinstance(error, EXPLAINED):
        return text or type(error).__name__
    where = traceback.extract_tb(error.__traceback__)
    at = f" ({where[-1].filename.rsplit('/', 1)[-1]}:{where[-1].lineno})" if where else ""
    return f"this is a mistake of the program, not yours: {type(error).__name__}: {text}{at}; the terminal says more"


class Worker:
    """Runs jobs in a thread of its own. A job replaces one of the same kind that has not begun.

    Args:
        complain: called with one line for every job that failed.
        rested: called when nothing was asked for ``rest`` seconds after a job that said so.
        rest: how long a hand has to be still before what it did is refined [s].
    """

    def __init__(self, complain: Callable[[str], None], rested: Callable[[], None], rest: float):
        self.complain, self.rested, self.rest = complain, rested, rest
        self._jobs: dict[str, Callable[[], None]] = {}
        self._condition = threading.Condition()
        self._refine_at: float | None = None
        self._ended = False
        self.busy = False
        self.thread = threading.Thread(target=self._run, name="explore", daemon=True)
        self.thread.start()

    def ask(self, kind: str, job: Callable[[], None], refined_later: bool = False) -> None:
        """Have a job done soon, from any thread; those of one kind replace each other while they wait. ``rested``
        follows a job that says ``refined_later`` when no more is asked for.
        """
        with self._condition:
            self._jobs.pop(kind, None)
            self._jobs[kind] = partial(self._and_rest, job) if refined_later else job
            self._condition.notify_all()

    @property
    def wanted(self) -> bool:
        """Whether something waits: a refinement that runs may give up."""
        return bool(self._jobs)

    def wait(self, seconds: float) -> bool:
        """Whether all that was asked for, refinement included, was done within some seconds."""
        with self._condition:
            return self._condition.wait_for(
                lambda: not self._jobs and not self.busy and self._refine_at is None, timeout=seconds
            )

    def end(self) -> None:
        """End the thread after the job that runs."""
        with self._condition:
            self._ended = True
            self._jobs.clear()
            self._condition.notify_all()
        self.thread.join(timeout=5.0)

    def _next(self) -> Callable[[], None] | None:
        with self._condition:
            self.busy = False
            self._condition.notify_all()
            left = None if self._refine_at is None else self._refine_at - monotonic()
            if not self._condition.wait_for(lambda: self._ended or self._jobs, left):
                self._refine_at, self.busy = None, True
                return self.rested
            if self._ended:
                return None
            self.busy = True
            return self._jobs.pop(next(iter(self._jobs)))

    def _and_rest(self, job: Callable[[], None]) -> None:
        job()
        self._refine_at = monotonic() + self.rest

    def _run(self) -> None:
        while (job := self._next()) is not None:
            guarded(job, self.complain)


def guarded(job: Callable[[], None], complain: Callable[[str], None]) -> None:
    """Do a job; whatever goes wrong becomes one line, and a traceback in the terminal where no message explains it."""
    try:
        job()
    except Interrupted:
        complain("stopped")
    except Exception as error:
        if not isinstance(error, EXPLAINED):
            traceback.print_exc(file=sys.stderr)
        complain(one_line(error))
