"""Few parameters, cheap residuals: damped Gauss-Newton with the sensitivities that the score test needs anyway."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.levenberg_marquardt import NormalEquations, damped_step
from pacnerf_lpo.identification.processes import each

LONGEST_STEP = 5.0
"""Of a parameter's scale, at first. Steps of that length that gain what they promise double it, failures quarter it."""
ATTEMPTS = 5
PROBE = 0.5  # of a parameter's scale
CONVERGED = 0.1  # of a parameter's scale
LEAST_GAIN = 2e-3
PATIENCE = 2
LIVELY = 0.15
TRUSTED = 0.6
"""A Jacobian is updated, not measured again, while steps gain this part of what it promises."""
OLDEST = 3
"""Steps after which a Jacobian is measured again."""
Residual = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Fit:
    """Where a fit ended.

    free: coordinates [(K,)]
    residual: whitened residual there [(D,)]
    """

    free: np.ndarray
    residual: np.ndarray

    @property
    def misfit(self) -> float:
        """Sum of squares."""
        return float(self.residual @ self.residual)


def fit(
    residual: Residual,
    start: np.ndarray,
    scales: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    iterations: int,
    report: Callable[[int, float, np.ndarray], None] = lambda *_: None,
    hopeless: float | None = None,
) -> Fit:
    """Minimise ||residual||^2 (Levenberg-Marquardt), with one-sided differences.

    One residual costs a simulation, a Jacobian one for each unknown; so a Jacobian that keeps its promises is only
    updated by what the last step showed (Broyden 1965).

    Args:
        residual: of free coordinates [(K,)]; may raise SimulationError anywhere but at the start.
        start: free coordinates to begin with [(K,)]
        scales: noticeable change of each [(K,)]
        bounds: least and largest value of each [(K,), (K,)]
        iterations: at most.
        report: called with iteration, misfit and coordinates.
        hopeless: a misfit above this ends the fit after :data:`PATIENCE` iterations, unless it still falls by a good
            part in each, or as promised by a step that could not be longer; None: never.

    Raises:
        SimulationError: the motion at ``start`` is unstable.
    """
    free, now, damping = start.copy(), residual(start), 1e-2
    scaled, age, longest = sensitivities(residual, free, now, scales, bounds) * scales, 0, LONGEST_STEP
    for iteration in range(iterations):
        report(iteration, float(now @ now), free)
        for _ in range(ATTEMPTS):
            low, high = (np.clip((bound - free) / scales, -longest, longest) for bound in bounds)
            step = _step_within(scaled, now, damping, low, high)
            trial = np.clip(free + step * scales, *bounds)
            after = _or_infinite(residual, trial, now)
            if after @ after < now @ now:
                break
            if age > 0:
                scaled, age = sensitivities(residual, free, now, scales, bounds) * scales, 0
            else:
                damping, longest = 5 * damping, max(longest / 4, LONGEST_STEP)
        else:
            break
        step = (trial - free) / scales
        moved, change = np.abs(step).max(), after - now - scaled @ step
        gain, promised = 1 - (after @ after) / (now @ now), now @ now - np.sum((now + scaled @ step) ** 2)
        kept = now @ now - after @ after > TRUSTED * promised
        stretched = kept and moved > 0.99 * longest
        if stretched:
            longest *= 2
        free, now, damping, age = trial, after, max(damping / 5, 1e-7), age + 1
        far = hopeless is not None and now @ now > hopeless
        lost = far and iteration + 1 >= PATIENCE and gain < LIVELY and not stretched
        if lost or (age == 1 and (moved < CONVERGED or gain < LEAST_GAIN)):
            break
        if kept and age < OLDEST and moved >= CONVERGED and gain >= LEAST_GAIN:
            scaled = scaled + np.outer(change, step) / (step @ step)
        elif iteration + 1 < iterations:
            scaled, age = sensitivities(residual, free, now, scales, bounds) * scales, 0
    return Fit(free, now)


def fit_or_none(
    residual: Residual,
    start: np.ndarray,
    scales: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    iterations: int,
    hopeless: float | None = None,
) -> Fit | None:
    """:func:`fit`, or None where the motion at the start is unstable."""
    try:
        return fit(residual, start, scales, bounds, iterations, hopeless=hopeless)
    except SimulationError:
        return None


def _step_within(scaled: np.ndarray, now: np.ndarray, damping: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The damped step between two ends [scales, (K,)]."""
    model = NormalEquations(float(now @ now), torch.as_tensor(scaled.T @ now), torch.as_tensor(scaled.T @ scaled))
    return damped_step(model, damping, torch.as_tensor(low), torch.as_tensor(high)).numpy()


def sensitivities(
    residual: Residual, free: np.ndarray, now: np.ndarray, scales: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Derivative of the residual [(D, K)]; each unknown is moved by half its scale, away from a bound."""
    columns = each(_column, ((residual, free, now, k, scale, bounds[1][k]) for k, scale in enumerate(scales)))
    return np.stack(list(columns), axis=1)


def _column(
    residual: Residual, free: np.ndarray, now: np.ndarray, index: int, scale: float, highest: float
) -> np.ndarray:
    """Derivative of the residual by one unknown [(D,)]; 0 where the motion is unstable to either side."""
    for sign in (1.0, -1.0) if free[index] + PROBE * scale < highest else (-1.0, 1.0):
        moved = free.copy()
        moved[index] += sign * PROBE * scale
        try:
            return (residual(moved) - now) / (sign * PROBE * scale)
        except SimulationError:
            continue
    return np.zeros_like(now)


def _or_infinite(residual: Residual, free: np.ndarray, like: np.ndarray) -> np.ndarray:
    try:
        return residual(free)
    except SimulationError:
        return np.full_like(like, np.inf)
