"""What one pass of a diagnosis has found."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.refitting import Refit
from pacnerf_lpo.diagnosis.residual_force import ResidualForce
from pacnerf_lpo.diagnosis.screening import Screening
from pacnerf_lpo.diagnosis.statistics.acceptance import MOST_REMOVED
from pacnerf_lpo.diagnosis.statistics.intervals import Interval
from pacnerf_lpo.diagnosis.statistics.omnibus import Omnibus

MORE_THAN_NOISE = 0.05
"""Chance at which the test for more than noise in the fitted data may err."""
AGREEMENT = 0.2
"""Held-out data that are as bad with less chance than this, where nothing is missing, confirm the fitted data."""
BY_ITSELF = 0.001
"""Held-out data that are as bad with less chance than this are told of, though the fitted data are noise."""

MUCH_MORE = 4.0
"""Times the twins' mean square: a held-out error so large is neither explained by what was found nor an error of a
reconstruction, whose known directions count as noise.
"""


@dataclass
class Round:
    """One pass of the steps.

    comparison: the model as it stood.
    omnibus: whether its residual is more than noise in the fitted data.
    held: the same in the held-out data.
    excess: mean square error above the twins' in the fitted and in the held-out data [pixels^2]
    parameters: intervals of all unknowns.
    undetermined: what the recording does not determine, in words.
    phases: of the motion, by frame.
    candidates: effects that were screened.
    screening: the ranking; None if the diagnosis stopped before.
    refits: with one more effect each.
    accepted: the refit that was taken over.
    force: the smooth force that would remove the residual; None where it was not asked for.
    profiles: lower and upper end by profile likelihood, of the unknowns it was asked for [SI]
    """

    comparison: Comparison
    omnibus: Omnibus
    held: Omnibus
    excess: dict[str, float]
    parameters: list[Interval]
    undetermined: list[str]
    phases: list[str]
    candidates: list[Candidate] = field(default_factory=list)
    screening: Screening | None = None
    refits: list[Refit] = field(default_factory=list)
    accepted: Refit | None = None
    force: ResidualForce | None = None
    profiles: dict[str, tuple[float, float]] = field(default_factory=dict)


def beyond_noise(found: Round) -> bool:
    """Whether the residual is more than noise in the fitted data, by the omnibus test, and the held-out data agree; and
    matters.
    """
    return fires(found) and matters(found)


def fires(found: Round) -> bool:
    """Whether the omnibus test finds more than noise in the fitted data, and the held-out data agree."""
    return found.omnibus.p_value < MORE_THAN_NOISE and found.held.p_value < AGREEMENT


def fails_held_out(found: Round) -> bool:
    """Whether the model fits what it was fitted to, but not the held-out data, where the error is larger than the
    twins', too: parameters may stand in for an effect, or the reconstruction be wrong where it did not look.
    """
    return found.omnibus.p_value >= MORE_THAN_NOISE and found.held.p_value < BY_ITSELF and found.excess["held"] > 0


def left_over(found: Round) -> bool:
    """Whether a model to which nothing more was added leaves more than noise in either data, and it matters."""
    return leaves_more_than_noise(found) and matters(found)


def leaves_more_than_noise(found: Round) -> bool:
    """Whether a model to which nothing more was added leaves more than noise in either data, by the omnibus test."""
    return found.accepted is None and min(found.omnibus.p_value, found.held.p_value) < MORE_THAN_NOISE


def matters(found: Round) -> bool:
    """Whether the error is larger than the twins', or a force: the errors of a reconstruction are structured otherwise
    than the twins', too.
    """
    return above_floor(found) or is_force(found)


def above_floor(found: Round) -> bool:
    """Whether the error is larger than the twins' in the fitted or in the held-out data."""
    return any(square > 0 for square in found.excess.values())


def asks_for_an_effect(found: Round) -> bool:
    """Whether the residual is beyond noise, or the model fits its own data and fails in the held-out ones by far."""
    return beyond_noise(found) or (fails_held_out(found) and glaring(found))


def glaring(found: Round) -> bool:
    """Whether the held-out error is much larger than the twins', in units of its noise."""
    return times_noise(found.held) > MUCH_MORE


def times_noise(size: Omnibus) -> float:
    """Mean square of a residual beside that of the twins."""
    return size.statistic / float(np.mean(size.twins))


def is_force(found: Round) -> bool:
    """Whether a smooth force on the body would remove most of the residual, as it would not of what an error
    of the reconstruction leaves, and as much in the held-out views as an effect has to, where that was asked.
    """
    if found.force is None:
        return False
    held = found.force.held
    return found.force.explained > MOST_REMOVED and held.enough(scored=True) and held.z > held.needed
