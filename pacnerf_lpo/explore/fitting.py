"""Some settings identified from the current model, all others held."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pacnerf_lpo.diagnosis.comparison import intervals_in_si, reporter
from pacnerf_lpo.errors import SimulationError, Stopped, UserInputError
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.identification.base_fit import at_probes, notes
from pacnerf_lpo.identification.least_squares import Effort, Fit
from pacnerf_lpo.identification.least_squares import fit as descend
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.standardised import Held, StandardisedObjective
from pacnerf_lpo.inference.intervals import spread_along

if TYPE_CHECKING:
    from pacnerf_lpo.explore.session import Session

ITERATIONS = 12
"""As the refits of a diagnosis."""


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
    the best values so far. Raises as :meth:`Session.fit`.

    Residuals, noise and priors are those of a diagnosis. An effect without a gradient at its null, which stands there,
    starts at its probes.
    """
    problem, effects = session.problem, session.catalogue.chosen(step.effects)
    noise = session.noise.of(step, progress).comparison.noise(problem, problem.fitted)
    model = problem.model(effects, step.values)
    objective = StandardisedObjective(problem, model, problem.fitted, noise)
    places = [model.names.index(name) for name in names]
    bounds = model.bounds[0][places], model.bounds[1][places]
    latest: list[np.ndarray] = []
    tell = reporter(model, progress)
    best: Fit | None = None
    title, unstable = f"fit of {', '.join(names)}", None

    def taken(free: np.ndarray, called: str, ends: dict[str, tuple[float, float]], doubts: Sequence[str] = ()) -> Step:
        known = model.physical(free)
        values, intervals = {**step.values, **{name: known[name] for name in names}}, {**step.intervals, **ends}
        made = Step(0, step.number, called, "fit", values, step.effects, intervals, notes=tuple(doubts))
        return session.stepper.adopt(made)

    try:
        for start in at_probes(model, [effect for effect in effects if set(effect.parameters) <= set(names)]):
            some = Held(objective, start, places)

            def report(iteration: int, cost: float, free: np.ndarray, some: Held = some) -> None:
                latest[:] = [some.all(free)]
                tell(iteration, cost, latest[0])

            begin, effort = np.clip(start[places], *bounds), Effort(ITERATIONS)
            try:
                found = descend(some, begin, model.scales[places], bounds, effort, report, objective.rows)
            except SimulationError as error:
                unstable = error
                continue
            if best is None or found.cost_of(objective.rows) < best.cost_of(objective.rows):
                best, whole = found, some.all(found.free)
    except Stopped:
        if latest:
            taken(latest[0], f"{title}, stopped", {})
        raise
    if best is None:
        assert unstable is not None
        raise unstable
    ends = _intervals(problem, objective, best, places)
    return taken(whole, title, ends, notes(model, whole, *objective.prior))


def _intervals(
    problem: Problem, objective: StandardisedObjective, best: Fit, places: Sequence[int]
) -> dict[str, tuple[float, float]]:
    """90 % intervals of what was identified [SI], all else held; none of what the data do not determine."""
    assert best.jacobian is not None
    own, fitted = objective.deviation[list(places)], problem.fitted
    residual, jacobian = objective.seen(best)
    along = spread_along(objective.noise, residual[fitted], np.nan_to_num(jacobian[fitted]) * own)
    standardised = best.jacobian[: int(fitted.sum())] * own
    found, _ = intervals_in_si(objective.model, best.free, own, standardised, along, objective.noise, places)
    return {one.name: (one.low, one.high) for one in found if one.identifiable}
