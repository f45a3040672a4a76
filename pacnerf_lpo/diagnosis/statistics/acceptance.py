"""Did adding the effect help where the model was not fitted?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from pacnerf_lpo.diagnosis.layout import Layout
from pacnerf_lpo.diagnosis.statistics.noise import NoiseModel

STANDARD_ERRORS = 2.0
LARGEST_DRIFT = 0.5
"""Change of the coefficient under grid refinement that still counts as survival, as part of the coefficient."""


@dataclass(frozen=True)
class Verdict:
    """Whether an effect is accepted.

    accepted: all criteria passed
    removed: share of the held-out excess error that the effect removes
    z: how well it foretells the held-out residual, in standard errors
    improved: held-out views whose error falls, of how many
    reasons: (criterion passed, sentence)
    """

    accepted: bool
    removed: float
    z: float
    improved: tuple[int, int]
    reasons: list[tuple[bool, str]]


@dataclass(frozen=True)
class Foretold:
    """How well the change that an effect makes in held-out data agrees with the residual there.

    z: in standard errors.
    needed: what counts as two standard errors, with so few twins.
    """

    z: float
    needed: float


def held_out_noise(
    noise: NoiseModel,
    jacobian: np.ndarray,
    twins: np.ndarray,
    held_jacobian: np.ndarray,
    sensor_sigma: np.ndarray,
    layout: Layout,
) -> NoiseModel:
    """Noise of what was not fitted: of every twin, what a fit of the parameters to its fitted entries leaves there.

    Args:
        noise: of the fitted entries, learnt from the same twins
        jacobian: sensitivities of the fitted entries to the parameters (D, P)
        twins: in the held-out entries (T, H)
        held_jacobian: sensitivities there (H, P)
        sensor_sigma: standard deviation of the sensor noise there (H,)
        layout: view, frame and kind there

    Raises:
        ValueError: as :meth:`NoiseModel.from_twins`.
    """
    wanted = noise.whiten((noise.twins - noise.mean).T)
    steps, *_ = np.linalg.lstsq(noise.whiten(jacobian), wanted, rcond=1e-8)
    return NoiseModel.from_twins(twins - (held_jacobian @ steps).T, sensor_sigma, layout)


def foretold(noise: NoiseModel, before: np.ndarray, after: np.ndarray) -> Foretold:
    """Whether held-out residuals lie along the change that the effect makes there.

    The component of the whitened residual along a given change is standard normal where the effect is not there. Its
    standard deviation is taken as that of left-out twins, or as the root mean square of what is left with the effect,
    where these are larger than one. Views that were held out show the same numerical errors of the motion as the
    others, so it is the family-wise threshold of the score test that guards against false alarms; this one tells
    whether the effect as it was fitted goes on to hold.

    Args:
        noise: of the held-out entries, see :func:`held_out_noise`
        before, after: residuals there without and with the effect, refitted (H,)
    """
    change = noise.whiten(before - after)
    strength = float(np.linalg.norm(change))
    needed = float(student.isf(norm.sf(STANDARD_ERRORS), len(noise.twins) - 1))
    if strength == 0:
        return Foretold(0.0, needed)
    left = noise.whiten_residual(after)
    twins = [_along(model.whiten(before - after), model.whiten_residual(twin)) for model, twin in noise.left_out]
    spread = max(1.0, float(np.mean(np.square(twins))) ** 0.5, float(np.mean(left**2)) ** 0.5)
    return Foretold(_along(change, noise.whiten_residual(before)) / spread, needed)


def acceptance(
    told: Foretold,
    excess_before: np.ndarray,
    excess_after: np.ndarray,
    views: np.ndarray,
    interval: tuple[float, float],
    null: float,
    coefficient: float,
    refined: float | None = None,
) -> Verdict:
    """Judge an added effect on held-out blocks of view x frame.

    The removed share is the ratio sum (before - after) / sum before.

    Args:
        told: of the same held-out data
        excess_before, excess_after: mean square error less the noise floor of every block [px^2, (B,)], of the same
            measurements without and with the effect, refitted
        views: of every block (B,)
        interval: of the coefficient [its unit]
        null: value of the coefficient at which the effect vanishes
        coefficient: estimate [its unit]
        refined: estimate on a finer grid; None where that was not tried
    """
    fall = np.asarray(excess_before) - np.asarray(excess_after)
    total = float(np.sum(excess_before))
    removed = float(fall.sum()) / total if total > 0 else 0.0
    by_view = [float(fall[views == view].sum()) for view in np.unique(views)]
    better = sum(change > 0 for change in by_view)
    reasons = [
        (removed > 0, _fall_sentence(total, removed)),
        (told.z > told.needed, _foretold_sentence(told)),
        (2 * better > len(by_view), f"the error falls in {better} of {len(by_view)} held-out views"),
        _interval_reason(interval, null),
    ]
    if refined is not None:
        reasons.append(_refinement_reason(coefficient - null, refined - null))
    return Verdict(all(passed for passed, _ in reasons), removed, told.z, (better, len(by_view)), reasons)


def _along(direction: np.ndarray, vector: np.ndarray) -> float:
    return float(direction @ vector) / max(float(np.linalg.norm(direction)), 1e-300)


def _fall_sentence(total: float, removed: float) -> str:
    if total <= 0:
        return "the held-out error was not above the noise floor before"
    verb = "falls" if removed > 0 else "rises"
    return f"the held-out excess error {verb} by {abs(removed):.0%}"


def _foretold_sentence(told: Foretold) -> str:
    verb = "foretells" if told.z > told.needed else "does not foretell"
    return f"the effect {verb} the held-out residual (z = {told.z:.1f}, {told.needed:.1f} needed)"


def _interval_reason(interval: tuple[float, float], null: float) -> tuple[bool, str]:
    excluded = not interval[0] <= null <= interval[1]
    verb = "excludes" if excluded else "includes"
    return excluded, f"the coefficient's interval [{interval[0]:.3g}, {interval[1]:.3g}] {verb} {null:g}, no effect"


def _refinement_reason(coarse: float, fine: float) -> tuple[bool, str]:
    """Both counted from the null."""
    survives = abs(fine - coarse) <= LARGEST_DRIFT * abs(coarse)
    verb = "survives" if survives else "does not survive"
    return survives, f"the coefficient {verb} a finer grid ({coarse:.3g} from the null, then {fine:.3g})"
