"""Which hypothesis is believed, and when the search for further ones ends: one score, one threshold, one check."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

LEVEL = 0.01
"""Probability that a diagnosis names anything where nothing is missing: an invented effect costs a user more than a
weak one that is not found, of which the report says how large it could be."""
DECISIVE = float(np.log(20.0))
"""Hypotheses whose log odds are within this are indistinguishable: odds of twenty to one (Kass and Raftery 1995)."""
LINEAR = 0.5
"""A hypothesis is fitted if its linear change reaches this part of the best log Bayes factor: a strong effect bends,
and a straight line misses up to half of what it explains, as a rule; where it missed more, a second look is due."""
LEFT = 0.5
"""Part of what a model leaves beyond noise: an effect that leaves less explains most of it, and is taken into the model
before others are searched for, which costs as much as a round."""


@dataclass(frozen=True)
class Contender:
    """A hypothesis that was fitted with all other parameters.

    name: of the hypothesis
    cost: |y|^2 at its optimum, with the terms of the priors, of all data: those that were fitted, and given them those
        that were held out
    occam: logarithm of the part of the prior of its coefficients that the data leave
    p_value: probability that the best of all hypotheses reaches its Bayes factor where nothing is missing
    """

    name: str
    cost: float
    occam: float
    p_value: float


def log_odds(contenders: Sequence[Contender], size: int, scale: float) -> dict[str, float]:
    """Logarithm of the posterior odds of every hypothesis against the best one, by name, best first.

    Of two hypotheses that both explain the residual, what each leaves decides, in units of the dispersion of the best.

    Args:
        contenders: fitted to the same data
        size: D, number of all data
        scale: s, factor on the noise along a typical hypothesis
    """
    if not contenders:
        return {}
    dispersion = scale**2 * max(1.0, min(one.cost for one in contenders) / size)
    evidence = {one.name: one.occam - one.cost / (2 * dispersion) for one in contenders}
    most = max(evidence.values())
    return {name: evidence[name] - most for name in sorted(evidence, key=lambda name: -evidence[name])}


def best(contenders: Sequence[Contender], odds: Mapping[str, float]) -> Contender | None:
    """The most probable, by the odds of :func:`log_odds`, of the hypotheses that are rarer than a false alarm; None if
    there is none.
    """
    rare = [one for one in contenders if one.p_value < LEVEL]
    return max(rare, key=lambda one: odds[one.name], default=None)


def indistinguishable(leader: Contender, odds: Mapping[str, float]) -> list[str]:
    """Names that the data do not separate from the leader, itself first."""
    near = [name for name, found in odds.items() if found > odds[leader.name] - DECISIVE and name != leader.name]
    return [leader.name, *near]


def log_bayes_factor(cost_without: float, cost: float, size: int, occam: float, scale: float) -> float:
    """Of a hypothesis that was fitted again with all other parameters against the model without it, by Laplace's
    approximation of the likelihood of :mod:`evidence`.

    Args:
        cost_without: |y|^2 of the model without the hypothesis at its optimum, with the terms of the priors
        cost: the same with the hypothesis
        size: D, number of data
        occam: from :func:`log_occam_factor`
        scale: s, factor on the noise along the hypothesis
    """
    gain = max(cost_without - cost, 0.0) / scale**2
    return size / 2 * float(np.log1p(gain / max(cost, float(size)))) + occam


def believed(whole: np.ndarray | float, fitted: np.ndarray | float) -> np.ndarray:
    """Log Bayes factors of all data, as far as they are believed: what was held out adds to what the fitted data say
    for a hypothesis, and may speak against it. Where those say nothing for it, it has no more than they say: errors of
    a motion grow in time, and where it was not fitted it shows more of them than replicates do.

    Args:
        whole, fitted: of all data, and of the fitted ones (...)
    """
    return np.where(np.asarray(fitted) > 0, whole, np.minimum(whole, fitted))


def log_occam_factor(others: np.ndarray, own: np.ndarray) -> float:
    """Logarithm of the part of the prior of a hypothesis' coefficients that the data leave, by the changes of the
    standardised residual by one prior standard deviation of every other parameter (D, K) and of its ``own`` (D, m).
    """
    return half_log_volume(others) - half_log_volume(np.concatenate((others, own), axis=1))


def log_spread_factor(
    mean: np.ndarray, covariance: np.ndarray, spreads: Sequence[float], one_sided: bool = False
) -> float:
    """Logarithm of by how much coefficients are more probable with a prior of several spreads, equally probable, than
    with one of N(0, 1): the mean of the ratio of the two priors over the normal posterior under the latter.

    Args:
        mean, covariance: of that posterior (m,), (m, m)
        spreads: standard deviations
        one_sided: whether the (only) coefficient is positive: its prior is twice as dense there, and zero elsewhere
    """
    factors = []
    for spread in spreads:
        excess = 1 / spread**2 - 1
        wider = np.eye(len(mean)) + excess * covariance
        centre = np.linalg.solve(wider, mean)
        factor = -len(mean) * np.log(spread) - 0.5 * (np.linalg.slogdet(wider)[1] + excess * mean @ centre)
        if one_sided:
            deviate = centre[0] * np.sqrt(wider[0, 0] / covariance[0, 0])
            factor += np.log(2) + norm.logcdf(deviate)
        factors.append(factor)
    return float(logsumexp(factors) - np.log(len(factors)))


def half_log_volume(changes: np.ndarray) -> float:
    """Half of the log determinant of the covariance of standardised data, I + X X^T, with changes X (D, K)."""
    return 0.5 * float(np.linalg.slogdet(np.eye(changes.shape[1]) + changes.T @ changes)[1])


def explains_most(cost_without: float, cost: float, size: int) -> bool:
    """Whether a hypothesis removes most of what the model without it leaves beyond noise, whose cost is D, the number
    of data; costs |y|^2 are infinite where there is no model.
    """
    return cost - size < LEFT * (cost_without - size)


def worth_refitting(scores: Sequence[tuple[str, float]], threshold: float, part: float = LINEAR) -> list[str]:
    """Names of the hypotheses whose linear change says that they could win, best first; none that it speaks against.

    Args:
        scores: name and log Bayes factor of every hypothesis by its linear change
        threshold: of the log Bayes factor of the best
        part: of the best log Bayes factor that has to be reached
    """
    ranked = sorted(scores, key=lambda entry: -entry[1])
    reached = max((factor for _, factor in ranked), default=0.0)
    least = max(max(threshold, part * reached) - DECISIVE, 0.0)
    return [name for name, factor in ranked if factor >= least]
