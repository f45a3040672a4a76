"""Slopes of a rough residual where the unknowns may be by the data.

Outlines of a moved body change by hundredths of a pixel that only its particles cause, and a derivative over a short
way takes that for information. So the residual is computed at points as far away as the data tell from the middle, and
a line is fitted to it there (statistical linear regression; García-Fernández, Svensson, Morelande and Särkkä 2015,
iterated posterior linearisation).
"""

from collections.abc import Callable

import numpy as np

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.processes import each

REACH = 6.0
"""Standard deviations of the posterior along each of its axes, to either side, at which the residual is computed. What
particles at other places change has a square of about 20 in units of the noise, 545 outlines together; a line through
two points takes a quarter of that for information, which is a seventh of the square of so many deviations, but more
than that of two.
"""
NEARER = 4
"""Times that a point at which the motion is unstable is moved half of the way to the middle."""


def slopes_around(
    residual: Callable[[np.ndarray], np.ndarray],
    middle: np.ndarray,
    now: np.ndarray,
    slopes: np.ndarray,
    least: np.ndarray,
    widest: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, int]:
    """Slopes of a line through a residual [(D, K)], and how often that was computed.

    Args:
        residual: of free coordinates [(K,)] to [(D,)]; may raise SimulationError.
        middle, now: of the points [(K,)], and the residual there [(D,)]
        slopes: by which the posterior is known so far, of the rows that count, in units of their errors [(D', K)]
        least: a point is as far away as this in at least one coordinate [(K,)]
        widest: how far it is away at most [(K,)]
        bounds: least and largest value of each coordinate [(K,), (K,)]

    Returns:
        0 where the motion is unstable at all points.
    """
    seen = slopes * widest
    precisions, axes = np.linalg.eigh(seen.T @ seen)
    shortest = 1 / np.abs(axes * (widest / least)[:, None]).max(0)
    lengths = np.minimum(np.maximum(REACH / np.sqrt(np.maximum(precisions, 1e-12)), shortest), 1.0)
    ends = [middle + side * step * widest for step in (lengths * axes).T for side in (1, -1)]
    tried = list(each(_near, ((residual, middle, np.clip(end, *bounds)) for end in ends)))
    stable = [((point - middle) / widest, value - now) for point, value, _ in tried if value is not None]
    used = sum(used for _, _, used in tried)
    if not stable:
        return np.zeros((len(now), len(middle))), used
    ways, changes = (np.array(part) for part in zip(*stable, strict=True))
    return np.linalg.lstsq(ways, changes, rcond=1e-10)[0].T / widest, used


def _near(
    residual: Callable[[np.ndarray], np.ndarray], middle: np.ndarray, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None, int]:
    """A point from which the motion is stable, the residual there, and how often it was computed; None: there is none
    on the way to the middle.
    """
    for used in range(1, NEARER + 1):
        try:
            return point, residual(point), used
        except SimulationError:
            point = (point + middle) / 2
    return point, None, NEARER
