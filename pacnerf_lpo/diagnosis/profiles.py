"""Profile likelihood of one parameter: slower than the intervals from sensitivities, and right where those bend."""

from __future__ import annotations

import numpy as np

from pacnerf_lpo.diagnosis.comparison import CONFIDENCE, Comparison, Progress
from pacnerf_lpo.diagnosis.statistics.intervals import Profile, overdispersion, profile_likelihood
from pacnerf_lpo.diagnosis.statistics.score import Remainder
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.least_squares import fit
from pacnerf_lpo.identification.problem import Problem

ITERATIONS = 3


def profile(problem: Problem, comparison: Comparison, name: str, progress: Progress) -> tuple[float, float, Profile]:
    """90 % interval [SI] of one unknown, all others fitted again for every value of it.

    Args:
        problem, comparison: the run and its fitted model.
        name: of the unknown, such as ``E``.
        progress: told what happens.

    Returns:
        Lower and upper end [SI], and the profile in free coordinates.

    Raises:
        UserInputError: the fitted model has no such unknown.
    """
    if name not in comparison.names:
        raise UserInputError(
            f"diagnose: --profile {name}: the last model has no such unknown; it has {', '.join(comparison.names)}"
        )
    mask, index = problem.fitted, comparison.names.index(name)
    noise = comparison.noise(problem, mask)
    model = problem.model(comparison.effects, comparison.known)
    raw = problem.residual_of(model, mask)
    others = np.arange(len(comparison.names)) != index
    jacobian, residual = comparison.jacobian[mask], comparison.residual[mask]
    remainder = Remainder.of(noise, jacobian)
    dispersion = overdispersion(remainder.residual(residual), remainder.dof)
    curvature = float(np.linalg.norm(Remainder.of(noise, jacobian[:, others]).change(jacobian[:, [index]])))
    start = comparison.free[others]

    def misfit(value: float) -> float:
        def held(rest: np.ndarray) -> np.ndarray:
            return noise.whiten_residual(raw(np.insert(rest, index, value)))

        progress(f"profile of {name}: {model.physical(np.insert(start, index, value))[name]:.4g}")
        bounds = model.bounds[0][others], model.bounds[1][others]
        return fit(held, start, model.scales[others], bounds, ITERATIONS).cost

    ends = float(max(model.bounds[0][index], -1e6)), float(min(model.bounds[1][index], 1e6))
    error = float(np.sqrt(dispersion)) / max(curvature, 1e-12)
    error = min(error, 5 * float(model.scales[index]))
    found = profile_likelihood(misfit, float(comparison.free[index]), error, ends, CONFIDENCE, dispersion)
    low, high = (model.physical(np.insert(start, index, value))[name] for value in (found.low, found.high))
    return low, high, found
