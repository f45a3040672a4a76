"""A sign of life from a command that has said nothing for a while. Imports little, since it starts before all else."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

QUIET = 8.0
"""Seconds without a word after which a line says what is being done: nobody waits for more than ten."""
POLL = 0.5


class _Heart(threading.Thread):
    """Listens to what is written to the standard streams, and writes a line when nothing was for :data:`QUIET`."""

    def __init__(self, task: str | None):
        super().__init__(daemon=True)
        self.task, self.began = task, time.monotonic()
        self.heard = self.spoken = self.began
        self.ended = threading.Event()

    def run(self) -> None:
        from tqdm import tqdm  # which asks when it is imported whether bars are drawn at all

        while not self.ended.wait(POLL):
            now = time.monotonic()
            if self.task is not None and now - self.heard >= QUIET:
                spoken = self.spoken
                tqdm.write(self._sign(now), file=sys.stderr)
                self.spoken = spoken

    def _sign(self, now: float) -> str:
        """What is being done; once the command has said something else after that, for how long it has been silent."""
        if self.spoken > self.began:
            return f"still busy with that ({now - self.spoken:.0f} s)"
        return f"still {self.task} ({now - self.began:.0f} s)" if now - self.began >= QUIET / 2 else f"{self.task} ..."

    def listen(self, stream: Any) -> None:
        """Hear from now on when a text stream is written to. The stream stays the same object: others look at it."""
        write = stream.write

        def heard(text: str) -> int:
            self.heard = self.spoken = time.monotonic()
            return write(text)

        stream.write = heard


_heart: _Heart | None = None


@contextmanager
def heartbeat(task: str) -> Iterator[None]:
    """While entered, no more than :data:`QUIET` seconds pass without a line, on standard error, about a task."""
    global _heart
    if _heart is not None:
        doing(task)
        yield
        return
    _heart = _Heart(task)
    streams: set[Any] = {sys.stdout, sys.stderr}
    for stream in streams:
        _heart.listen(stream)
    _heart.start()
    try:
        yield
    finally:
        _heart.ended.set()
        _heart = None
        for stream in streams:
            del stream.write


def doing(task: str | None) -> None:
    """What is being done from now on, as it follows ``still`` in the next sign of life; None: nothing but waiting for a
    person. Without a :func:`heartbeat` it does nothing.
    """
    if _heart is not None:
        _heart.task, _heart.began = task, time.monotonic()
