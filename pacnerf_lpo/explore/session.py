"""A session: a model that is changed step by step, and simulated at once, next to what was measured."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.diagnosis.overlay import overlay
from pacnerf_lpo.diagnosis.plan import Proposal
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore import asking, fitting, pictures, saving, suggesting
from pacnerf_lpo.explore.catalogue import Catalogue, with_effect, with_values, without_effect
from pacnerf_lpo.explore.noise import Noise
from pacnerf_lpo.explore.records import Difference, EffectInfo, Errors, Setting, Step, Suggestion
from pacnerf_lpo.explore.simulate import errors_of
from pacnerf_lpo.explore.source import Source, open_source
from pacnerf_lpo.explore.stepping import Stepper
from pacnerf_lpo.explore.views import Views
from pacnerf_lpo.identification.processes import Progress, workers
from pacnerf_lpo.manifest import write_atomically


class Session(Views):
    """The model of a run, changed by hand or by a script.

    Every change is a :class:`Step` of a history that is never shortened. All methods may be called from several
    threads: changes are made one after the other, and one of ``suggest``, ``fit``, ``diagnose`` and ``plan`` runs at a
    time, while settings can still be changed.

    Values are in SI units, errors in :attr:`unit`. Of several recordings of one object, the motion, the cameras and the
    pictures are asked for by the name or the number of the recording.

    Example:
        >>> session = Session.open("runs/demo_missing")  # doctest: +SKIP
        >>> session.set("drag", 1.5).held_out  # doctest: +SKIP
    """

    def __init__(self, source: Source, listed: str | None = None, jobs: int | None = None):
        """Use :meth:`open`. Raises UserInputError, SimulationError."""
        super().__init__(source.problem)
        self.source, self.problem = source, source.problem
        self.listed = listed or source.options.candidates
        self.catalogue = Catalogue(self.problem, self.listed)
        self.stepper = Stepper(self.catalogue, jobs)
        self.history = self.stepper.history
        self.noise = Noise(source, self.catalogue)

    @classmethod
    def open(
        cls,
        source: str | Path | Sequence[str | Path],
        phase: str | None = None,
        candidates: str | None = None,
        options: Options | None = None,
        jobs: int | None = None,
    ) -> "Session":
        """Open a run, its scene, the folder of a study, several runs or scenes of one object, scenes of measured
        flights, or a saved session.

        The first step is the model as the run identified it. Where a diagnosis of it is stored, a second step is the
        model as that has fitted it, with intervals.

        Args:
            source: folder or folders.
            phase: stem of a finished phase, such as ``01_velocity``; the last before a correction when not given.
            candidates: YAML list of effects of one's own, in addition to the catalogue.
            options: of diagnoses; those of the stored one, or the usual ones, when not given.
            jobs: processes of suggestions and fits; as many as torch may use threads, at most 8, when not given.

        Raises:
            UserInputError: nothing can be opened there.
            SimulationError: the motion that the run identified is unstable.
        """
        given = [source] if isinstance(source, (str, Path)) else list(source)
        if len(given) == 1 and (Path(given[0]) / saving.FILE).is_file():
            return saving.reopen(cls, Path(given[0]), jobs)
        return cls.of(open_source(given, phase, options), candidates, jobs)

    @classmethod
    def of(cls, source: Source, candidates: str | None = None, jobs: int | None = None) -> "Session":
        """Begin with a source that was read; arguments and errors as of :meth:`open`."""
        session = cls(source, candidates, jobs)
        base, installed = dict(session.catalogue.base), session.catalogue.installed
        first = Step(0, None, "as the run has it", "open", base, installed, source.intervals)
        session.stepper.rolled(first, "coarse")  # raises where the motion is unstable
        session.stepper.take(first)
        stored = session.noise.first
        if stored is not None:
            title, known, notes = "as diagnose fitted it", dict(stored.comparison.known), stored.comparison.notes
            session.stepper.take(Step(0, 0, title, "diagnose", known, stored.effects, stored.intervals, notes=notes))
        return session

    # What there is

    @property
    def name(self) -> str:
        """Of the scene, or of the recordings."""
        return self.problem.scene

    @property
    def folder(self) -> Path:
        """Where a session of this source is kept where nobody says otherwise: in the run, or next to the study."""
        return self.source.store.folder.parent / "explore"

    @property
    def unit(self) -> str:
        """Of all errors: ``px``, or ``mm`` where only points were measured."""
        return self.problem.unit[0]

    @property
    def steps(self) -> tuple[Step, ...]:
        """The history, in the order in which it was made."""
        return tuple(self.history.steps)

    @property
    def current(self) -> Step:
        """The step that the model stands at."""
        return self.history.current

    @property
    def settings(self) -> list[Setting]:
        """Every number that can be changed: material, motion, ground, and the coefficients of all effects."""
        return self.catalogue.settings(self.current)

    @property
    def effects(self) -> list[EffectInfo]:
        """Every effect that the model has or could have."""
        return self.catalogue.infos(self.current.effects)

    # Changes

    def set(self, name: str | Mapping[str, float], value: float | None = None, dragging: bool = False) -> Step:
        """Change one or several settings; simulated at once on the coarse body.

        A coefficient of an effect that the model has not adds the effect, unless the value is that at which it
        vanishes.

        Args:
            name: of a setting, or values by name [SI].
            value: of the one setting [SI].
            dragging: a hand is still moving: where the current step was made so too, of the same settings, the new one
                takes its place in the history.

        Raises:
            UserInputError: no such setting, not a number, NaN, or out of bounds; nothing is changed then.
        """
        wanted = dict(name) if isinstance(name, Mapping) else {name: value}
        if not wanted:
            raise UserInputError("explore: give at least one setting to change")
        checked = {key: self.catalogue.check(key, number) for key, number in wanted.items()}  # type: ignore[arg-type]
        with self.stepper.change():
            made = with_values(self.catalogue, self.current, checked)
            return self.stepper.drag(made, tuple(checked)) if dragging else self.stepper.take(made)

    def add(self, effect: str, values: Mapping[str, float] | None = None) -> Step:
        """Add an effect to the model: at given values, or where it vanishes.

        Args:
            effect: its name, such as ``LinearDrag``; the class path of one's own, such as ``lorentz.Lorentz``, which
                joins the catalogue.
            values: of its coefficients [SI]; the others vanish.

        Raises:
            UserInputError: no such effect or coefficient, a value out of bounds, an effect that the model has already,
                or a second one of a kind of which a model has one.
        """
        if "." in effect and effect not in self.catalogue.effects:
            effect = self.catalogue.declare(effect)
        own = self.catalogue.effect(effect)
        for key in values or {}:
            if key not in own.parameters:
                raise UserInputError(f"explore: {effect} has no {key}; it has {', '.join(own.parameters)}")
        checked = {key: self.catalogue.check(key, number) for key, number in (values or {}).items()}
        with self.stepper.change():
            return self.stepper.take(with_effect(self.catalogue, self.current, effect, checked))

    def remove(self, effect: str) -> Step:
        """Take an effect out of the model. Raises UserInputError where the model has it not."""
        with self.stepper.change():
            return self.stepper.take(without_effect(self.catalogue, self.current, effect))

    def undo(self) -> Step:
        """Go back to what the current step was made from. Raises UserInputError at the first step."""
        with self.stepper.change():
            return self.history.undo()

    def redo(self) -> Step:
        """Go on to what was undone last. Raises UserInputError where nothing was, or something was changed since."""
        with self.stepper.change():
            return self.history.redo()

    def go_to(self, number: int) -> Step:
        """Make any step of the history the current one. Raises UserInputError."""
        with self.stepper.change():
            return self.history.go(number)

    def refine(self, number: int | None = None) -> Step:
        """Simulate a step on the fine body; None: the current one.

        A change that is made meanwhile stops it; the step then stays as it was, and so does one whose fine motion is
        unstable, with the reason.
        """
        return self.stepper.refine(self.history.step(number))

    # Looking

    def error(self, number: int | None = None) -> Errors:
        """How far a step is from the measurement, by row and frame, see :class:`Errors`; None: the current step. Raises
        UserInputError where there is no such step, or its motion is unstable.
        """
        step = self.history.step(number)
        found = self.stepper.simulated(step)
        return errors_of(self.problem, found, self.noise.floor(step))

    def picture(
        self, camera: int, frame: int, number: int | None = None, recording: str | int = 0, side: int = 300
    ) -> np.ndarray:
        """The measured body with its outline and the model's; on its right, smaller, the model and the residual
        [0..255, (side, W, 3), uint8]; as :meth:`outlines`.
        """
        number = self.history.step(number).number
        seen, motion = self.outlines(camera, frame, number, recording), self.motion(number, recording)
        eye = next(one for one in self.cameras(recording) if one.view == camera)
        drawn = pictures.drawing(motion.positions[frame], motion.colours, motion.size, seen.model, eye)
        return pictures.triptych(seen, drawn, side, close=True)

    def compare(self, before: int, after: int) -> Difference:
        """Two steps compared. Raises UserInputError where there is no such step."""
        a, b = self.history.step(before), self.history.step(after)
        names = [name for name in {**a.values, **b.values} if a.values.get(name) != b.values.get(name)]
        changed = {name: (a.values.get(name), b.values.get(name)) for name in names}
        none = np.full(self.problem.usable.shape[:2], np.nan)
        first, second = (self.history.tables.get(step.number, none).astype(float) for step in (a, b))
        errors = (a.fitted, b.fitted), (a.held_out, b.held_out)
        return Difference(a.number, b.number, changed, *errors, self.unit, second - first)

    # Questions

    def prepare(self, progress: Progress = lambda _: None, stop: Callable[[], bool] = lambda: False) -> None:
        """Make the first answers quick, in the background of a session that was just opened: start the processes, let
        them compile the kernels of all effects, and learn what the residual may be where nothing is missing, which
        suggestions and intervals need, unless that is known for a model with these effects. The next question stops it.
        Raises as :meth:`suggest`.
        """
        with self.stepper.job(progress, stop, yielding=True) as report:
            self.noise.learn(self.current, report)
            suggesting.warm(self.stepper, report, workers())

    def suggest(
        self, most: int = 10, progress: Progress = lambda _: None, stop: Callable[[], bool] = lambda: False
    ) -> list[Suggestion]:
        """What would help? Every effect of the catalogue is added to the current model, by one simulation for each of
        its probes, and scored by how well that explains what its parameters cannot; those that could be the best are
        fitted. All on the coarse body: a diagnosis decides. Best first.

        Args:
            most: so many are returned.
            progress: receives a line about each step.
            stop: asked again and again whether the answer is still wanted.

        Raises:
            Stopped: it is not, or :meth:`stop` was called.
            SimulationError: the current motion is unstable.
            UserInputError: another question is being answered.
        """
        with self.stepper.job(progress, stop) as report:
            return suggesting.suggest(self.stepper, self.noise, report)[:most]

    def fit(
        self, names: Sequence[str], progress: Progress = lambda _: None, stop: Callable[[], bool] = lambda: False
    ) -> Step:
        """Identify some settings by the fitted views and frames, all others held; a step with 90 % intervals.

        Args:
            names: of settings that ``fitted`` says can be identified.
            progress, stop: as for :meth:`suggest`.

        Raises:
            Stopped: it was stopped; the best values so far are a step of their own.
            SimulationError: the current motion is unstable.
            UserInputError: no such settings, or another question is being answered.
        """
        fitting.check(self.stepper, names)
        with self.stepper.job(progress, stop) as report:
            return fitting.fit(self.stepper, self.noise, list(names), report)

    def diagnose(
        self, progress: Progress = lambda _: None, stop: Callable[[], bool] = lambda: False
    ) -> tuple[Step, list[str]]:
        """Run the whole diagnosis of what was opened, as ``pacnerf-lpo diagnose`` does, write its results where that
        writes them, and take its model over as a step; minutes, and it goes on where it was stopped. Returns the step,
        and the sentences of the verdict. Raises as :meth:`suggest`.
        """
        with self.stepper.job(progress, stop) as report:
            return asking.diagnose(self.stepper, self.noise, report)

    def plan(self, progress: Progress = lambda _: None, stop: Callable[[], bool] = lambda: False) -> list[Proposal]:
        """Which recording to make next: those that would separate what the diagnosis could not, best first, with what
        to do in ``words``.

        Raises:
            UserInputError: the diagnosis names one cause or none, or only flights were measured.
            Stopped, SimulationError: as :meth:`suggest`.
        """
        with self.stepper.job(progress, stop) as report:
            return asking.plan(self.source, report)

    def stop(self) -> None:
        """Stop the question that is being answered, if there is one; it raises ``Stopped`` where it was asked."""
        self.stepper.stop()

    @property
    def busy(self) -> bool:
        """Whether a question is being answered."""
        return self.stepper.busy

    # Keeping

    def save(self, folder: str | Path) -> Path:
        """Write the session, with its whole history, so that :meth:`open` goes on with it; returns its file."""
        return saving.save(self, Path(folder))

    def overlay(self, number: int | None = None, recording: str | int = 0) -> str:
        """A step as a configuration that ``fit`` and ``diagnose`` take after that of the run."""
        step = self.history.step(number)
        part = self.problem.parts(self.catalogue.chosen(step.effects), step.values)[self._number(recording)]
        return overlay(part.recording, part.effects, part.known)

    def save_overlay(self, path: str | Path, number: int | None = None, recording: str | int = 0) -> Path:
        """Write :meth:`overlay` into a file; returns it."""
        write_atomically(Path(path), self.overlay(number, recording).encode())
        return Path(path)

    def report(self, folder: str | Path, number: int | None = None, progress: Progress = lambda _: None) -> Path:
        """Write a page that shows a step and the first one, as a diagnosis shows a model before and after: the video
        next to both, errors by camera and frame, and every parameter; returns the page.

        Args:
            folder: where the page and what it is made of go.
            number: of the step; None: the current one.
            progress: receives a line about each step.

        Raises:
            SimulationError, UserInputError: a motion is unstable, or a question is being answered.
        """
        step = self.history.step(number)
        self.stepper.simulated(step)
        with self.stepper.job(progress, lambda: False) as report:
            return asking.report(self.stepper, self.noise, Path(folder), step, report)

    def close(self) -> None:
        """Stop what is being answered and forget rollouts. The history can still be read and saved."""
        self.stepper.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
