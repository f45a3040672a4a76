"""Steps that are simulated as they are made: the history, the rollouts that are remembered, and who waits for whom."""

import threading
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from pacnerf_lpo.errors import SimulationError, Stopped, UserInputError
from pacnerf_lpo.explore.catalogue import Catalogue
from pacnerf_lpo.explore.records import Resolution, Step
from pacnerf_lpo.explore.simulate import Simulated, errors_of, out_of_sight, simulate
from pacnerf_lpo.identification.processes import Progress, processes
from pacnerf_lpo.mpm.runtime import stoppable

KEPT = 6
"""Rollouts that are remembered; others are simulated again when they are looked at."""
LINGER = 3600.0
"""Seconds for which processes wait for the next question: each needs ten to begin."""
ENDING = 30.0
"""Seconds to wait for the end of what was stopped: its longest part between two looks takes ten on a slow machine."""
NOTICED = 0.02
"""Share of the measured outlines and points that a model may lose sight of without a word."""
LOST = "the body is out of sight"
warnings.filterwarnings("ignore", ".*still being processed by the workers have been cancelled")  # as a stop means to


class Stepper:
    """The steps of a session. Changes are made one after the other, each stops a refinement; looking waits for none.
    Questions are answered in ``jobs`` processes.
    """

    def __init__(self, catalogue: Catalogue, jobs: int | None):
        self.catalogue, self.problem, self.history = catalogue, catalogue.problem, History()
        self._jobs = jobs if self.problem.deforms else jobs or 1
        self._changing, self._looking, self._working = threading.RLock(), threading.RLock(), threading.Lock()
        self._generation, self._stop, self._yielding = 0, threading.Event(), False
        self._rolled: OrderedDict[tuple, Simulated] = OrderedDict()
        self._hand: tuple[int, tuple[str, ...]] | None = None

    @contextmanager
    def change(self) -> Iterator[None]:
        """While entered, no other thread changes anything."""
        self._generation += 1
        with self._changing:
            yield

    def take(self, step: Step) -> Step:
        """Put a step into the history and simulate it on the coarse body; one that is unstable stays there with the
        reason.
        """
        with self._changing:
            return self._coarse(self.history.add(step))

    def drag(self, step: Step, keys: tuple[str, ...]) -> Step:
        """The same for a hand that moves these settings: in the place of the current step where it made that, too."""
        with self._changing:
            current = self.history.current
            if self._hand == (current.number, keys) and current.number == len(self.history.steps) - 1:
                found = self._coarse(replace(step, number=current.number, parent=current.parent))
            else:
                found = self.take(step)
            self._hand = found.number, keys
            return found

    def adopt(self, step: Step) -> Step:
        """Put a step that was found on the fine body into the history. Raises SimulationError."""
        with self.change():
            found = self.rolled(step, "refined")
            return self._kept(self.history.add(step), found)

    def refine(self, step: Step) -> Step:
        """Simulate a step on the fine body; it stays as it is where a change comes meanwhile, or that is unstable."""
        if step.resolution == "refined" or step.trouble is not None:
            return step
        begun = self._generation
        try:
            with stoppable(lambda: self._generation != begun):
                found = self.rolled(step, "refined")
        except Stopped:
            return step
        except SimulationError as error:
            note = f"on the fine body the motion is unstable ({error}); a larger physics.substep_rate may mend that"
            with self._changing:
                if self._generation != begun:
                    return step
                table = self.history.tables.get(step.number)
                return self.history.update(replace(step, notes=(*step.notes, note)), table)
        with self._changing:
            return step if self._generation != begun else self._kept(step, found)

    def simulated(self, step: Step) -> Simulated:
        """The rollout of a step as it was simulated last. Raises UserInputError where it is unstable."""
        if step.trouble is not None:
            raise UserInputError(f"explore: step {step.number}, {step.name}, has no motion: {step.trouble}")
        try:
            return self.rolled(step, step.resolution)
        except SimulationError as error:
            raise UserInputError(f"explore: step {step.number}, {step.name}, has no motion: {error}") from error

    def rolled(self, step: Step, resolution: Resolution) -> Simulated:
        """The rollout of a step, remembered by its effects and values. Raises SimulationError."""
        key = step.effects, tuple(step.values.items()), resolution
        with self._looking:
            found = self._rolled.get(key)
        if found is None:
            found = simulate(self.problem, self.catalogue.chosen(step.effects), step.values, resolution)
        with self._looking:
            self._rolled[key] = found
            self._rolled.move_to_end(key)
            while len(self._rolled) > KEPT:
                self._rolled.popitem(last=False)
        return found

    @contextmanager
    def job(self, progress: Progress, stop: Callable[[], bool], yielding: bool = False) -> Iterator[Progress]:
        """The one question that is being answered, with a progress that raises ``Stopped`` when the answer is not
        wanted any more; one that is ``yielding`` is stopped by the next one. Raises UserInputError where there is one
        already.
        """
        if not self._working.acquire(blocking=False):
            if not self._yielding:
                raise UserInputError("explore: another question is being answered; wait for it, or stop it first")
            self._stop.set()
            self._working.acquire()
        self._yielding = yielding

        def unwanted() -> bool:
            return self._stop.is_set() or stop()

        def report(text: str) -> None:
            if unwanted():
                raise Stopped("stopped")
            progress(text)

        try:
            self._stop.clear()
            with stoppable(unwanted), processes(self._jobs, LINGER):
                yield report
        finally:
            self._yielding = False
            self._working.release()

    def stop(self) -> None:
        """Stop the question that is being answered."""
        self._stop.set()

    @property
    def busy(self) -> bool:
        """Whether a question is being answered."""
        return self._working.locked()

    def close(self) -> None:
        """Stop everything, wait until the question that is being answered has ended, and forget all rollouts: processes
        that still got work while Python ends would complain.
        """
        self._stop.set()
        self._generation += 1
        if self._working.acquire(timeout=ENDING):
            self._working.release()
        with self._looking:
            self._rolled.clear()

    def _coarse(self, step: Step) -> Step:
        try:
            return self._kept(step, self.rolled(step, "coarse"))
        except SimulationError as error:
            return self.history.update(replace(step, trouble=str(error)), None)

    def _kept(self, step: Step, found: Simulated) -> Step:
        """A step of the history with the errors of its rollout."""
        errors, lost = errors_of(self.problem, found), out_of_sight(self.problem, found)
        notes = tuple(note for note in step.notes if not note.startswith(LOST))
        if lost > NOTICED:
            notes = (*notes, f"{LOST} in {lost:.0%} of what was measured; its error does not count there")
        made = replace(step, resolution=found.resolution, fitted=errors.fitted, held_out=errors.held_out)
        return self.history.update(replace(made, trouble=None, notes=notes), errors.table)


class History:
    """Steps in the order in which they were made. One thread at a time may change it, see :meth:`Stepper.change`; as
    steps are added or replaced and never taken away, others may read it meanwhile.

    steps: all of them.
    tables: errors of every row and frame of the steps that could be simulated, by number [(R, F), float32]
    """

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._undone: list[int] = []
        self._current = 0
        self.tables: dict[int, np.ndarray] = {}

    @property
    def current(self) -> Step:
        """The one that the model stands at."""
        return self.steps[self._current]

    def step(self, number: int | None) -> Step:
        """By its number; the current one when None. Raises UserInputError."""
        if number is None:
            return self.current
        whole = isinstance(number, (int, np.integer)) and not isinstance(number, bool)
        if not whole or not 0 <= number < len(self.steps):
            raise UserInputError(f"explore: there is no step {number}; give 0 to {len(self.steps) - 1}")
        return self.steps[int(number)]

    def add(self, step: Step) -> Step:
        """Take a step in, with the next number, and go to it."""
        step = replace(step, number=len(self.steps))
        self.steps.append(step)
        self._current, self._undone = step.number, []
        return step

    def update(self, step: Step, table: np.ndarray | None) -> Step:
        """Put a step in the place of the one with its number."""
        self.steps[step.number] = step
        if table is None:
            self.tables.pop(step.number, None)
        else:
            self.tables[step.number] = table.astype(np.float32)
        return step

    def go(self, number: int) -> Step:
        """Make a step the current one."""
        step = self.step(number)
        if step.number != self._current:
            self._undone.clear()
        self._current = step.number
        return step

    def undo(self) -> Step:
        """Go back to what the current step was made from. Raises UserInputError at the first."""
        step = self.current
        if step.parent is None:
            raise UserInputError("explore: nothing to undo: this is the first step")
        self._undone.append(step.number)
        self._current = step.parent
        return self.current

    def redo(self) -> Step:
        """Go on to what was undone last. Raises UserInputError where nothing was."""
        if not self._undone:
            raise UserInputError("explore: nothing to redo")
        self._current = self._undone.pop()
        return self.current

    def restore(self, steps: list[Step], current: int, tables: dict[int, np.ndarray]) -> None:
        """Take over the steps of a saved session. Raises LookupError where its current step is none of them."""
        self.steps, self._current, self._undone = steps, steps[current].number, []
        self.tables = tables
