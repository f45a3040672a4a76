"""Did adding the effect help where the model was not fitted?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

BLOCK = 3
"""Neighbouring frames whose errors are taken as one."""
STANDARD_ERRORS = 2.0
LARGEST_DRIFT = 0.5
"""Change of the coefficient under grid refinement that still counts as survival, as part of the coefficient."""


@dataclass(frozen=True)
class Verdict:
    """Whether an effect is accepted.

    accepted: all criteria passed
    removed: share of the held-out excess error that the effect removes
    error: its standard error
    improved: held-out views whose error falls, of how many
    reasons: (criterion passed, sentence)
    """

    accepted: bool
    removed: float
    error: float
    improved: tuple[int, int]
    reasons: list[tuple[bool, str]]


def acceptance(
    excess_before: np.ndarray,
    excess_after: np.ndarray,
    views: np.ndarray,
    frames: np.ndarray,
    interval: tuple[float, float],
    null: float,
    coefficient: float,
    refined: float | None = None,
) -> Verdict:
    """Judge an added effect on held-out blocks of view x frame.

    The removed share is the ratio sum (before - after) / sum before. Its standard error is that of a ratio of cluster
    totals (Cochran 1977): by how much a cluster's change departs from its share h of the whole, over sqrt(1 - h), for
    a heavy cluster pulls the ratio to itself (Bell and McCaffrey 2002). So an effect that grows with time is not taken
    for scatter. Clusters are three neighbouring frames in all views (views show the same motion); with four views and
    more also the views, and the larger error counts. Two standard errors are widened as Student's t demands for so few
    clusters. Errors that are correlated over a third of the clip leave this criterion alone with up to 15 % of false
    passes; it is the family-wise threshold of the score test that guards against false alarms.

    Args:
        excess_before, excess_after: mean square error less the noise floor of every block [px^2, (B,)], of the same
            measurements without and with the effect, refitted
        views, frames: of every block (B,)
        interval: of the coefficient [its unit]
        null: value of the coefficient at which the effect vanishes
        coefficient: estimate [its unit]
        refined: estimate on a finer grid; None where that was not tried
    """
    fall = np.asarray(excess_before) - np.asarray(excess_after)
    total = float(np.sum(excess_before))
    removed = float(fall.sum()) / total if total > 0 else 0.0
    error, factor = _ratio_error(fall, np.asarray(excess_before), np.asarray(views), np.asarray(frames))
    by_view = [float(fall[views == view].sum()) for view in np.unique(views)]
    better = sum(change > 0 for change in by_view)
    reasons = [
        (removed > factor * error, _fall_sentence(total, removed, error)),
        (2 * better > len(by_view), f"the error falls in {better} of {len(by_view)} held-out views"),
        _interval_reason(interval, null),
    ]
    if refined is not None:
        reasons.append(_refinement_reason(coefficient - null, refined - null))
    return Verdict(all(passed for passed, _ in reasons), removed, error, (better, len(by_view)), reasons)


def _ratio_error(fall: np.ndarray, before: np.ndarray, views: np.ndarray, frames: np.ndarray) -> tuple[float, float]:
    """Standard error of sum fall / sum before, and how many of them two standard errors are with so few clusters."""
    total = float(before.sum())
    if total <= 0:
        return np.inf, STANDARD_ERRORS
    rest = fall - float(fall.sum()) / total * before
    _, order = np.unique(frames, return_inverse=True)
    clusterings = [order // BLOCK if order.max() >= 2 * BLOCK else order]
    if len(np.unique(views)) >= 4:
        clusterings.append(np.unique(views, return_inverse=True)[1])
    errors = []
    for labels in clusterings:
        count, shares = labels.max() + 1, np.bincount(labels, before) / total
        sums = np.bincount(labels, rest) / np.sqrt(np.clip(1 - shares, 1e-3, None))
        if count > 1:
            widening = float(student.isf(norm.sf(STANDARD_ERRORS), count - 1)) / STANDARD_ERRORS
            errors.append((np.sqrt((sums**2).sum()) / total, widening))
    error, widening = max(errors, key=lambda pair: pair[0] * pair[1], default=(np.inf, 1.0))
    return float(error), STANDARD_ERRORS * widening


def _fall_sentence(total: float, removed: float, error: float) -> str:
    if total <= 0:
        return "the held-out error was not above the noise floor before"
    verb = "falls" if removed > 0 else "rises"
    return f"the held-out excess error {verb} by {abs(removed):.0%} +- {error:.0%}"


def _interval_reason(interval: tuple[float, float], null: float) -> tuple[bool, str]:
    excluded = not interval[0] <= null <= interval[1]
    verb = "excludes" if excluded else "includes"
    return excluded, f"the coefficient's interval [{interval[0]:.3g}, {interval[1]:.3g}] {verb} {null:g}, no effect"


def _refinement_reason(coarse: float, fine: float) -> tuple[bool, str]:
    """Both counted from the null."""
    survives = abs(fine - coarse) <= LARGEST_DRIFT * abs(coarse)
    verb = "survives" if survives else "does not survive"
    return survives, f"the coefficient {verb} a finer grid ({coarse:.3g} from the null, then {fine:.3g})"
