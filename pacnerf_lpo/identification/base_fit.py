"""Material, motion and the coefficients of some effects, fitted from a guess: what every hypothesis is judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import CONVERGED
from pacnerf_lpo.identification.multistart import Stage, horizons, multistart
from pacnerf_lpo.mpm.effects.base import Effect, GroundEffect
from pacnerf_lpo.mpm.parameters import Log10

COARSER = 1.4
"""Node spacing of the search relative to that of the problem: a rollout costs a third."""
SAMPLES = 8
"""Points tried for each material parameter that is searched."""
FAR = 2.0
"""Standard deviations of a prior: an estimate farther away is reported."""
TOUCH = 0.5
"""Node spacings above the ground: a particle lower than this touches it."""
SEARCH_ITERATIONS, ITERATIONS = 4, 12
RIVAL = 1.5
Progress = Callable[[str], None]


@dataclass(frozen=True)
class BaseFit:
    """A fitted model.

    model: of the problem's body; its ``physical`` makes SI values of the free coordinates.
    free: coordinates [(K,)];  known: every value there [SI]
    residual: weighted residual of the fitted entries, without the priors [(D,)]
    jacobian: derivative of the residual by the coordinates [(D, K)]
    cost: sum of squares of the residual and of the priors' rows.
    notes: sentences about estimates at a bound or far from the guess, and points left out as unstable.
    rollouts: simulations that it took.
    """

    model: Model
    free: np.ndarray
    known: dict[str, float]
    residual: np.ndarray
    jacobian: np.ndarray
    cost: float
    notes: tuple[str, ...]
    rollouts: int


class Objective:
    """Weighted residual of a model in the fitted entries, then one row for each unknown: how far it is from the mean of
    its prior in standard deviations. The time step of each evaluation starts as long as the model's own.

    Args:
        problem, model: what is compared.
        mean, deviation: of the priors, in free coordinates [(K,)]
        level: of the residual's own error: the weights know the sensor's, not that of the model, which priors must not
            be outvoted by.
    """

    def __init__(self, problem: Problem, model: Model, mean: np.ndarray, deviation: np.ndarray, level: float = 1.0):
        self.model, self.mean, self.deviation, self.level = model, mean, deviation, level
        self._weighted = problem.weighted_residual_of(model)

    def __call__(self, free: np.ndarray) -> np.ndarray:
        self.model.physics.halvings = 0
        return np.concatenate((self._weighted(free), self.level * (free - self.mean) / self.deviation))


def base_fit(
    problem: Problem,
    effects: Sequence[Effect],
    known: dict[str, float],
    progress: Progress = lambda _: None,
) -> BaseFit:
    """Fit material, velocity and effects to the fitted views and frames, with priors.

    Args:
        problem: measurements and what is known of the scene.
        effects: of the model. Those whose coefficients ``known`` leaves at their nulls are tried from their probes, too.
        known: values to start from [SI], velocity among them.
        progress: told what happens.

    Raises:
        SimulationError: the motion is unstable at every start, with the shortest time step too.
    """
    coarse, fine = problem.model(effects, known, problem.sample(COARSER * problem.spacing, 0)), problem.model(effects, known)
    mean, deviation = priors(problem, fine)
    starts = _starts(coarse, effects)
    frames = int(problem.split.frames.sum())
    contact, spent = _contact(coarse, starts)
    progress(f"base fit of {fine.names}: contact in frame {contact} of {frames}")
    rows = [_rows(problem, until, len(mean)) for until in horizons(contact, frames)]
    searched = Objective(problem, coarse, mean, deviation)
    settings = coarse.scales, coarse.bounds
    spans = _spans(problem, coarse, mean, deviation)
    stages = [
        Stage(searched, *settings, rows, keep=2, iterations=SEARCH_ITERATIONS),
        Stage(searched, *settings, [rows[-min(len(rows), 3)], None], 1, spans=spans, samples=SAMPLES * len(spans), rival=COMPETITIVE),
        Stage(searched, *settings, rows, keep=2, iterations=SEARCH_ITERATIONS, rival=RIVAL),
    ]
    found = multistart(stages, starts)
    if not found.fits:
        raise SimulationError(0, 0, "the motion is unstable from every start")
    best = found.fits[0]
    level = max(1.0, float(np.sqrt(best.cost / max(len(best.residual) - len(mean), 1))))
    final = Stage(Objective(problem, fine, mean, deviation, level), fine.scales, fine.bounds, (None,), 1, ITERATIONS, confirm=True)
    ended = multistart([final], found.fits)
    if not ended.fits:
        raise SimulationError(0, 0, "the motion is unstable from every start")
    best = ended.fits[0]
    return BaseFit(
        fine,
        best.free,
        fine.physical(best.free),
        best.residual[: -len(mean)],
        best.jacobian[: -len(mean)],
        best.cost,
        tuple(notes(fine, best.free, mean, deviation)),
        found.rollouts + ended.rollouts + spent,
    )


COMPETITIVE = 3.0


def priors(problem: Problem, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations of a model's free coordinates [(K,), (K,)]: those of the effects, and for the rest
    around what the user guessed.
    """
    guess = {**model.known, **problem.first_guess, **problem.physics.guess}
    of_effects = {name: effect.prior(name) for effect in model.physics.effects for name in effect.parameters}
    found = [of_effects.get(p.name) or p.prior(guess[p.name]) for p in model.unknowns]
    mean, deviation = np.array(found).T
    return mean, deviation


def notes(model: Model, free: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> list[str]:
    """What is suspect about estimates at free coordinates [(K,)], a sentence each."""
    found, values = [], model.physical(free)
    for index, parameter in enumerate(model.unknowns):
        value, expected = (parameter.show(model.physical(at)[parameter.name]) for at in (free, mean))
        near = CONVERGED * model.scales[index]
        away = abs(free[index] - mean[index]) / deviation[index]
        if min(free[index] - model.bounds[0][index], model.bounds[1][index] - free[index]) < near:
            found.append(f"{parameter.label}: {value} is at the bound of what was searched.")
        elif away > FAR:
            found.append(
                f"{parameter.label}: {value} is {away:.1f} standard deviations from {expected}, which was expected."
            )
    return found


def _starts(model: Model, effects: Sequence[Effect]) -> list[np.ndarray]:
    """Free coordinates to begin with [(K,) each]: as known, but an effect without a gradient at its null, which stands
    there, at each of its probes.
    """
    found = [model.start.copy()]
    for effect in effects:
        at_null = all(model.known[name] == null for name, null in effect.null.items())
        if not (at_null and is_discrete(effect)):
            continue
        found = [_moved(model, point, probe) for point in found for probe in effect.probes]
    return found


def is_discrete(effect: Effect) -> bool:
    largest = {name: max(abs(probe[name]) for probe in effect.probes) for name in effect.null}
    return isinstance(effect, GroundEffect) or any(abs(v) > 10 * largest[n] for n, v in effect.null.items() if v)


def _moved(model: Model, point: np.ndarray, values: dict[str, float]) -> np.ndarray:
    moved = point.copy()
    for name, value in values.items():
        index = model.names.index(name)
        moved[index] = model.unknowns[index].transform.to_free(value)
    return np.clip(moved, *model.bounds)


def _contact(model: Model, starts: Sequence[np.ndarray]) -> tuple[int, int]:
    """First frame in which the body touches the ground, and how many rollouts it took."""
    for used, start in enumerate(starts, 1):
        try:
            low = model.path(start)[..., 1].amin(1).numpy() - model.physics.ground_height
        except SimulationError:
            continue
        touching = np.nonzero(low < TOUCH * model.body.spacing)[0]
        return (int(touching[0]) if len(touching) else len(low)), used
    return model.shape[1], len(starts)


def _rows(problem: Problem, until: int, unknowns: int) -> np.ndarray:
    """Which rows of an :class:`Objective` are of the first frames or of a prior [(D,), bool]."""
    return np.append(np.nonzero(problem.fitted)[1] < until, np.ones(unknowns, bool))


def _spans(problem: Problem, model: Model, mean: np.ndarray, deviation: np.ndarray) -> dict[int, tuple[float, float]]:
    """Between which free coordinates the material is searched, by index."""
    low, high = np.clip((mean - WIDE * deviation, mean + WIDE * deviation), *model.bounds)
    moduli = [p.name in problem.physics.material.free_names and isinstance(p.transform, Log10) for p in model.unknowns]
    return {k: (low[k], high[k]) for k, searched in enumerate(moduli) if searched}


WIDE = 1.5
