"""Profile likelihood of one parameter: slower than the intervals from sensitivities, and right where those bend."""

from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.diagnosis.comparison import CONFIDENCE, Comparison
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.least_squares import Effort, fit
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.standardised import Held, StandardisedObjective
from pacnerf_lpo.inference.intervals import Profile, profile_likelihood
from pacnerf_lpo.mpm.effects.base import Effect

ITERATIONS = 3


def profile(
    problem: Problem, effects: Sequence[Effect], comparison: Comparison, name: str, progress: Progress
) -> tuple[float, float, Profile]:
    """90 % interval of one unknown of a fitted model, all others fitted again for every value of it, with their priors:
    lower and upper end [SI], and the profile in free coordinates.

    Raises:
        UserInputError: the fitted model has no such unknown.
    """
    if name not in comparison.names:
        raise UserInputError(
            f"diagnose: --profile {name}: the last model has no such unknown; it has {', '.join(comparison.names)}"
        )
    mask, index = comparison.fitted, comparison.names.index(name)
    model, noise = problem.model(effects, comparison.known), comparison.noise(problem, mask)
    objective = StandardisedObjective(problem, model, mask, noise, (comparison.mean, comparison.deviation))
    others = np.flatnonzero(np.arange(len(comparison.names)) != index)
    changes, spread = comparison.changes(mask), float(comparison.error_scales(problem)[index])
    left = noise.with_directions(changes[:, others]).whiten(changes[:, index])
    error = spread * float(comparison.deviation[index]) / float(np.sqrt(1 + left @ left))
    physical, rows = model.unknowns[index].physical, objective.rows

    def cost(value: float) -> float:
        progress(f"profile of {name}: {physical(value):.4g}")
        bounds = model.bounds[0][others], model.bounds[1][others]
        full = comparison.free.copy()
        full[index] = value
        held = Held(objective, full, others.tolist())
        return fit(held, full[others], model.scales[others], bounds, Effort(ITERATIONS), rows=rows).cost_of(rows)

    ends = float(max(model.bounds[0][index], -1e6)), float(min(model.bounds[1][index], 1e6))
    found = profile_likelihood(cost, float(comparison.free[index]), error, ends, CONFIDENCE, spread**2)
    return physical(found.low), physical(found.high), found
