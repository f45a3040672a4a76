"""Independent simulations in several processes at once: to a few thousand particles more threads bring little."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import torch
from joblib import Parallel, delayed, effective_n_jobs, parallel_config

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import runtime

MOST = 8
"""Processes to use where nobody says how many: each takes about half a gigabyte."""
Result = TypeVar("Result")
Progress = Callable[[str], None]
"""Receives a line about each step of what takes long."""


def prefixed(progress: Progress, prefix: str) -> Progress:
    """The same with a prefix to every line."""
    return lambda text: progress(prefix + text)


def check_jobs(count: int | None, where: str) -> None:
    """Raise UserInputError, which names the setting, for less than one process."""
    if count is not None and count < 1:
        raise UserInputError(f"{where}: jobs = {count}; give 1 or more, or leave it out for as many as there are cores")


@contextlib.contextmanager
def processes(count: int | None, linger: float | None = None) -> Iterator[None]:
    """Let :func:`each` use so many processes, one thread each; None: as many as torch may use threads, at most 8, and
    one where simulations run on a GPU. They wait for more work for so many seconds afterwards; None: five minutes.

    Raises:
        UserInputError: less than one.
    """
    check_jobs(count, "processes")
    if count is None:
        count = 1 if runtime.device().type == "cuda" else min(torch.get_num_threads(), MOST)
    if count == 1:
        yield
        return
    waiting = {} if linger is None else {"idle_worker_timeout": linger}
    with parallel_config("loky", n_jobs=count, inner_max_num_threads=1, max_nbytes=None, **waiting):
        yield


def workers() -> int:
    """How many processes :func:`each` uses here."""
    return effective_n_jobs(None)


def each(function: Callable[..., Result], arguments: Iterable[tuple]) -> Iterator[Result]:
    """Results of a function for every tuple of arguments, in their order, each as soon as it is there.

    One after the other in this process, unless :func:`processes` is in force. Function and arguments are pickled then;
    what the function changes in its arguments is not seen here.
    """
    return iter(Parallel(batch_size=1, return_as="generator")(delayed(function)(*given) for given in arguments))
