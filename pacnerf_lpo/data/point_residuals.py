"""Measured points against simulated particles: points by attachment to the material, clouds by statistics."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, interp1d
from scipy.spatial import cKDTree

from pacnerf_lpo.data.measurements import PointClouds, TrackedPoints
from pacnerf_lpo.errors import UserInputError

NEIGHBOURS = 16
FARTHEST = 4.0
"""A tracked point may start this many typical particle distances outside the body."""
TRIM = 0.9
TAIL = 0.02
LARGEST_CLOUD = 4000
LARGEST_CARRIED = 1500
RESAMPLES = 24
CLOUD_KINDS = (
    *(f"cloud {axis}" for axis in "xyz"),
    *(f"cloud spread {pair}" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")),
    *(f"cloud {end} {axis}" for end in ("low", "high") for axis in "xyz"),
    "cloud distance",
)
"""Names of the statistics of a cloud, all in metres."""
UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class Attachment:
    """Tracked points as affine combinations of particles: x_k(t) = sum_n weights[k, n] x[neighbours[k, n]](t).

    names: of the points (K,)
    neighbours: particle numbers (K, n)
    weights: sum to 1, and reproduce the point where it was first seen (K, n)
    first: time at which it was first seen [s, (K,)]
    """

    names: np.ndarray
    neighbours: np.ndarray
    weights: np.ndarray
    first: np.ndarray


@dataclass(frozen=True)
class TrackResiduals:
    """Measured minus model of every sighting after the first, which is zero by construction.

    residual: [m, (M, 3)]
    times: [s, (M,)]
    ids: (M,)
    """

    residual: np.ndarray
    times: np.ndarray
    ids: np.ndarray


def attach(tracks: TrackedPoints, trajectory: np.ndarray, times: np.ndarray, farthest: float = FARTHEST) -> Attachment:
    """Tie every tracked point to the particles near it where it is first seen. Raises UserInputError where a point
    starts away from the body.

    The weights are those of moving least squares of first order (Lancaster and Salkauskas 1981), so that the point
    follows every affine motion of its surroundings exactly, rotation included, also from slightly outside the body. The
    particles are given at every frame [m, (F, N, 3)] with its time [s, (F,)]; ``farthest`` is how far outside a point
    may start [median distances of a particle to its nearest neighbour].
    """
    names, rows = np.unique(tracks.ids, return_index=True)
    points, first = tracks.positions[rows], tracks.times[rows]
    reach = farthest * float(np.median(cKDTree(trajectory[0]).query(trajectory[0], k=2)[0][:, 1]))
    moments, moment = np.unique(first, return_inverse=True)
    count = min(NEIGHBOURS, trajectory.shape[1])
    neighbours, weights = np.empty((len(names), count), int), np.empty((len(names), count))
    for when, body in enumerate(at_times(trajectory, times, moments)):
        own = np.flatnonzero(moment == when)
        distances, neighbours[own] = cKDTree(body).query(points[own], k=count)
        weights[own] = _affine_weights(body[neighbours[own]] - points[own, None], distances[:, -1])
        worst = int(distances[:, 0].argmax())
        if distances[worst, 0] > reach:
            raise UserInputError(
                f"{tracks.source}: id {names[own[worst]]} is first seen {distances[worst, 0]:.3g} m away from the "
                f"body, at {moments[when]:g} s; check units, axes (y is up) and the clock, or remove the point"
            )
    return Attachment(names, neighbours, weights, first)


def track_residuals(
    tracks: TrackedPoints, attachment: Attachment, trajectory: np.ndarray, times: np.ndarray
) -> TrackResiduals:
    """Compare tracked points with the material they are attached to, cubic in time between frames. Arguments as of
    :func:`attach`.
    """
    point = np.searchsorted(attachment.names, tracks.ids)
    later = tracks.times > attachment.first[point]
    point, when = point[later], tracks.times[later]
    model = at_times(_carried(attachment, trajectory), times, when)[np.arange(len(when)), point]
    return TrackResiduals(tracks.positions[later] - model, when, tracks.ids[later])


def cloud_residuals(clouds: PointClouds, trajectory: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Measured minus model statistics of every cloud [m, (C, 16)], in the order of CLOUD_KINDS.

    The model's cloud consists of the points of the first measured one, carried along by the material, so that clouds of
    the surface are compared with the surface; the first residual is zero by construction. The last summary is the
    trimmed mean distance from the cloud's points to their nearest particle: one-sided, so that a cloud of a part of the
    body, seen from one side, is not blamed for what it does not show. Arguments as of :func:`attach`.
    """
    first = _thinned(clouds.points[0], LARGEST_CARRIED)
    ids, starts = np.arange(len(first)), np.full(len(first), clouds.times[0])
    marks = TrackedPoints(starts, ids, first, np.zeros(len(first)), clouds.source)
    carried = _carried(attach(marks, trajectory, times, np.inf), trajectory)
    residuals = []
    for points, model, particles in zip(
        clouds.points, at_times(carried, times, clouds.times), at_times(trajectory, times, clouds.times), strict=True
    ):
        points = _thinned(points, LARGEST_CLOUD)
        distance = _trimmed(cKDTree(particles).query(points)[0])
        residuals.append(np.append(cloud_summary(points) - cloud_summary(model), distance))
    found = np.array(residuals)
    return found - found[:1]


def cloud_sigma(clouds: PointClouds, body: np.ndarray) -> np.ndarray:
    """Standard deviation of the statistics of every cloud [m, (C, 16)], from resampling its points. Particles at any
    time [m, (N, 3)], moved to every cloud, show how distances scatter.
    """
    centred, found = body - body.mean(0), []
    for points, noise in zip(clouds.points, clouds.sigma, strict=True):
        points = _thinned(points, LARGEST_CLOUD)
        distances = cKDTree(centred).query(points - points.mean(0))[0]
        random = np.random.default_rng(0)
        draws = [random.integers(0, len(points), len(points)) for _ in range(RESAMPLES)]
        spread = np.std([np.append(cloud_summary(points[d]), _trimmed(distances[d])) for d in draws], axis=0, ddof=1)
        found.append(np.maximum(np.hypot(spread, noise / np.sqrt(len(points))), 1e-6))
    return np.array(found)


def cloud_summary(points: np.ndarray) -> np.ndarray:
    """Centroid, symmetric root of the covariance, and where the outermost 2 % of points [m, (n, 3)] begin on each side
    [m, (15,)].
    """
    centre = points.mean(0)
    variances, axes = np.linalg.eigh(np.cov(points.T))
    root = (axes * np.sqrt(np.maximum(variances, 0.0))) @ axes.T
    ends = np.quantile(points, (TAIL, 1 - TAIL), axis=0)
    return np.concatenate((centre, root[UPPER], ends.ravel()))


def at_times(trajectory: np.ndarray, times: np.ndarray, when: np.ndarray) -> np.ndarray:
    """Positions of a trajectory [m, (F, ..., 3)], with times [s, (F,)], at other times ``when`` [s, (n,)], clipped to
    the simulated interval [m, (n, ..., 3)]: a cubic spline, linear with fewer than four frames.
    """
    when = np.clip(when, times[0], times[-1])
    if len(times) == 1:
        return np.repeat(trajectory, len(when), axis=0)
    curve = CubicSpline(times, trajectory) if len(times) > 3 else interp1d(times, trajectory, axis=0)
    return curve(when)


def _affine_weights(offsets: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """w = f (1, o) a with sum w = 1 and sum w o = 0 [(K, n)], from the offsets o of the neighbours of each point
    [m, (K, n, 3)]; f falls with the distance relative to that of the farthest, ``reach`` [m, (K,)].
    """
    scaled = offsets / np.maximum(reach, 1e-12)[:, None, None]
    fall = np.exp(-2 * (scaled**2).sum(-1))
    basis = np.concatenate((np.ones((*fall.shape, 1)), scaled), axis=-1)
    moments = np.einsum("kni,kn,knj->kij", basis, fall, basis)
    weights = fall * np.einsum("kni,ki->kn", basis, np.linalg.pinv(moments, rcond=1e-8)[..., 0])
    return weights / weights.sum(-1, keepdims=True)


def _carried(attachment: Attachment, trajectory: np.ndarray) -> np.ndarray:
    """Where attached points are [m, (F, K, 3)] when the particles are at [m, (F, N, 3)]."""
    return np.einsum("fkni,kn->fki", trajectory[:, attachment.neighbours], attachment.weights)


def _thinned(points: np.ndarray, most: int) -> np.ndarray:
    """At most so many of the points [(n, 3)], evenly spread over their order."""
    return points[:: -(-len(points) // most)]


def _trimmed(distances: np.ndarray) -> float:
    """Mean of the smaller 90 %."""
    return float(np.sort(distances)[: max(1, int(TRIM * len(distances)))].mean())
