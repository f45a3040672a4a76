"""Some settings identified from the current model, all others held."""

from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.diagnosis.comparison import intervals_in_si, reporter
from pacnerf_lpo.errors import SimulationError, Stopped, UserInputError
from pacnerf_lpo.explore.noise import Noise
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.explore.stepping import Stepper
from pacnerf_lpo.identification.base_fit import at_probes, notes
from pacnerf_lpo.identification.least_squares import Effort, Fit
from pacnerf_lpo.identification.least_squares import fit as descend
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.standardised import Held, StandardisedObjective
from pacnerf_lpo.inference.intervals import spread_along

ITERATIONS = 12
"""As the refits of a diagnosis."""


def check(stepper: Stepper, names: Sequence[str]) -> None:
    """Raise UserInputError where these settings cannot be identified in the current model."""
    if not names:
        raise UserInputError("explore: tick at least one setting to fit")
    step, catalogue = stepper.history.current, stepper.catalogue
    for name in names:
        owner = catalogue.owner(name)
        if owner is not None and owner not in step.effects:
            raise UserInputError(f"explore: {name} belongs to {owner}, which the model has not; add it first")
        if owner is None and name not in catalogue.free:
            raise UserInputError(f"explore: {name} is known in this run and is not identified; set it by hand")
    if len(set(names)) < len(names):
        raise UserInputError("explore: a setting is ticked twice")


def fit(stepper: Stepper, noise: Noise, names: list[str], progress: Progress) -> Step:
    """Identify settings by Levenberg-Marquardt on the fine body; a step with intervals, or, where it is stopped, with
    the best values so far. Raises as :meth:`Session.fit`.

    Residuals, noise and priors are those of a diagnosis. An effect without a gradient at its null, which stands there,
    starts at its probes.
    """
    problem, step = stepper.problem, stepper.history.current
    effects = stepper.catalogue.chosen(step.effects)
    model, mask = problem.model(effects, step.values), problem.fitted_with(effects)
    learnt = noise.of(step, progress).comparison.noise(problem, mask)
    objective = StandardisedObjective(problem, model, mask, learnt)
    places = [model.names.index(name) for name in names]
    bounds = model.bounds[0][places], model.bounds[1][places]
    held, tell, title = Held(objective, model.start, places), reporter(model, progress), f"fit of {', '.join(names)}"
    latest: list[np.ndarray] = []
    fits: list[Fit] = []
    unstable: list[SimulationError] = []

    def report(iteration: int, cost: float, free: np.ndarray) -> None:
        latest[:] = [held.all(free)]
        tell(iteration, cost, latest[0])

    def taken(free: np.ndarray, called: str, ends: dict[str, tuple[float, float]], doubts: Sequence[str] = ()) -> Step:
        known = model.physical(free)
        values, intervals = {**step.values, **{name: known[name] for name in names}}, {**step.intervals, **ends}
        made = Step(0, step.number, called, "fit", values, step.effects, intervals, notes=tuple(doubts))
        return stepper.adopt(made)

    try:
        for start in at_probes(model, [effect for effect in effects if set(effect.parameters) <= set(names)]):
            settings = model.scales[places], bounds, Effort(ITERATIONS), report, objective.rows
            try:
                fits.append(descend(held, start[places], *settings))
            except SimulationError as error:
                unstable.append(error)
    except Stopped:
        if latest:
            taken(latest[0], f"{title}, stopped", {})
        raise
    if not fits:
        raise unstable[-1]
    best = min(fits, key=lambda one: one.cost_of(objective.rows))
    ends, whole = _intervals(objective, mask, best, places), held.all(best.free)
    return taken(whole, title, ends, notes(model, whole, *objective.prior))


def _intervals(
    objective: StandardisedObjective, fitted: np.ndarray, best: Fit, places: Sequence[int]
) -> dict[str, tuple[float, float]]:
    """90 % intervals of what was identified [SI], all else held; none of what the data do not determine."""
    assert best.jacobian is not None
    own = objective.deviation[list(places)]
    residual, jacobian = objective.seen(best)
    along = spread_along(objective.noise, residual[fitted], np.nan_to_num(jacobian[fitted]) * own)
    standardised = best.jacobian[: int(fitted.sum())] * own
    found, _ = intervals_in_si(objective.model, best.free, own, standardised, along, objective.noise, places)
    return {one.name: (one.low, one.high) for one in found if one.identifiable}
