"""Steps 1 and 2: fit the model as it is, and learn from twins how large its residual may be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pacnerf_lpo.diagnosis.shape_errors import shape_errors
from pacnerf_lpo.diagnosis.statistics.acceptance import held_out_noise
from pacnerf_lpo.diagnosis.statistics.intervals import Interval, laplace_intervals, overdispersion, twin_inflation
from pacnerf_lpo.diagnosis.statistics.omnibus import Omnibus, omnibus
from pacnerf_lpo.diagnosis.statistics.score import Remainder
from pacnerf_lpo.diagnosis.twins import twins
from pacnerf_lpo.identification.base_fit import base_fit
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import Residual, fit, sensitivities
from pacnerf_lpo.identification.multistart import Stage, multistart
from pacnerf_lpo.identification.problem import Problem, StateProblem
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import Log10

FIRST_ITERATIONS = 10
WHITENED_ITERATIONS = 5
CONFIDENCE = 0.9
"""Of all intervals."""
COEFFICIENT_WIDENING = 1.4
"""Intervals of effects' coefficients are so many times as wide as twins tell: nine tenths of 41 in blind scenes with a
known truth lie within that, 73 % within what twins tell. Those of material and velocity cover as they are.
"""
MATERIAL_WIDENING = 2.5
"""The same for the material where the shape was reconstructed: eight of nine values lie within that in videos with a
known truth, five within what twins tell, who understate the error of a reconstruction.
"""
VALLEYS = 2
NEIGHBOURS = (-0.2, 0.2)
"""Decades: the next local minimum of a modulus is about so far away, where the body rebounds a frame later."""
MUCH_LOWER = 0.9
"""Of the cost: a fit from another start that is so much better has found a better minimum."""
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Comparison:
    """A fitted model beside the measurements.

    effects: of the model.
    names: of its unknowns.
    free: their free coordinates at the best fit [(K,)]
    known: every value there [SI]
    residual: measured minus predicted [pixels, (V, F, 11)]; NaN where not usable
    jacobian: change of the residual by the unknowns [(V, F, 11, K)]
    twins: residuals of simulated nulls [(T, V, F, 11)]
    shape_errors: changes of the residual by errors of the reconstructed body [(V, F, 11, M)]
    """

    effects: tuple[Effect, ...]
    names: tuple[str, ...]
    free: np.ndarray
    known: dict[str, float]
    residual: np.ndarray
    jacobian: np.ndarray
    twins: np.ndarray
    shape_errors: np.ndarray

    def noise(self, problem: Problem, mask: np.ndarray) -> NoiseModel:
        """Of the entries of a mask [(V, F, 11), bool]."""
        return noise_of(problem, self.twins, mask, self.shape_errors)


def compare(
    problem: Problem,
    effects: Sequence[Effect],
    known: dict[str, float],
    count: int,
    seed: int,
    progress: Progress,
) -> Comparison:
    """Fit material, effects and velocity to the fitted views and frames; simulate twins at the best fit.

    First with the same weight for all summaries, then whitened by the noise that the twins show. A rebound that comes a
    frame late fits almost as well as the right one; so fits from moduli beside the best ones are tried, too, and one
    that is much better takes its place, with twins of its own.

    Args:
        problem: the run.
        effects: of the model.
        known: values to start from [SI].
        count: number of twins.
        seed: of the twins.
        progress: told what happens.

    Raises:
        SimulationError: the motion at the values to start from is unstable.
    """
    model = problem.model(effects, known)
    raw = problem.residual_of(model, problem.fitted)
    weighted, report = problem.weighted_residual_of(model), reporter(model, progress)
    free = fit(weighted, model.start, model.scales, model.bounds, FIRST_ITERATIONS, report).free
    for attempt in range(VALLEYS):
        found = twins(problem, effects, free, model, count, seed, lambda k: progress(f"twin {k} of {count}"))
        wrong = shape_errors(problem, effects, free, model)
        noise = noise_of(problem, found, problem.fitted, wrong)
        whitened = whitened_by(noise, raw)
        best = fit(whitened, free, model.scales, model.bounds, WHITENED_ITERATIONS, report)
        free = best.free
        if attempt == VALLEYS - 1:
            break
        progress("looking into the next valleys")
        moduli = problem.physics.material.free_names
        spans = {model.names.index(name): (-np.inf, np.inf) for name in moduli if name in logarithmic(model)}
        settings = model.scales, model.bounds
        neighbours = Stage(whitened, *settings, iterations=FIRST_ITERATIONS, spans=spans, offsets=NEIGHBOURS)
        other = multistart([neighbours], [best]).fits[0]
        if other.cost > MUCH_LOWER * best.cost:
            break
        free = other.free
    everywhere = problem.residual_of(model, problem.usable)
    residual = everywhere(free)
    jacobian = sensitivities(everywhere, free, residual, model.scales, model.bounds)
    return Comparison(
        tuple(effects),
        model.names,
        free,
        model.physical(free),
        _spread(residual, problem.usable),
        _spread(jacobian, problem.usable),
        found,
        wrong,
    )


def searched(
    problem: Problem, effects: Sequence[Effect], known: dict[str, float], progress: Progress
) -> dict[str, float]:
    """Values to start from when the run has not identified its physics [SI]: where a base fit ends."""
    return base_fit(problem, effects, known, progress).known


def logarithmic(model: Model) -> list[str]:
    """Names of the unknowns that are fitted by their logarithm."""
    return [parameter.name for parameter in model.unknowns if isinstance(parameter.transform, Log10)]


def whitened_by(noise: NoiseModel, residual: Residual) -> Residual:
    """A residual of free coordinates [(K,)] in units of its noise [(D,)]."""
    return lambda free: noise.whiten_residual(residual(free))


def noise_of(problem: Problem, residuals: np.ndarray, mask: np.ndarray, wrong: np.ndarray | None = None) -> NoiseModel:
    """The noise model in the entries of a mask [(V, F, 11), bool], from twins [(T, V, F, 11)] and, where there are any,
    errors of the body [(V, F, 11, M)].
    """
    directions = None if wrong is None else np.nan_to_num(wrong[mask])
    twins = np.nan_to_num(residuals[:, mask])
    return NoiseModel.from_twins(twins, problem.sensor[mask], problem.layout(mask), directions)


def noise_of_held_out(
    problem: Problem,
    comparison: Comparison,
    mask: np.ndarray,
    seen_as: Callable[[np.ndarray], np.ndarray] = lambda residuals: residuals,
) -> NoiseModel:
    """The noise model in held-out entries [(V, F, 11), bool], where an error of the fit adds to the twins'.

    ``seen_as`` is the linear change of residuals [(..., V, F, 11)] in which they are judged.
    """

    def columns(changes: np.ndarray) -> np.ndarray:
        return np.moveaxis(seen_as(np.moveaxis(changes, -1, 0)), 0, -1)[mask]

    return held_out_noise(
        comparison.noise(problem, problem.fitted),
        comparison.jacobian[problem.fitted],
        np.nan_to_num(seen_as(comparison.twins)[:, mask]),
        columns(comparison.jacobian),
        problem.sensor[mask],
        problem.layout(mask),
        np.nan_to_num(columns(comparison.shape_errors)),
    )


def more_than_noise(problem: Problem, comparison: Comparison) -> tuple[Omnibus, Omnibus]:
    """Whether the residual is larger than the twins' are: in the fitted entries, and in the held-out ones."""
    fitted, held = problem.fitted, problem.usable & problem.split.held[..., None]
    noise = comparison.noise(problem, fitted), noise_of_held_out(problem, comparison, held)
    residual = np.nan_to_num(comparison.residual[held])
    return (
        omnibus(noise[0], comparison.residual[fitted], comparison.jacobian[fitted]),
        omnibus(noise[1], residual, np.zeros((len(residual), 0))),
    )


def intervals(problem: Problem, comparison: Comparison, noise: NoiseModel) -> tuple[list[Interval], list[str]]:
    """90 % intervals of every unknown [SI], and what the recording does not determine, in words."""
    mask = problem.fitted
    jacobian, residual = comparison.jacobian[mask], comparison.residual[mask]
    remainder = Remainder.of(noise, jacobian)
    dispersion = overdispersion(remainder.residual(residual), remainder.dof)
    model = problem.model(comparison.effects, comparison.known)
    return laplace_in_si(model, comparison.free, noise, jacobian, dispersion, widening(problem, comparison.effects))


def widening(problem: Problem, effects: Sequence[Effect]) -> dict[str, float]:
    """How many times as wide as twins tell the intervals of some unknowns are, by their names."""
    factors = {name: COEFFICIENT_WIDENING for effect in effects for name in effect.parameters}
    if isinstance(problem, StateProblem):
        factors |= dict.fromkeys(problem.physics.material.free_names, MATERIAL_WIDENING)
    return factors


def laplace_in_si(
    model: Model,
    free: np.ndarray,
    noise: NoiseModel,
    jacobian: np.ndarray,
    dispersion: float,
    wider: Mapping[str, float] | None = None,
) -> tuple[list[Interval], list[str]]:
    """Intervals of every unknown of a fitted model [SI], and what is not determined, in words.

    Args:
        model: whose unknowns they are.
        free: coordinates at the fit [(K,)]
        noise: of the fitted entries.
        jacobian: sensitivities there, not whitened [(D, K)]
        dispersion: factor on all variances.
        wider: factor on the intervals of some unknowns, by their names.
    """
    laplace = laplace_intervals(
        noise.whiten(jacobian),
        list(free),
        model.names,
        list(model.scales),
        CONFIDENCE,
        twin_inflation(noise, jacobian) * np.sqrt(dispersion),
        len(noise.twins) - 1,
    )
    found = [_widened(interval, (wider or {}).get(interval.name, 1.0)) for interval in laplace.intervals]
    return [in_si(model, interval) for interval in found], [d.sentence for d in laplace.undetermined]


def _widened(interval: Interval, factor: float) -> Interval:
    value = interval.value
    low, high = value + factor * (interval.low - value), value + factor * (interval.high - value)
    return replace(interval, low=low, high=high, error=factor * interval.error)


def in_si(model: Model, interval: Interval) -> Interval:
    """An interval of a free coordinate in SI units."""
    index = model.names.index(interval.name)
    low, high = model.bounds[0][index], model.bounds[1][index]

    def physical(free: float) -> float:
        moved = model.start.copy()
        moved[index] = np.clip(free, low, high)
        return model.physical(moved)[interval.name]

    ends = physical(interval.low), physical(interval.high)
    return Interval(interval.name, physical(interval.value), *ends, (ends[1] - ends[0]) / 2, interval.identifiable)


def reporter(model: Model, progress: Progress) -> Callable[[int, float, np.ndarray], None]:
    """Tells iteration, cost and the parameters with their units."""

    def report(iteration: int, cost: float, free: np.ndarray) -> None:
        values = model.physical(free)
        shown = ", ".join(f"{p.name} {p.show(values[p.name])}" for p in model.unknowns)
        progress(f"iteration {iteration}: cost {cost:.4g}, {shown}")

    return report


def _spread(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Entries of a mask [(D, ...)] in their places [(V, F, 11, ...)], NaN elsewhere."""
    whole = np.full((*mask.shape, *values.shape[1:]), np.nan)
    whole[mask] = values
    return whole
