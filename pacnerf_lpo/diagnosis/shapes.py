"""A fitted model with the shape that explains most: values and intervals where a reconstruction is far from the body.

The noise of a comparison knows of errors of the shape, but as straight lines from what was reconstructed, and a body
that is a tenth too thick bounces in another way. Where such lines do not explain the data, material, motion and shape
are fitted together, and the errors of the shape are simulated anew around where that ends (Gauss and Newton's method).
Where they do, the data do not say which shape is the right one, and one that they choose is farther from it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from pacnerf_lpo.diagnosis.comparison import Comparison, known_errors, reporter, standardised
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import ROUGH_GAIN
from pacnerf_lpo.identification.problem import StateProblem
from pacnerf_lpo.identification.processes import Progress, prefixed
from pacnerf_lpo.identification.replicates import distortion
from pacnerf_lpo.identification.reshaping import JointObjective
from pacnerf_lpo.identification.shape_errors import shape_errors
from pacnerf_lpo.identification.standardised import StandardisedObjective, noise_of
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.mpm.effects.base import Effect

MOST = 4
"""Fits of the shape: each takes some hundred simulations."""


def with_other_shapes(
    problem: StateProblem, effects: Sequence[Effect], comparison: Comparison, progress: Progress
) -> Comparison:
    """A comparison with the shape that explains most; the one that is given where that explains the data, where no
    other shape explains much more, and where what does is no error of a reconstruction, as it is too large: something
    else is wrong then, and would bend the shape.

    Args:
        problem: as it was compared.
        effects: of the model.
        comparison: the model fitted.
        progress: receives a line about each step.
    """
    cost = np.inf
    for _ in range(MOST):
        if comparison.checks(problem)[0].p_value >= LEVEL:
            break
        try:
            found, cost = _with_another_shape(problem, effects, comparison, cost, progress)
        except SimulationError:
            break
        if found is None:
            break
        comparison = found
    return comparison


def _with_another_shape(
    problem: StateProblem, effects: Sequence[Effect], comparison: Comparison, before: float, progress: Progress
) -> tuple[Comparison | None, float]:
    """The next comparison, or None, and the cost of the joint fit; ``before`` is that of the fit before it."""
    known, mask = comparison.known, problem.fitted
    replicated, sensor, changes, discretisation, force = comparison.learnt
    sigma, shape, now = comparison.sigma, comparison.shape, problem
    if len(shape):
        now = problem.reshaped(sigma, shape)
    else:
        model = problem.model(effects, known)
        sigma, shape = distortion(problem, model.predict(comparison.free)), np.zeros(changes.shape[-1])
    model = now.model(effects, known)
    noise = noise_of(problem, replicated, sensor, mask, known_errors(changes[..., :0], discretisation, force)[mask])
    joint = JointObjective(problem, effects, known, StandardisedObjective(problem, model, mask, noise), mask, sigma)
    report = reporter(model, prefixed(progress, "shape: "))
    ended, begun = joint.fit(comparison.free, shape, comparison.jacobian, changes, report)
    free, shape = np.split(ended.free, [len(model.start)])
    if ended.cost > (1 - ROUGH_GAIN) * min(before, begun) or chi2.sf(shape @ shape, len(shape)) < LEVEL:
        return None, before
    now = problem.reshaped(sigma, shape)
    model = now.model(effects, model.physical(free))
    changes = shape_errors(now, model, model.start)
    learnt = (replicated, sensor, changes, discretisation, force)
    found = standardised(problem.reshaped(sigma, shape, changes), model, model.start, None, learnt, progress)
    used = comparison.rollouts + ended.rollouts + changes.shape[-1] + 2 + found.rollouts
    return replace(found, sigma=sigma, shape=shape, rollouts=used), ended.cost
