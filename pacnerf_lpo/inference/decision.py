"""Which hypothesis is believed, and when the search for further ones ends: one score, one threshold, one check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEVEL = 0.01
"""Probability that a diagnosis names anything where nothing is missing: an invented effect costs a user more than a weak
one that is not found, and the report says how large that could be."""
DECISIVE = float(np.log(20.0))
"""Hypotheses whose log Bayes factors differ by less are not told apart: odds of twenty to one (Kass and Raftery 1995)."""


LINEAR = 0.7
"""A hypothesis is fitted if its linear change reaches this part of the best log Bayes factor: the strong effect that moves
a residual by twenty standard deviations bends, and a straight line through it misses a third of its own square at most."""


@dataclass(frozen=True)
class Contender:
    """A hypothesis that was fitted with all other parameters.

    name: of the hypothesis
    log_bayes_factor: of it against the model without it
    p_value: probability that the best of all hypotheses reaches this where nothing is missing
    """

    name: str
    log_bayes_factor: float
    p_value: float


def best(contenders: Sequence[Contender]) -> Contender | None:
    """The hypothesis that is believed; None if the best is no rarer than a false alarm."""
    leader = max(contenders, key=lambda one: one.log_bayes_factor, default=None)
    return leader if leader is not None and leader.p_value < LEVEL else None


def indistinguishable(contenders: Sequence[Contender], leader: Contender) -> list[str]:
    """Names that the data do not tell apart from the leader, itself first."""
    near = [c for c in contenders if leader.log_bayes_factor - c.log_bayes_factor < DECISIVE]
    return [c.name for c in sorted(near, key=lambda c: -c.log_bayes_factor)]


def refitted_log_bayes_factor(
    cost_without: float, cost: float, others: np.ndarray, own: np.ndarray, scale: float
) -> float:
    """log Bayes factor of a hypothesis that was fitted again with all other parameters, by Laplace's approximation of the
    likelihood of :mod:`evidence`.

    Args:
        cost_without: |y|^2 of the model without the hypothesis at its optimum, with the terms of the priors
        cost: the same with the hypothesis
        others: change of the standardised residual by one prior standard deviation of every other parameter at the
            optimum of the hypothesis (D, K)
        own: the same of its own coefficients (D, m)
        scale: s, factor on the noise along the hypothesis
    """
    least = max(cost, float(len(own)))
    gain = max(cost_without - cost, 0.0) / scale**2
    both = np.concatenate((others, own / scale), axis=1)
    return len(own) / 2 * float(np.log1p(gain / least)) - (_half_log_volume(both) - _half_log_volume(others))


def _half_log_volume(changes: np.ndarray) -> float:
    return 0.5 * float(np.linalg.slogdet(np.eye(changes.shape[1]) + changes.T @ changes)[1])


def worth_refitting(scores: Sequence[tuple[str, float]], threshold: float) -> list[str]:
    """Names of the hypotheses whose linear change says that they could win, best first.

    Args:
        scores: name and log Bayes factor of every hypothesis by its linear change
        threshold: of the log Bayes factor of the best
    """
    ranked = sorted(scores, key=lambda entry: -entry[1])
    reached = max((factor for _, factor in ranked), default=0.0)
    least = max(threshold - DECISIVE, LINEAR * reached - DECISIVE)
    return [name for name, factor in ranked if factor >= least]
