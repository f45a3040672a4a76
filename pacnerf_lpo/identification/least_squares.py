"""Nonlinear least squares for few unknowns and residuals that cost a simulation each (Levenberg 1944, Marquardt 1963).

The Jacobian is measured by one-sided differences and then updated by what the steps show (Broyden 1965). A fit that
decides ends with lines through the residual, as wide as its unknowns are known. Where the residual cannot be computed,
because the simulation is unstable, the step has failed, and the next one is shorter.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg import eigh

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.levenberg_marquardt import NormalEquations, damped_step
from pacnerf_lpo.identification.linearisation import slopes_around
from pacnerf_lpo.identification.processes import each

LONGEST_STEP = 5.0
"""Of an unknown's scale, at first. Steps of that length that gain what they promise double it, failures shorten it."""
PROBES = (0.5, -0.5, 0.1, -0.1)
"""Of an unknown's scale: changes by which a sensitivity is measured; the later ones where the motion is unstable."""
CONVERGED = 0.1
"""Of an unknown's scale: a change that nobody would notice. Steps from a point become shorter until they are that."""
LEAST_GAIN = 5e-4
"""Part of the cost: a step that gains less is not worth the simulations of another Jacobian."""
ROUGH_GAIN = 1e-2
"""The same for a fit that another one follows."""
PATIENCE = 2
LIVELY = 0.15
"""Part of the cost: a fit far above ``abort_above`` goes on only while each step gains that much."""
TRUSTED = 0.6
"""A Jacobian is updated, not measured again, while steps gain this part of what it promises."""
MOST_SURPRISES = 2
"""Steps that gain less than that before the Jacobian is measured again."""
LINES, CLOSE, FARTHEST = 4, 0.5, 4.0
"""A fit that ends with lines through the residual has at most so many, each around the optimum of the one before it. A
step of so many posterior standard deviations is not worth another line; after one of more than so many the descent goes
on."""
TOO_SHORT = 0.25
"""Of the information that was expected along some axis: a line that finds less goes through points that are less than
half as far apart as they should be."""
TOLERATED = 1.0
"""Rise of the cost on such a step, in units of the noise: that of one unknown by one standard deviation, and of a dent.
"""
Residual = Callable[[np.ndarray], np.ndarray]
Bounds = tuple[np.ndarray, np.ndarray]
Report = Callable[[int, float, np.ndarray], None]


@dataclass(frozen=True)
class Fit:
    """Where a fit ended.

    free: coordinates [(K,)]
    residual: there, in units of its error, as it is or by a line [(D,)]
    jacobian: derivative of the residual, measured or updated there [(D, K)]; None: not known.
    rollouts: how often the residual was computed.
    of: the function that has this residual there; None: another one.
    """

    free: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray | None = None
    rollouts: int = 0
    of: Residual | None = None

    @property
    def cost(self) -> float:
        """Sum of squares."""
        return float(self.residual @ self.residual)

    def cost_of(self, rows: np.ndarray | None) -> float:
        """Sum of squares over some rows [(D,), bool]; None: all."""
        seen = self.residual if rows is None else self.residual[rows]
        return float(seen @ seen)


@dataclass(frozen=True)
class Effort:
    """When a fit ends.

    iterations: accepted steps, at most.
    abort_above: a cost above this ends the fit after :data:`PATIENCE` iterations, unless it still falls by a good part
        in each, or as promised by a step that could not be longer; None: never.
    confirm: end only with a Jacobian that was measured, not updated: where no step gains anything, or after the last
        iteration.
    remeasured: how often the Jacobian is measured again at most; from then on it is only updated.
    widest: the fit ends with lines through the residual (:mod:`~.linearisation`), at points that are at most so far
        away in each coordinate [(K,)], where residuals are in units of their errors, and not with a measured Jacobian;
        None: it ends where the descent does.
    """

    iterations: int
    abort_above: float | None = None
    confirm: bool = True
    remeasured: float = np.inf
    widest: np.ndarray | None = None


Start = np.ndarray | Fit
"""Free coordinates to begin with [(K,)], or a fit."""


def fit(
    residual: Residual,
    start: Start,
    scales: np.ndarray,
    bounds: Bounds,
    effort: Effort,
    report: Report = lambda *_: None,
    rows: np.ndarray | None = None,
) -> Fit:
    """Minimise ||residual[rows]||^2 within bounds.

    Args:
        residual: of free coordinates [(K,)] to [(D,)]; may raise SimulationError anywhere but at the start.
        start: free coordinates to begin with [(K,)], or a fit of this or a similar residual, whose Jacobian serves
            until steps contradict it.
        scales: noticeable change of each coordinate [(K,)]
        bounds: least and largest value of each [(K,), (K,)]
        effort: when it ends.
        report: called with iteration, cost and coordinates.
        rows: which of the residual count [(D,), bool]; None: all. The Jacobian is that of all.

    Raises:
        SimulationError: the motion at ``start`` is unstable.
    """
    return _Descent(residual, start, scales, bounds, rows, effort).run(report)


def fit_or_none(residual: Residual, start: Start, *settings, **more) -> Fit | None:
    """:func:`fit`, or None where the motion at the start is unstable."""
    try:
        return fit(residual, start, *settings, **more)
    except SimulationError:
        return None


class _Descent:
    """A fit on its way; arguments as of :func:`fit`."""

    def __init__(
        self,
        residual: Residual,
        start: Start,
        scales: np.ndarray,
        bounds: Bounds,
        rows: np.ndarray | None,
        effort: Effort,
    ):
        self.effort = effort
        self.residual, self.scales, self.bounds, self.rollouts = residual, scales, bounds, 0
        known = start if isinstance(start, Fit) else Fit(start, np.zeros(0))
        self.free = np.clip(known.free, *bounds)
        self.now = known.residual if known.of == residual else self._at(self.free)
        self.rows = np.ones(len(self.now), bool) if rows is None else rows
        self.damping, self.longest, self.age, self.surprises, self.remeasured = 1e-2, LONGEST_STEP, 1, 0, np.inf
        if known.jacobian is None or len(known.jacobian) != len(self.now):
            self._measure()
        else:
            self.scaled = known.jacobian * scales
        self.remeasured = effort.remeasured

    @property
    def cost(self) -> float:
        return _square(self.now[self.rows])

    def run(self, report: Report) -> Fit:
        """Steps until nothing is gained, then lines, if it ends with these."""
        near = self._descend(report)
        return self._on_lines(report, self.effort.widest) if near and self.effort.widest is not None else self._ended()

    def _descend(self, report: Report) -> bool:
        """Steps until nothing is gained; False where the fit is given up."""
        iterations, most = self.effort.iterations, self.effort.abort_above
        least = LEAST_GAIN if self.effort.confirm else ROUGH_GAIN
        measured = self.effort.confirm and self.effort.widest is None
        for iteration in range(iterations):
            report(iteration, self.cost, self.free)
            before = self.cost
            stepped = self._step()
            if stepped is None:
                break
            moved, kept, stretched = stepped
            gain = 1 - self.cost / before
            far = most is not None and self.cost > most
            small = moved < CONVERGED or gain < least
            if far and iteration + 1 >= PATIENCE and gain < LIVELY and not stretched:
                return False
            if small and (self.age <= 1 or not measured):
                break
            self.surprises += not kept
            last = iteration + 1 == iterations
            uncertain = measured if last else small or self.surprises >= MOST_SURPRISES
            if uncertain and self.remeasured > 0:
                self._measure()
        return True

    def _ended(self) -> Fit:
        return Fit(self.free, self.now, self.scaled / self.scales, self.rollouts, self.residual)

    def _step(self) -> tuple[float, bool, bool] | None:
        """One step that lowers the cost: its length in scales, whether it gained about what was promised, and whether
        it might have been longer; None where there is none.
        """
        moved = np.inf
        while moved > CONVERGED:
            step = self._best_step(self.scaled[self.rows], self.scales, self.damping, self.longest)
            moved = np.abs(step).max()
            trial = np.clip(self.free + step * self.scales, *self.bounds)
            try:
                after = self._at(trial)
            except SimulationError:
                self.damping, self.longest = 5 * self.damping, min(self.longest, moved) / 2
                continue
            promised = self.cost - _square((self.now + self.scaled @ step)[self.rows])
            gained = self.cost - _square(after[self.rows])
            change = after - self.now - self.scaled @ step
            if gained > 0:
                kept = gained > TRUSTED * promised
                stretched = kept and moved > 0.99 * self.longest
                self.longest *= 2 if stretched else 1
                self.damping, self.age = max(self.damping / 5, 1e-7), self.age + 1
                self.free, self.now = trial, after
                if moved > 0:
                    self.scaled = self.scaled + np.outer(change, step) / (step @ step)
                return float(moved), kept, stretched
            if self.age > 0 and self.remeasured > 0:
                self._measure()
                moved = np.inf
            else:
                self.damping, self.longest = 5 * self.damping, max(min(self.longest, moved) / 2, CONVERGED)
        return None

    def _best_step(self, slopes: np.ndarray, units: np.ndarray, damping: float, longest: float) -> np.ndarray:
        """The damped step within the bounds, at most so long, in units of the coordinates (K,), by the slopes of the
        rows that count (D', K).
        """
        now, ends = self.now[self.rows], (np.stack(self.bounds) - self.free) / units
        low, high = torch.as_tensor(np.clip(ends, -longest, longest))
        model = NormalEquations(_square(now), torch.as_tensor(slopes.T @ now), torch.as_tensor(slopes.T @ slopes))
        return damped_step(model, damping, low, high).numpy()

    def _measure(self) -> None:
        jacobian, used = _jacobian(self.residual, self.free, self.now, self.scales, self.bounds)
        self.scaled, self.age, self.surprises = jacobian * self.scales, 0, 0
        self.rollouts += used
        self.remeasured -= 1

    def _on_lines(self, report: Report, widest: np.ndarray) -> Fit:
        """The optimum of a line through the residual, around the optimum of the one before or where a descent by its
        slopes ends.
        """
        slopes, least = self.scaled / self.scales, PROBES[0] * self.scales
        for left in reversed(range(LINES)):
            before = slopes[self.rows] * widest
            at = self.free, self.now, slopes[self.rows]
            slopes, used = slopes_around(self.residual, *at, least, widest, self.bounds)
            self.rollouts += used
            seen = slopes[self.rows] * widest
            step = self._best_step(seen, widest, 0.0, FARTHEST)
            length = float(np.linalg.norm(seen @ step))
            share = float(eigh(seen.T @ seen, before.T @ before + 1e-12 * np.eye(len(step)), eigvals_only=True)[0])
            moved = left > 0 and length > CLOSE and self._moved(step * widest, length)
            if not left or not (moved or share < TOO_SHORT):
                break
            if moved and length > FARTHEST:
                self.scaled, self.age, self.surprises = slopes * self.scales, 0, 0
                if not self._descend(report):
                    return self._ended()
        step = step * widest * min(1.0, CLOSE / max(length, CLOSE))
        return Fit(self.free + step, self.now + slopes @ step, slopes, self.rollouts)

    def _moved(self, step: np.ndarray, length: float) -> bool:
        """Go as much of a step of so many standard deviations as does not raise the cost; whether that is any."""
        part = 1.0
        while part * length > CLOSE:
            trial = np.clip(self.free + part * step, *self.bounds)
            with suppress(SimulationError):
                after = self._at(trial)
                if _square(after[self.rows]) <= self.cost + TOLERATED:
                    self.free, self.now = trial, after
                    return True
            part /= 2
        return False

    def _at(self, free: np.ndarray) -> np.ndarray:
        self.rollouts += 1
        return self.residual(free)


def sensitivities(
    residual: Residual, free: np.ndarray, now: np.ndarray, scales: np.ndarray, bounds: Bounds
) -> np.ndarray:
    """Derivative of the residual [(D, K)] by one-sided differences away from a bound; 0 where the motion is unstable to
    either side.
    """
    return _jacobian(residual, free, now, scales, bounds)[0]


def _jacobian(
    residual: Residual, free: np.ndarray, now: np.ndarray, scales: np.ndarray, bounds: Bounds
) -> tuple[np.ndarray, int]:
    """:func:`sensitivities`, and how often the residual was computed."""
    columns = each(column, ((residual, free, now, k, scale, bounds[1][k]) for k, scale in enumerate(scales)))
    found, used = zip(*columns, strict=True)
    return np.stack(found, axis=1), sum(used)


def column(
    residual: Residual, free: np.ndarray, now: np.ndarray, index: int, scale: float, highest: float
) -> tuple[np.ndarray, int]:
    """Derivative of the residual by one unknown [(D,)], and how often the residual was computed."""
    side = 1.0 if free[index] + PROBES[0] * scale < highest else -1.0
    for used, probe in enumerate(PROBES, 1):
        moved = free.copy()
        moved[index] += side * probe * scale
        try:
            return (residual(moved) - now) / (side * probe * scale), used
        except SimulationError:
            continue
    return np.zeros_like(now), len(PROBES)


def _square(values: np.ndarray) -> float:
    return float(values @ values)
