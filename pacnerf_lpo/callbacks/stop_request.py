"""SIGINT and SIGTERM as a request that a phase honours at the end of its optimiser step, or within seconds."""

import contextlib
import os
import select
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any, NoReturn

import psutil

from pacnerf_lpo.errors import Interrupted

INTERRUPTED = 130
"""Exit status of a command that was interrupted."""
SIGNALS = (signal.SIGINT, signal.SIGTERM)
PATIENCE = 2.5
"""Seconds that an optimiser step has to end in before it is given up. The last checkpoint, at most a step or
``outer_loop.checkpoint_seconds`` old, is what the run goes on from."""
AT_LATEST = 4.5
"""Seconds after which the process ends whatever it does: code that is not Python, such as a kernel being compiled,
does not hear of signals. All that a run leaves on disk is whole at any moment."""


class StopRequest:
    """While entered, turns SIGINT and SIGTERM into :class:`Interrupted`.

    Inside a phase (``deferred`` is True) the first signal only sets ``requested``: the phase finishes its optimiser
    step, writes a checkpoint and raises. After :data:`PATIENCE` it raises without that. A second signal, or one outside
    a phase, raises at once.
    """

    def __init__(self) -> None:
        self.deferred = False
        self.requested = False

    def __enter__(self) -> "StopRequest":
        self._ears, self._mouth = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._wakeup = signal.set_wakeup_fd(self._mouth, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, daemon=True).start()
        self._previous = self.listen()
        return self

    def listen(self) -> dict[int, Any]:
        """Take the signals from whoever had them, and return who that was.

        A trainer that begins to fit puts its own handler before this one, and where the signal comes between two
        batches ends the program with status 0.
        """
        return {number: signal.signal(number, self._handle) for number in (*SIGNALS, signal.SIGALRM)}

    def __exit__(self, *exception: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._previous.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup)
        os.close(self._mouth)  # ends the watch

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.deferred and not self.requested:
            self.requested = True
            signal.setitimer(signal.ITIMER_REAL, PATIENCE)
            print("\nstopping after this optimiser step; once more to stop at once", file=sys.stderr, flush=True)
            return
        raise Interrupted

    def _watch(self) -> None:
        """End the process, and the processes that it started, where nothing else has within :data:`AT_LATEST`."""
        deadline: float | None = None
        while True:
            left = None if deadline is None else max(deadline - time.monotonic(), 0.0)
            if not select.select([self._ears], [], [], left)[0]:
                print("stopped", file=sys.stderr)
                end_at_once()
            numbers = os.read(self._ears, 64)
            if not numbers:
                break
            if deadline is None and any(number in SIGNALS for number in numbers):
                deadline = time.monotonic() + AT_LATEST
        os.close(self._ears)


def end_at_once() -> NoReturn:
    """End the process and those that it started, with status 130, without waiting for what libraries do then."""
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.NoSuchProcess):
            child.kill()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(INTERRUPTED)
