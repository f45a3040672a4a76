"""Some settings identified from the current model, all others held."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pacnerf_lpo.diagnosis.comparison import CONFIDENCE, in_si, reporter
from pacnerf_lpo.errors import SimulationError, Stopped, UserInputError
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.identification.base_fit import at_probes, notes, priors
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import Fit
from pacnerf_lpo.identification.least_squares import fit as descend
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.standardised import StandardisedObjective
from pacnerf_lpo.inference.intervals import posterior_intervals, spread_along
from pacnerf_lpo.inference.noise import NoiseModel

if TYPE_CHECKING:
    from pacnerf_lpo.explore.session import Session

ITERATIONS = 12
"""As the refits of a diagnosis."""


class Some:
    """An objective of the coordinates at ``places``, all others held where ``full`` has them [(K,)]; other processes
    get a copy.
    """

    def __init__(self, objective: StandardisedObjective, full: np.ndarray, places: Sequence[int]):
        self.objective, self.full, self.places = objective, full, list(places)

    def all(self, some: np.ndarray) -> np.ndarray:
        """All coordinates [(K,)]"""
        found = self.full.copy()
        found[self.places] = some
        return found

    def __call__(self, some: np.ndarray) -> np.ndarray:
        """Rows of the objective. Raises SimulationError."""
        return self.objective(self.all(some))


def check(session: "Session", names: Sequence[str]) -> None:
    """Raise UserInputError where these settings cannot be identified in the current model."""
    if not names:
        raise UserInputError("explore: tick at least one setting to fit")
    step = session.current
    for name in names:
        owner = session.catalogue.owner(name)
        if owner is not None and owner not in step.effects:
            raise UserInputError(f"explore: {name} belongs to {owner}, which the model has not; add it first")
        if name not in session.catalogue.free:
            raise UserInputError(f"explore: {name} is known in this run and is not identified; set it by hand")
    if len(set(names)) < len(names):
        raise UserInputError("explore: a setting is ticked twice")


def fit(session: "Session", step: Step, names: list[str], progress: Progress) -> Step:
    """Identify settings by Levenberg-Marquardt on the fine body; a step with intervals, or, where it is stopped, with
    the best values so far.

    Residuals, noise and priors are those of a diagnosis. An effect without a gradient at its null, which stands there,
    starts at its probes.

    Raises:
        SimulationError, Stopped: as :meth:`Session.fit`.
    """
    problem, effects = session.problem, session.catalogue.chosen(step.effects)
    noise = session.noise.of(step, progress).comparison.noise(problem, problem.fitted)
    model = problem.model(effects, step.values)
    mean, deviation = priors(problem, model)
    objective = StandardisedObjective(problem, model, problem.fitted, noise, mean, deviation)
    places = [model.names.index(name) for name in names]
    bounds = model.bounds[0][places], model.bounds[1][places]
    latest: list[np.ndarray] = []
    tell = reporter(model, progress)
    best: Fit | None = None
    title, unstable = f"fit of {', '.join(names)}", None
    try:
        for start in at_probes(model, [effect for effect in effects if set(effect.parameters) <= set(names)]):
            some = Some(objective, start, places)

            def report(iteration: int, cost: float, free: np.ndarray, some: Some = some) -> None:
                latest[:] = [some.all(free)]
                tell(iteration, cost, latest[0])

            begin = np.clip(start[places], *bounds)
            try:
                found = descend(some, begin, model.scales[places], bounds, ITERATIONS, report, rows=objective.rows)
            except SimulationError as error:
                unstable = error
                continue
            if best is None or found.cost_of(objective.rows) < best.cost_of(objective.rows):
                best, whole = found, some.all(found.free)
    except Stopped:
        if latest:
            _taken(session, step, model, latest[0], names, f"{title}, stopped", {}, ())
        raise
    if best is None:
        assert unstable is not None
        raise unstable
    ends = _intervals(problem, objective, noise, model, best, places, deviation)
    doubts = tuple(notes(model, whole, mean, deviation))
    return _taken(session, step, model, whole, names, title, ends, doubts)


def _taken(
    session: "Session",
    step: Step,
    model: Model,
    free: np.ndarray,
    names: Sequence[str],
    title: str,
    ends: dict[str, tuple[float, float]],
    doubts: tuple[str, ...],
) -> Step:
    known = model.physical(free)
    values = {**step.values, **{name: known[name] for name in names}}
    intervals = {**step.intervals, **ends}
    return session.stepper.adopt(Step(0, step.number, title, "fit", values, step.effects, intervals, notes=doubts))


def _intervals(
    problem: Problem,
    objective: StandardisedObjective,
    noise: NoiseModel,
    model: Model,
    best: Fit,
    places: Sequence[int],
    deviation: np.ndarray,
) -> dict[str, tuple[float, float]]:
    """90 % intervals of what was identified [SI], all else held; none of what the data do not determine."""
    assert best.jacobian is not None
    own, fitted = deviation[list(places)], problem.fitted
    residual, jacobian = objective.seen(best)
    along = spread_along(noise, residual[fitted], np.nan_to_num(jacobian[fitted]) * own)
    names = [model.names[place] for place in places]
    standardised = best.jacobian[: int(fitted.sum())] * own
    dof = len(noise.replicates) - 1
    found, _ = posterior_intervals(standardised, along, best.free.tolist(), names, own.tolist(), CONFIDENCE, dof)
    return {one.name: (one.low, one.high) for one in (in_si(model, i) for i in found) if one.identifiable}
