"""A problem on its coarse body, without pictures: for questions that take many rollouts, in several processes."""

from copy import copy
from dataclasses import replace

import numpy as np

from pacnerf_lpo.diagnosis.comparison import Comparison, Progress, reporter
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.least_squares import Fit, fit
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.standardised import StandardisedObjective
from pacnerf_lpo.identification.study import StudyProblem
from pacnerf_lpo.mpm.effects.base import Effect

LARGE = ("data", "state", "run", "stage", "_coarse", "_as_reconstructed")
"""What a problem holds and no model of it needs."""
ITERATIONS = 8


def on_coarse_body(problem: Problem) -> Problem:
    """A copy whose models move the coarse body. How that differs from the fine one is among the errors of resolution
    that every noise model knows, as one standard deviation.
    """
    found = copy(problem)
    if isinstance(found, StudyProblem):
        found.recordings = [on_coarse_body(recording) for recording in found.recordings]
        return found
    kept = {"body": problem.coarse_body, "first_guess": problem.first_guess, "video": problem.without_pictures}
    for name in LARGE:
        vars(found).pop(name, None)
    vars(found).update(kept)
    return found


def fitted(
    problem: Problem, effects: tuple[Effect, ...], values: dict[str, float], noise: Comparison, progress: Progress
) -> Comparison:
    """A model fitted with all its unknowns from where it stands, with a known noise around it.

    Args:
        problem: on its coarse body.
        effects, values: of the model [SI]
        noise: a comparison of the same data.
        progress: receives a line about each step.

    Raises:
        SimulationError: the motion is unstable where it stands.
    """
    model, mask = problem.model(effects, values), problem.fitted
    mean, deviation = priors(problem, model)
    objective = StandardisedObjective(problem, model, mask, noise.noise(problem, mask), mean, deviation)
    start: np.ndarray | Fit = np.clip(model.start, *model.bounds)
    if noise.names == model.names and noise.jacobian.shape[-1] == len(model.names):
        known = objective.derivative(noise.jacobian)
        start = Fit(model.start, objective(model.start), known, 1, objective)
    report = reporter(model, progress)
    best = fit(objective, start, model.scales, model.bounds, ITERATIONS, report, rows=objective.rows, confirm=False)
    residual, jacobian = objective.seen(best)
    return replace(
        noise,
        names=model.names,
        free=best.free,
        known=model.physical(best.free),
        mean=mean,
        deviation=deviation,
        cost=best.cost_of(objective.rows),
        residual=residual,
        jacobian=jacobian,
        notes=(),
        rollouts=best.rollouts,
    )
