"""Free fall and ground from tangent planes: acceleration, the height of the lowest point, contact. Pure NumPy.

The support function of a body that only moves is h(n, t) = n . c(t) + S(n). S is a short series of spherical harmonics,
which holds the shape as far as it matters to c.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pacnerf_lpo.data.recordings.tangents import Planes

MOTION = 9
"""Unknowns of the parabola, before those of the shape."""
DEGREE = 4
"""Of the harmonics of the shape."""
RIDGE = 1e-4
"""Weight of a small shape, relative to the planes, for directions in which no camera looks."""
LOWEST = np.radians(60.0)
"""Normals within about this angle of straight down count for the lowest point."""
FEWEST = 8
"""Planes that the lowest point and a place need at least."""
TINY = 1e-12
"""Keeps the square root differentiable where both half axes vanish, relative to the body."""


@dataclass(frozen=True)
class Ballistic:
    """A parabola through the places of a body: c(t) = start + velocity t + acceleration t^2 / 2.

    start, velocity, acceleration: [(3,) each, the recording's unit and seconds]
    error: standard error of the acceleration [(3,)]
    shape: coefficients of S
    """

    start: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    error: np.ndarray
    shape: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Places at the times [s, (T,)]: (T, 3)."""
        t = np.asarray(times)[:, None]
        return self.start + self.velocity * t + 0.5 * self.acceleration * t**2


def harmonics(normals: np.ndarray) -> np.ndarray:
    """All monomials of degree :data:`DEGREE` and of the degree below in the unit normals (N, 3) [(N, K)].

    They span the harmonics up to that degree. The one of degree 1, a translation, goes to the place by :data:`RIDGE`.
    """
    x, y, z = normals.T
    powers = [(i, j, k) for i, j, k in np.ndindex((DEGREE + 1,) * 3) if i + j + k in (DEGREE - 1, DEGREE)]
    return np.stack([x**i * y**j * z**k for i, j, k in powers], axis=-1)


def fit_ballistic(frames: Sequence[Planes], times: np.ndarray) -> Ballistic:
    """The parabola and the shape that fit the planes of three or more frames, at times [s, (F,)], by least squares."""
    pairs = [(planes.normals, time) for planes, time in zip(frames, times, strict=True)]
    rows = [np.hstack((n, n * time, 0.5 * n * time**2, harmonics(n))) for n, time in pairs]
    matrix, target = np.vstack(rows), np.concatenate([planes.offsets for planes in frames])
    penalty = np.zeros(matrix.shape[1])
    penalty[MOTION:] = RIDGE * len(target)  # holds the shape down
    normal = matrix.T @ matrix + np.diag(penalty)
    solution = np.linalg.solve(normal, matrix.T @ target)
    variance = np.mean((target - matrix @ solution) ** 2)
    spread = np.sqrt(variance * np.diag(np.linalg.inv(normal)))
    return Ballistic(solution[:3], solution[3:6], solution[6:MOTION], spread[6:MOTION], solution[MOTION:])


def places(frames: Sequence[Planes], shape: np.ndarray) -> np.ndarray:
    """Where a body of this shape is in each frame, by least squares; NaN in frames with too few planes [(F, 3)]."""
    found = np.full((len(frames), 3), np.nan)
    for number, planes in enumerate(frames):
        if len(planes.offsets) >= FEWEST:
            target = planes.offsets - harmonics(planes.normals) @ shape
            found[number] = np.linalg.lstsq(planes.normals, target, rcond=None)[0]
    return found


def lowest_point(planes: Planes, up: np.ndarray) -> float:
    """Height of a body's lowest point along ``up`` (3,), NaN where too little is seen.

    No camera above the ground has the ground's plane as a tangent plane, so the support function has to be continued
    from inclined normals to straight down. The body's lower side is taken as a flat disc of radius d, rounded by half
    an ellipsoid of revolution with half axes a (across) and b (along ``up``); with t the angle from straight down,
    h(n) = n . c + d sin t + sqrt(a^2 sin^2 t + b^2 cos^2 t). That is exact for balls, ellipsoids, discs and tori that
    lie flat.
    """
    down = -(planes.normals @ up)
    near = down > 0.0
    if near.sum() < FEWEST:
        return float("nan")
    normals, offsets, cosine = planes.normals[near], planes.offsets[near], np.clip(down[near], 0.0, 1.0)
    sine = np.sqrt(1.0 - cosine**2)
    weight = np.exp(-0.5 * (np.arccos(cosine) / LOWEST) ** 2)

    def root(x: np.ndarray) -> np.ndarray:
        return np.sqrt((x[4] * sine) ** 2 + (x[5] * cosine) ** 2 + TINY * radius**2)

    def residual(x: np.ndarray) -> np.ndarray:
        return weight * (normals @ x[:3] + x[3] * sine + root(x) - offsets)

    def jacobian(x: np.ndarray) -> np.ndarray:
        curved = np.stack((x[4] * sine**2, x[5] * cosine**2)) / root(x)
        return weight[:, None] * np.column_stack((normals, sine, curved.T))

    ball = np.linalg.lstsq(weight[:, None] * np.column_stack((normals, np.ones(len(sine)))), weight * offsets)[0]
    radius = max(float(ball[3]), 1e-3 * float(np.ptp(offsets)))
    start = np.array([*ball[:3], 0.1 * radius, radius, radius])
    lower = [-np.inf, -np.inf, -np.inf, 0.0, 0.0, 0.0]
    found = least_squares(residual, start, jacobian, bounds=(lower, np.inf), x_scale=radius).x
    return float(found[:3] @ up - found[5])
