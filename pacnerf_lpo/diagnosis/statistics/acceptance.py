"""Did adding the effect help where the model was not fitted?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from pacnerf_lpo.inference.layout import Layout
from pacnerf_lpo.inference.noise import NoiseModel

STANDARD_ERRORS = 2.0
LEAST_REMOVED = 0.25
"""Share of the excess error that an effect has to remove, in the held-out and in the fitted data: a reconstruction has
errors that twins do not know, and some effect or other always imitates a part of them significantly.
"""
MOST_REMOVED = 2 / 3
"""The same where an error of a reconstructed shape leaves something alike."""
BELOW_FLOOR = 2.0
"""Times what is needed otherwise, an effect has to foretell held-out data whose error is no larger than the noise: one
direction among many can stand out where their sum does not.
"""
LARGEST_DRIFT = 0.5
"""Change of the coefficient under grid refinement that still counts as survival, as part of the coefficient."""


@dataclass(frozen=True)
class Verdict:
    """Whether an effect is accepted.

    accepted: all criteria passed
    removed: share of the held-out excess error that the effect removes, see :class:`HeldOut`
    z: how well it foretells the held-out residual, in standard errors
    reasons: (criterion passed, sentence)
    """

    accepted: bool
    removed: float
    z: float
    reasons: list[tuple[bool, str]]


@dataclass(frozen=True)
class HeldOut:
    """The held-out residual without and with an effect, whitened.

    before, after: its mean square; about 1 where the model is right
    floor: the same of left-out twins
    falls: views in which it falls, of how many; those do not count whose error is within the noise before and after
    z: how well the change that the effect makes agrees with the residual, in standard errors
    needed: what counts as two standard errors, with so few twins
    least: share of the error above the floor that has to be removed
    """

    before: float
    after: float
    floor: float
    falls: tuple[int, int]
    z: float
    needed: float
    least: float = LEAST_REMOVED

    @property
    def removed(self) -> float:
        """Share of the error above the floor that the effect removes, at most 1; of the whole where none is above."""
        fall = self.before - self.after
        return min(fall / (self.before - self.floor), 1.0) if self.above_floor else fall / max(self.before, 1e-300)

    @property
    def above_floor(self) -> bool:
        """Whether the error without the effect is larger than that of left-out twins."""
        return self.before > self.floor

    def enough(self, scored: bool) -> bool:
        """Whether the error falls enough; where it could not fall below the noise, whether an effect that the score
        test has named foretells it all the better.
        """
        if self.above_floor:
            return self.removed >= self.least
        return scored and self.z > BELOW_FLOOR * self.needed


def held_out_noise(
    noise: NoiseModel,
    jacobian: np.ndarray,
    twins: np.ndarray,
    held_jacobian: np.ndarray,
    sensor_sigma: np.ndarray,
    layout: Layout,
    directions: np.ndarray | None = None,
) -> NoiseModel:
    """Noise of what was not fitted: of every twin and every error known beforehand, what a fit of the parameters to its
    fitted entries leaves there.

    Args:
        noise: of the fitted entries, learnt from the same twins
        jacobian: sensitivities of the fitted entries to the parameters (D, P)
        twins: in the held-out entries (T, H)
        held_jacobian: sensitivities there (H, P)
        sensor_sigma: standard deviation of the sensor noise there (H,)
        layout: view, frame and kind there
        directions: the errors known beforehand in the held-out entries (H, M)

    Raises:
        ValueError: as :meth:`NoiseModel.from_twins`.
    """
    known = np.zeros((len(sensor_sigma), 0)) if directions is None else directions
    wanted = np.concatenate(((noise.twins - noise.mean).T, noise.directions), axis=1)
    steps, *_ = np.linalg.lstsq(noise.whiten(jacobian), noise.whiten(wanted), rcond=1e-8)
    left = np.concatenate((twins.T, known), axis=1) - held_jacobian @ steps
    return NoiseModel.from_twins(left[:, : len(twins)].T, sensor_sigma, layout, left[:, len(twins) :])


def judge_held_out(noise: NoiseModel, before: np.ndarray, after: np.ndarray, least: float = LEAST_REMOVED) -> HeldOut:
    """Compare held-out residuals without and with an effect.

    The component of the whitened residual along a given change is standard normal where the effect is not there. Its
    standard deviation is taken as that of left-out twins, or as the root mean square of what is left with the effect,
    where these are larger than one. Views that were held out show the same numerical errors of the motion as the
    others, so it is the family-wise threshold of the score test that guards against false alarms; this one tells
    whether the effect as it was fitted goes on to hold.

    Args:
        noise: of the held-out entries, see :func:`held_out_noise`
        before, after: residuals there without and with the effect, refitted (H,)
        least: share of the excess that has to be removed
    """
    change = noise.whiten(before - after)
    first, left = noise.whiten_residual(before), noise.whiten_residual(after)
    twins = [(model.whiten(before - after), model.whiten_residual(twin)) for model, twin in noise.left_out]
    floor = float(np.mean([np.mean(twin**2) for _, twin in twins]))
    along = float(np.mean([_along(direction, twin) ** 2 for direction, twin in twins]))
    spread = np.sqrt(max(1.0, along, float(np.mean(left**2))))
    falls = _falls(noise.layout.view, first, left, [twin for _, twin in twins])
    return HeldOut(
        float(np.mean(first**2)),
        float(np.mean(left**2)),
        floor,
        (int(falls.sum()), len(falls)),
        _along(change, first) / float(spread),
        float(student.isf(norm.sf(STANDARD_ERRORS), len(noise.twins) - 1)),
        least,
    )


def acceptance(
    held: HeldOut,
    misfits: tuple[float, float],
    floor: float,
    coefficients: int,
    interval: tuple[float, float],
    null: float,
    scored: bool,
) -> Verdict:
    """Judge an added effect.

    Args:
        held: the held-out residual without and with it
        misfits: whitened sums of squares in the fitted data without and with it; the fall has to be worth its
            coefficients (Akaike 1974), and ``held.least`` of what is above the floor
        floor: the whitened sum of squares that noise alone leaves in the fitted data
        coefficients: how many it has
        interval: of the coefficient [its unit]
        null: value of the coefficient at which the effect vanishes
        scored: whether the score test has named it; alternatives of kind are tried anyway
    """
    better, views = held.falls
    fall, excess = misfits[0] - misfits[1], misfits[0] - floor
    worth, enough = fall > 2 * coefficients, fall >= held.least * excess
    gets = "gets no better" if not worth else "gets better" if enough else "hardly gets better"
    reasons = [
        (worth and enough, f"the fit {gets} ({misfits[0]:.0f} to {misfits[1]:.0f}, {floor:.0f} is noise)"),
        (held.enough(scored), _fall_sentence(held, scored)),
        (held.z > held.needed, _foretold_sentence(held)),
        (2 * better > views, f"the error falls in {better} of {views} views"),
        _interval_reason(interval, null),
    ]
    return Verdict(all(passed for passed, _ in reasons), held.removed, held.z, reasons)


def survival(verdict: Verdict, coarse: float, fine: float) -> Verdict:
    """The verdict when the coefficient was estimated on a finer grid, too; both counted from the null [its unit]."""
    survives = abs(fine - coarse) <= LARGEST_DRIFT * abs(coarse)
    verb = "survives" if survives else "does not survive"
    sentence = f"the coefficient {verb} a finer grid ({coarse:.3g} from the null, then {fine:.3g})"
    return replace(verdict, accepted=verdict.accepted and survives, reasons=[*verdict.reasons, (survives, sentence)])


def _falls(views: np.ndarray, first: np.ndarray, left: np.ndarray, twins: list[np.ndarray]) -> np.ndarray:
    """Where the error falls, of the views in which it is, before or after, larger than that of every left-out twin; of
    all where it is in none.
    """
    _, view = np.unique(views, return_inverse=True)
    before, after = np.bincount(view, first**2), np.bincount(view, left**2)
    noise = np.max([np.bincount(view, twin**2) for twin in twins], axis=0)
    counts = np.maximum(before, after) > noise
    return (before > after)[counts if counts.any() else slice(None)]


def _along(direction: np.ndarray, vector: np.ndarray) -> float:
    return float(direction @ vector) / max(float(np.linalg.norm(direction)), 1e-300)


def _fall_sentence(held: HeldOut, scored: bool) -> str:
    if not held.above_floor:
        but = ", but the effect stands out of it" if held.enough(scored) else ""
        return f"the held-out error was not above the noise floor before{but}"
    verb = "falls" if held.removed > 0 else "rises"
    enough = "" if held.removed >= held.least or held.removed <= 0 else f", less than {held.least:.0%}"
    return f"the held-out excess error {verb} by {abs(held.removed):.0%}{enough}"


def _foretold_sentence(held: HeldOut) -> str:
    verb = "foretells" if held.z > held.needed else "does not foretell"
    return f"the effect {verb} the held-out residual (z = {held.z:.1f}, {held.needed:.1f} needed)"


def _interval_reason(interval: tuple[float, float], null: float) -> tuple[bool, str]:
    excluded = not interval[0] <= null <= interval[1]
    verb = "excludes" if excluded else "includes"
    return excluded, f"the coefficient's interval [{interval[0]:.3g}, {interval[1]:.3g}] {verb} {null:g}, no effect"
