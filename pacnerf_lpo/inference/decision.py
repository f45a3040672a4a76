"""Which hypothesis is believed, and when the search for further ones ends: one score, one threshold, one check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.inference.evidence import Alternative
from pacnerf_lpo.inference.noise import NoiseModel

LEVEL = 0.01
"""Probability that a diagnosis names anything where nothing is missing: an invented effect costs a user more than a weak
one that is not found, and the report says how large that could be."""
DECISIVE = float(np.log(20.0))
"""Hypotheses whose log Bayes factors differ by less are not told apart: odds of twenty to one (Kass and Raftery 1995)."""


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
    cost_without: float, cost: float, noise: NoiseModel, changes: np.ndarray, scale: float
) -> float:
    """log Bayes factor of a hypothesis that was fitted again with all other parameters, by Laplace's approximation of the
    likelihood of :mod:`evidence`.

    Args:
        cost_without: |y|^2 of the model without the hypothesis at its optimum, with the terms of the priors
        cost: the same with the hypothesis
        noise: with the other parameters and the discrepancies among its directions
        changes: of the residual by one prior standard deviation of every coefficient at that optimum (D, m)
        scale: s, factor on the noise along the hypothesis
    """
    strengths = Alternative.of(noise, changes).strengths / scale
    other = max(cost, float(len(changes)))
    gain = max(cost_without - cost, 0.0) / scale**2
    return len(changes) / 2 * float(np.log1p(gain / other)) - 0.5 * float(np.log1p(strengths**2).sum())


def worth_refitting(
    scores: Sequence[tuple[str, float]], reached: float, most: float, slack: float
) -> list[str]:
    """Names whose hypotheses could still win, best first.

    Args:
        scores: name and log Bayes factor of every hypothesis by its linear change
        reached: log Bayes factor of the best that was fitted, -inf where none was
        most: log Bayes factor of a hypothesis that left nothing but noise: none can reach more
        slack: by how much the score of a linear change may be too low, as a part of the best
    """
    if most - reached < 0:
        return []
    ranked = sorted(scores, key=lambda entry: -entry[1])
    least = max(entry[1] for entry in ranked) * (1 - slack) - DECISIVE if ranked else 0.0
    return [name for name, factor in ranked if factor >= least]
