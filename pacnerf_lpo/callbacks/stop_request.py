"""SIGINT and SIGTERM as a request that a phase honours once its optimiser step is complete."""

from __future__ import annotations

import signal
import sys
from types import FrameType
from typing import Any

from pacnerf_lpo.errors import Interrupted

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """While entered, turns SIGINT and SIGTERM into :class:`Interrupted`.

    Inside a phase (``deferred`` is True) the first signal only sets ``requested``: the phase finishes its optimiser
    step, writes a checkpoint and raises. A second signal, or one outside a phase, raises at once.
    """

    def __init__(self) -> None:
        self.deferred = False
        self.requested = False
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> StopRequest:
        self._previous = self.listen()
        return self

    def listen(self) -> dict[int, Any]:
        """Take the signals from whoever had them, and return who that was.

        A trainer that begins to fit puts its own handler before this one, and where the signal comes between two
        batches ends the program with status 0.
        """
        return {number: signal.signal(number, self._handle) for number in SIGNALS}

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.deferred and not self.requested:
            self.requested = True
            print("\nstopping after this optimiser step; once more to stop at once", file=sys.stderr, flush=True)
            return
        raise Interrupted
