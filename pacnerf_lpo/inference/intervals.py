"""What the data and the prior say of every parameter: posterior intervals, and what is not determined."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2
from scipy.stats import t as student

from pacnerf_lpo.inference.calibration import moderated_scales
from pacnerf_lpo.inference.noise import NoiseModel

LEAST_STRENGTH = 1.0
"""A combination of parameters is undetermined if the data narrow its prior by less than the root of two: then they say
no more than the prior."""
NAMED_SHARE = 0.3
"""Parameters with a smaller part in an undetermined combination are not named in its sentence."""


@dataclass(frozen=True)
class Interval:
    """What the data say of one parameter.

    value, low, high: estimate and ends of the interval [the parameter's unit]
    error: posterior standard deviation [the parameter's unit]
    identifiable: whether the data narrow the prior
    """

    name: str
    value: float
    low: float
    high: float
    error: float
    identifiable: bool


def posterior_intervals(
    jacobian: np.ndarray,
    spread: np.ndarray | float,
    values: Sequence[float],
    names: Sequence[str],
    deviations: Sequence[float],
    level: float,
    dof: float,
) -> tuple[list[Interval], list[str]]:
    """Intervals from Laplace's approximation of the posterior, with precision J^T J / s^2 + P^-1.

    Args:
        jacobian: change of the standardised residual by one prior standard deviation of each parameter (D, P)
        spread: s, of the residual along every parameter, see :func:`spread_along` (P,)
        values: estimates (P,)
        names: (P,)
        deviations: P^1/2, standard deviations of the prior (P,)
        level: of the intervals
        dof: of Student's t: number of replicates that the noise was learnt from, less one

    Returns:
        The intervals, and a sentence for each combination of parameters of which the data say no more than the prior.
    """
    prior = np.asarray(deviations, float)
    _, strengths, directions = np.linalg.svd(jacobian / spread, full_matrices=True)
    strengths = np.pad(strengths, (0, len(prior) - len(strengths)))
    covariance = (directions.T / (1 + strengths**2)) @ directions
    errors = np.sqrt(np.diag(covariance)) * prior
    width = float(student.ppf(0.5 + level / 2, dof))
    determined = (errors < prior / np.sqrt(1 + LEAST_STRENGTH**2)).tolist()
    rows = zip(names, values, errors.tolist(), determined, strict=True)
    intervals = [Interval(name, float(v), float(v - width * e), float(v + width * e), e, d) for name, v, e, d in rows]
    weak = [i for i in np.argsort(strengths) if strengths[i] < LEAST_STRENGTH]
    return intervals, [_sentence(directions[i], names) for i in weak]


def spread_along(noise: NoiseModel, residual: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Dispersion of a residual along every parameter, at least 1 (P,): of the whole residual, times that of left-out
    replicates along the parameter, for the covariance of a few replicates is least reliable along smooth changes, and
    those are what parameters cause.

    Args:
        noise: of the residual, discrepancies included, the parameters themselves not
        residual: measured minus predicted at the estimate (D,)
        jacobian: change of it by one prior standard deviation of each parameter (D, P)
    """
    square = noise.with_directions(jacobian).square(residual)
    return _replicate_scales(noise, jacobian) * np.sqrt(max(1.0, square / len(residual)))


def disagreement(shift: np.ndarray, part: np.ndarray, whole: np.ndarray, found: float) -> float:
    """By how much the variance of an estimate is larger than its model says, at least 1, by how far it moves from where
    a part of the data has it to where all have it, of which the difference of the two covariances is expected (Hausman
    1978), and by how well an optimum is found.

    Args:
        shift: of the parameters, in prior standard deviations (P,)
        part, whole: change of the standardised residual of each by one prior standard deviation (D', P), (D, P)
        found: to how many posterior standard deviations of all data
    """
    prior = np.eye(len(shift))
    first, last = (np.linalg.inv(prior + changes.T @ changes) for changes in (part, whole))
    return max(1.0, float(shift @ np.linalg.solve(first - (1 - found**2) * last, shift)) / len(shift))


def _replicate_scales(noise: NoiseModel, jacobian: np.ndarray) -> np.ndarray:
    """Factor on the error of every parameter from its scatter over left-out replicates, at least 1 (P,); arguments as
    of :func:`spread_along`.
    """
    rows = []
    for model, replicate in noise.left_out:
        inverse = np.linalg.pinv(model.whiten(jacobian), rcond=1e-10)  # its rows: what is left of each column, scaled
        coordinates, sizes = inverse @ model.whiten_residual(replicate), (inverse**2).sum(1)
        rows.append(coordinates**2 / np.maximum(sizes, 1e-300))
    return moderated_scales(np.array(rows))


def _sentence(direction: np.ndarray, names: Sequence[str]) -> str:
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    named = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) >= NAMED_SHARE]
    rising = " and ".join(names[i] for i in named if direction[i] > 0)
    falling = " and ".join(names[i] for i in named if direction[i] < 0)
    if len(named) == 1:
        return f"{rising} is not determined by this recording"
    if falling:
        return f"raising {rising} while lowering {falling} changes nothing that this recording shows"
    return f"raising {rising} together changes nothing that this recording shows"


@dataclass(frozen=True)
class Profile:
    """Interval by profile likelihood.

    low, high: ends [the parameter's unit]; a bound where the data leave that side open
    low_open, high_open: whether they do
    trials: (value, cost after the refit) in the order they were made
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
    """Where the cost, refitted with the parameter held, has risen by the quantile of chi^2_1 (Wilks 1938).

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
