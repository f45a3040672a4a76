"""How well the fitted parameters are known, and which of them, or which combinations, are not known at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, norm
from scipy.stats import t as student

from pacnerf_lpo.diagnosis.statistics.calibration import moderated_scales
from pacnerf_lpo.diagnosis.statistics.score import Remainder
from pacnerf_lpo.inference.noise import NoiseModel

LEAST_STRENGTH = 1.0
"""A combination of parameters is undetermined if a change by its scale moves the residual by less than one sigma."""
NAMED_SHARE = 0.3
"""Parameters with a smaller part in an undetermined combination are not named in its sentence."""


@dataclass(frozen=True)
class Interval:
    """What the data say of one parameter.

    value, low, high: estimate and ends of the interval [the parameter's unit]
    error: standard error [the parameter's unit]; infinite where the data say nothing
    identifiable: whether the data narrow it down to less than its scale
    """

    name: str
    value: float
    low: float
    high: float
    error: float
    identifiable: bool


@dataclass(frozen=True)
class NullDirection:
    """A combination of parameters that the data do not determine.

    weights: unit vector in units of the parameters' scales, by name
    strength: standard deviations by which the residual moves along it per unit
    sentence: the same in words
    """

    weights: dict[str, float]
    strength: float
    sentence: str


@dataclass(frozen=True)
class Laplace:
    """Intervals of all parameters from the sensitivities at the best fit.

    intervals: one for every parameter
    covariance: of the parameters (P, P), infinite variances as large numbers
    undetermined: combinations the data do not determine, the least determined first
    """

    intervals: list[Interval]
    covariance: np.ndarray
    undetermined: list[NullDirection]


def laplace_intervals(
    jacobian_whitened: np.ndarray,
    values: Sequence[float],
    names: Sequence[str],
    scales: Sequence[float],
    level: float = 0.9,
    inflation: Sequence[float] | float = 1.0,
    dof: float = np.inf,
) -> Laplace:
    """values +- t sqrt(diag (J^T J)^-1) * inflation (Laplace's approximation of the likelihood).

    Args:
        jacobian_whitened: change of the whitened residual by each parameter (D, P)
        values: estimates [the parameters' units, (P,)]
        names: (P,)
        scales: change of each parameter that matters [its unit, (P,)]; makes different units comparable
        level: of the intervals
        inflation: factor on every standard error, of :func:`twin_inflation` or root of :func:`overdispersion`
        dof: of Student's t, T - 1 where the inflation comes from T twins
    """
    scale = np.asarray(scales, float)
    _, strengths, directions = np.linalg.svd(np.asarray(jacobian_whitened) * scale, full_matrices=True)
    strengths = np.pad(strengths, (0, len(scale) - len(strengths)))
    variances = 1 / np.maximum(strengths, 1e-9) ** 2
    covariance = (directions.T * variances) @ directions
    factor = np.broadcast_to(np.asarray(inflation, float), scale.shape) * scale
    covariance = covariance * np.outer(factor, factor)
    errors = np.sqrt(np.diag(covariance))
    errors = np.where(errors > 1e6 * scale, np.inf, errors)
    width = float(student.ppf(0.5 + level / 2, dof)) if np.isfinite(dof) else float(norm.ppf(0.5 + level / 2))
    intervals = [
        Interval(
            name, float(value), float(value - width * error), float(value + width * error), float(error), determined
        )
        for name, value, error, determined in zip(names, values, errors, (errors < scale).tolist(), strict=True)
    ]
    weak = [i for i in np.argsort(strengths) if strengths[i] < LEAST_STRENGTH * float(np.max(inflation))]
    undetermined = [_null_direction(directions[i], float(strengths[i]), names) for i in weak]
    return Laplace(intervals, covariance, undetermined)


def _null_direction(direction: np.ndarray, strength: float, names: Sequence[str]) -> NullDirection:
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    order = np.argsort(-np.abs(direction))
    named = [i for i in order if abs(direction[i]) >= NAMED_SHARE]
    rising = " and ".join(names[i] for i in named if direction[i] > 0)
    falling = " and ".join(names[i] for i in named if direction[i] < 0)
    if len(named) == 1:
        sentence = f"{rising} is not determined by this recording"
    elif falling:
        sentence = f"raising {rising} while lowering {falling} changes nothing that this recording shows"
    else:
        sentence = f"raising {rising} together changes nothing that this recording shows"
    return NullDirection({names[i]: float(direction[i]) for i in order}, strength, sentence)


def twin_inflation(noise: NoiseModel, jacobian: np.ndarray) -> np.ndarray:
    """Factor on the standard error of every parameter, from its scatter over left-out twins, at least 1 (P,).

    The covariance of a few twins is least reliable along smooth changes, and those are what parameters cause.

    Args:
        noise: of the residual, with its twins
        jacobian: sensitivities to the parameters, not whitened (D, P)
    """
    rows = []
    for model, twin in noise.left_out:
        deviates = []
        for column in range(jacobian.shape[1]):
            others = Remainder.of(model, np.delete(jacobian, column, axis=1))
            change = others.change(jacobian[:, column])
            deviates.append(float(change @ others.residual(twin)) ** 2 / max(float(change @ change), 1e-300))
        rows.append(deviates)
    return moderated_scales(np.array(rows))


def overdispersion(left: np.ndarray, dof: int) -> float:
    """max(1, ||M r||^2 / dof): factor on all variances where the model does not reach the noise floor.

    Args:
        left: whitened residual beside the fitted parameters (D,)
        dof: D - P
    """
    return max(1.0, float(left @ left) / dof)


@dataclass(frozen=True)
class Profile:
    """Interval by profile likelihood.

    low, high: ends [the parameter's unit]; a bound where the data leave that side open
    low_open, high_open: whether they do
    trials: (value, misfit after the refit) in the order they were made
    """

    low: float
    high: float
    low_open: bool
    high_open: bool
    trials: list[tuple[float, float]]


def profile_likelihood(
    objective: Callable[[float], float],
    value: float,
    error: float,
    bounds: tuple[float, float],
    level: float = 0.9,
    dispersion: float = 1.0,
) -> Profile:
    """Where the misfit, refitted with the parameter held, has risen by the quantile of chi^2_1 (Wilks 1938).

    The root of the rise is nearly linear in the parameter, so that a bracketing root finder needs few refits.

    Args:
        objective: smallest ||whitened residual||^2 with the parameter held at a value
        value: estimate [the parameter's unit]
        error: about its standard error: the first step [the parameter's unit]
        bounds: between which the parameter may lie
        level: of the interval
        dispersion: factor on all variances, such as :func:`overdispersion`
    """
    trials: dict[float, float] = {}
    rise = float(np.sqrt(chi2.ppf(level, 1) * dispersion))

    def root_rise(at: float) -> float:
        if at not in trials:
            trials[at] = objective(at)
        return float(np.sqrt(max(trials[at] - trials[value], 0.0))) - rise

    root_rise(value)
    (low, low_open), (high, high_open) = (
        _end(root_rise, value, direction * abs(error) * rise, bound)
        for direction, bound in zip((-1, 1), bounds, strict=True)
    )
    return Profile(low, high, low_open, high_open, list(trials.items()))


def _end(rise: Callable[[float], float], value: float, step: float, bound: float) -> tuple[float, bool]:
    """Where the rise crosses zero on one side of the estimate, in steps that double; or the bound, and True."""
    inner = value
    while inner != bound:
        outer = max(value + step, bound) if step < 0 else min(value + step, bound)
        if rise(outer) >= 0:
            return float(brentq(rise, inner, outer, xtol=0.02 * abs(outer - inner), rtol=1e-12)), False
        inner, step = outer, 2 * step
    return bound, True
