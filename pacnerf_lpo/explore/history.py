"""The steps of a session: never removed, with one that is current, undo and redo."""

import threading
from dataclasses import replace

import numpy as np

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore.records import Step


class History:
    """Steps in the order in which they were made. All methods may be called from several threads.

    tables: errors of every row and frame of the steps that could be simulated, by number [(R, F), float32]
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._steps: list[Step] = []
        self._undone: list[int] = []
        self._current = 0
        self.tables: dict[int, np.ndarray] = {}

    @property
    def steps(self) -> tuple[Step, ...]:
        """All of them."""
        with self._lock:
            return tuple(self._steps)

    @property
    def current(self) -> Step:
        """The one that the model stands at."""
        with self._lock:
            return self._steps[self._current]

    def step(self, number: int | None) -> Step:
        """By its number; the current one when None. Raises UserInputError."""
        with self._lock:
            if number is None:
                return self._steps[self._current]
            whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
            if not whole or not 0 <= number < len(self._steps):
                raise UserInputError(f"explore: there is no step {number}; give 0 to {len(self._steps) - 1}")
            return self._steps[int(number)]

    def add(self, step: Step, table: np.ndarray | None) -> Step:
        """Take a step in, with the next number, and go to it."""
        with self._lock:
            step = replace(step, number=len(self._steps))
            self._steps.append(step)
            self._current, self._undone = step.number, []
            self._keep(step, table)
            return step

    def update(self, step: Step, table: np.ndarray | None) -> Step:
        """Put a step in the place of the one with its number."""
        with self._lock:
            self._steps[step.number] = step
            self._keep(step, table)
            return step

    def go(self, number: int) -> Step:
        """Make a step the current one."""
        with self._lock:
            step = self.step(number)
            if step.number != self._current:
                self._undone.clear()
            self._current = step.number
            return step

    def undo(self) -> Step:
        """Go back to what the current step was made from. Raises UserInputError at the first."""
        with self._lock:
            step = self._steps[self._current]
            if step.parent is None:
                raise UserInputError("explore: nothing to undo: this is the first step")
            self._undone.append(step.number)
            self._current = step.parent
            return self._steps[self._current]

    def redo(self) -> Step:
        """Go on to what was undone last. Raises UserInputError where nothing was."""
        with self._lock:
            if not self._undone:
                raise UserInputError("explore: nothing to redo")
            self._current = self._undone.pop()
            return self._steps[self._current]

    def snapshot(self) -> tuple[list[Step], int]:
        """All steps and the number of the current one, of the same moment."""
        with self._lock:
            return list(self._steps), self._current

    def restore(self, steps: list[Step], current: int, tables: dict[int, np.ndarray]) -> None:
        """Take over the steps of a saved session. Raises LookupError where its current step is none of them."""
        with self._lock:
            self._steps, self._current, self._undone = list(steps), steps[current].number, []
            self.tables = {number: table.astype(np.float32) for number, table in tables.items()}

    def _keep(self, step: Step, table: np.ndarray | None) -> None:
        if table is None:
            self.tables.pop(step.number, None)
        else:
            self.tables[step.number] = table.astype(np.float32)
