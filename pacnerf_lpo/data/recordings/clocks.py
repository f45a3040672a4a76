"""Which cameras run ahead or behind, from the outlines alone: for any motion, deforming or not. Pure NumPy.

A plane through the centres of two cameras that touches the body is a tangent of its outline in both images (epipolar
tangency: Cipolla, Astroem, Giblin 1995). So the two outermost angles around the line between two cameras are the same
function of time in both videos, and a camera that is late shows it later. No shape and no law of motion is assumed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from tqdm import tqdm

NOISE = 0.25
"""Error of an outermost angle, in pixels of the outline."""
POSE_ERROR = 0.5
"""Constant difference of two cameras by errors of their calibration [pixels]."""
WIDEST = np.radians(120.0)
"""Outlines wider than this around the line between two cameras contain the other camera, and say nothing."""
CAP = 0.5
"""Differences count up to this part of the outline's width: one wrong matte does not decide."""
MATCH = 0.03
"""Outlines that differ by less than this part of their width belong to one body at one time, as in ``agreement``."""
LEAST_FRAMES = 4
"""Frames that two cameras have in common at least."""
LATEST = 3.0
"""Cameras that people start by hand are this far apart at most [s]."""
STEPS = 8
"""Gauss-Newton steps, each at most half a frame; four are enough where the motion is smooth."""
EXACT = 1e-6
"""Times this near to a stamp, relative to a frame, are the stamp."""
ENOUGH = 4
"""Views from which on one that is wrong, or left out a frame, can be distinguished from the others."""
MISSING = 3
"""Frames in a row that a camera leaves out at most."""
JUMP = 8.0
"""What a missing frame costs, as the squared difference of one frame in units of a match: two or three frames must be
clearly wrong without it."""
SURE = 3.0
"""Offsets count from this many standard errors on."""
SMALLEST = 0.05
"""Offsets below this part of a frame are none: the motion between two frames hides it, and the timer's own jitter."""


@dataclass(frozen=True)
class Sighting:
    """What a camera saw of the body's outline in each of its own frames.

    pose: camera to world, OpenGL axes (3, 4)
    focal: focal length [pixels]
    times: as stamped [s, (F,)]
    points: outline in the image plane, x / z right and y / z up, of each frame [(K, 2) each, perhaps empty]
    inside: which of these points are away from the image border [(K,) each, bool]
    """

    pose: np.ndarray
    focal: float
    times: np.ndarray
    points: Sequence[np.ndarray]
    inside: Sequence[np.ndarray]


@dataclass(frozen=True)
class Clocks:
    """How much later than stamped each camera's frames were taken.

    offsets: [s, (V,)]; most cameras have 0. errors: standard errors [s, (V,)]. step: time between frames [s].
    """

    offsets: np.ndarray
    errors: np.ndarray
    step: float

    def said(self, names: Sequence[str]) -> str:
        """In one line: which cameras are out of step, and by how much."""
        late = [
            f"{name} {offset / self.step:+.2f} of a frame ({1e3 * offset:+.3g} ms, to {1e3 * error:.2g})"
            for name, offset, error in zip(names, self.offsets, self.errors, strict=True)
            if offset
        ]
        worst = float(np.nanmax(self.errors, initial=0.0)) / self.step
        return f"taken later than stamped: {', '.join(late)}" if late else f"in step, to {max(worst, 0.01):.2f} frames"


@dataclass(frozen=True)
class Curve:
    """Values [(F, ...)] of frames with stamps [s, (F,)], F at least 3, between these, by cubic Hermite interpolation
    with the slopes of parabolas through three frames.
    """

    values: np.ndarray
    stamps: np.ndarray

    @cached_property
    def _moves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time between frames [s, (F - 1, ...)], mean slope there, and the slope at each frame."""
        h = np.diff(self.stamps).reshape((-1, *(1,) * (self.values.ndim - 1)))
        slopes = np.gradient(self.values, self.stamps, axis=0, edge_order=2)
        return h, np.diff(self.values, axis=0) / h, slopes

    def at(self, times: np.ndarray) -> np.ndarray:
        """Values at times [s, (T,)]: (T, ...). NaN spreads to what needs it; outside, the parabola at the end goes on
        for one frame.
        """
        values, (h, rise, slopes) = self.values, self._moves
        begin = np.clip(np.searchsorted(self.stamps, times, side="right") - 1, 0, len(self.stamps) - 2)
        width = h[begin]
        s = (times - self.stamps[begin]).reshape(width.shape) / width
        before, after, moved = width * slopes[begin], width * slopes[begin + 1], width * rise[begin]
        bend = np.where((s < 0.0) | (s > 1.0), 0.0, s - 1.0) * (before + after - 2 * moved)
        first = np.where(s > 1.0, 2 * moved - after, before)
        curve = values[begin] + s * (first + s * (moved - first + bend))
        curve = np.where(np.abs(s) < EXACT, values[begin], np.where(np.abs(s - 1.0) < EXACT, values[begin + 1], curve))
        return np.where((s < -1.0) | (s > 2.0), np.nan, curve)


@dataclass(frozen=True)
class _Pair:
    """Outermost angles around the line between two cameras [rad, (2, F) each], stamps of their frames [s, (F,) each],
    and pixels per radian of both.
    """

    one: int
    other: int
    angles: tuple[np.ndarray, np.ndarray]
    stamps: tuple[np.ndarray, np.ndarray]
    sharpness: float
    width: float

    @cached_property
    def curves(self) -> list[Curve]:
        """The angles of both cameras between their frames, by the stamps of these."""
        return [Curve(angles.T, stamps) for angles, stamps in zip(self.angles, self.stamps, strict=True)]


def find_clocks(sightings: Sequence[Sighting]) -> Clocks:
    """Offsets of all cameras, in whole frames by search and in fractions by least squares.

    A camera whose outlines match those of the others at no time keeps its stamps: whether poses and mattes agree is
    another question. So do cameras that are in step, by a whole number of frames or none, within the error.
    """
    step = max(float(np.median(np.diff(sighting.times))) for sighting in sightings)
    pairs = list(_pairs(sightings))
    offsets, errors = _refined(pairs, step * _whole_frames(pairs, sightings, step), step)
    costs = ([_cost(pair, offsets, step)[1] for pair in _of(k, pairs)] for k in range(len(sightings)))
    fits = np.array([np.median(own or [np.inf]) < 1.0 for own in costs])
    if not fits.any():
        return Clocks(np.zeros(len(sightings)), errors, step)
    middle = np.median(offsets[fits])
    reference = offsets[fits][np.abs(offsets[fits] - middle).argmin()]
    offsets = np.where(fits & np.isfinite(errors), offsets - reference, 0.0)
    whole = step * np.round(offsets / step)
    apart = np.abs(offsets - whole) > np.maximum(SURE * np.nan_to_num(errors), SMALLEST * step)
    return Clocks(np.where(apart, offsets, whole), errors, step)


def find_missing(sightings: Sequence[Sighting], clocks: Clocks) -> Iterator[tuple[int, int, int]]:
    """Frames that cameras have left out without a gap in their stamps: camera, frame before which, and how many.

    Each frame of a camera is compared with the others' outlines at its own time and some frames earlier and later; the
    cheapest sequence of lags that never decreases shows where time jumps (Viterbi 1967). That needs other views enough
    to outvote one, :data:`ENOUGH` in all.
    """
    pairs, lags = list(_pairs(sightings)), np.arange(-MISSING, MISSING + 1)
    for camera in range(len(sightings) if len(sightings) >= ENOUGH else 0):
        times = sightings[camera].times + clocks.offsets[camera]
        costs = np.stack([_frame_costs(camera, pairs, clocks, times + lag * clocks.step) for lag in lags])
        total, came = costs[:, 0], []
        for cost in costs.T[1:]:
            before = [total[: lag + 1] + JUMP * (np.arange(lag + 1) < lag) for lag in range(len(lags))]
            came.append([int(row[::-1].argmin()) for row in before])
            total = cost + [row.min() for row in before]
        lag, jumps, path = int(total.argmin()), [], [costs[int(total.argmin()), -1]]
        for frame in range(len(came), 0, -1):
            jump = came[frame - 1][lag]
            lag -= jump
            path.append(costs[lag, frame - 1])
            jumps += [(camera, frame, jump)] if jump else []
        if np.median(path) < 1.0:
            yield from jumps


def _of(camera: int, pairs: Sequence[_Pair]) -> list[_Pair]:
    return [pair for pair in pairs if camera in (pair.one, pair.other)]


def _frame_costs(camera: int, pairs: Sequence[_Pair], clocks: Clocks, times: np.ndarray) -> np.ndarray:
    """Squared difference of each frame of a camera, if taken at these times [s, (F,)], in units of a match: the median
    over the other cameras, and CAP where they say nothing [(F,)].
    """
    rows = [np.full(len(times), np.nan)]
    for pair in _of(camera, pairs):
        own = int(camera == pair.other)
        other = (pair.one, pair.other)[1 - own]
        shown = pair.curves[1 - own].at(times - clocks.offsets[other]).T
        match = 2.0 * NOISE + MATCH * pair.width
        rows += list((pair.sharpness * (pair.angles[own] - shown) / match) ** 2)
    table = np.array(rows)
    table[:, np.isnan(table).all(axis=0)] = 1.0
    return np.minimum(np.nanmedian(table, axis=0), JUMP)


def resampled(values: np.ndarray, stamps: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Values [(F, ...)] of frames with stamps [s, (F,)], F at least 3, at other times [s, (T,)], see :class:`Curve`."""
    return Curve(values, stamps).at(times)


def _pairs(sightings: Sequence[Sighting]) -> Iterator[_Pair]:
    near = nearest_point(sightings)
    for one, other in combinations(range(len(sightings)), 2):
        start, end = sightings[one].pose[:, 3], sightings[other].pose[:, 3]
        axis = (end - start) / np.linalg.norm(end - start)
        middle = near - start - axis * (axis @ (near - start))
        if np.linalg.norm(middle) < 1e-9 * np.linalg.norm(end - start):
            continue
        middle /= np.linalg.norm(middle)
        frame = np.stack((axis, middle, np.cross(axis, middle)), axis=-1)
        sides = [_angles(sightings[camera], frame) for camera in (one, other)]
        angles = tuple(side[0] for side in sides)
        sharpness = 1.0 / float(np.hypot(1.0 / sides[0][1], 1.0 / sides[1][1]))
        width = float(np.nanmedian(np.concatenate([a[1] - a[0] for a in angles]))) if sharpness > 0 else np.nan
        if np.isfinite(width) and min(np.isfinite(a).any(axis=0).sum() for a in angles) >= LEAST_FRAMES:
            stamps = sightings[one].times, sightings[other].times
            yield _Pair(one, other, (angles[0], angles[1]), stamps, sharpness, sharpness * width)


def nearest_point(sightings: Sequence[Sighting]) -> np.ndarray:
    """The point that lies nearest to the rays through all outlines' middles (3,), by least squares."""
    matrix, target = 1e-12 * np.eye(3), np.zeros(3)
    for sighting in sightings:
        seen = [points.mean(axis=0) for points in sighting.points if len(points)]
        if seen:
            ray = sighting.pose[:, :3] @ np.append(np.mean(seen, axis=0), -1.0)
            across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
            matrix, target = matrix + across, target + across @ sighting.pose[:, 3]
    return np.linalg.solve(matrix, target)


def _angles(sighting: Sighting, frame: np.ndarray) -> tuple[np.ndarray, float]:
    """Outermost angles around an axis in every frame [rad, (2, F)], NaN where unknown, and pixels per radian. The
    columns of ``frame`` (3, 3) are the axis, the direction of angle 0 and that of a right angle.
    """
    found, sharpness = np.full((2, len(sighting.points)), np.nan), []
    for number, (points, inside) in enumerate(zip(sighting.points, sighting.inside, strict=True)):
        if len(points) == 0:
            continue
        rays = np.column_stack((points, -np.ones(len(points)))) @ sighting.pose[:, :3].T @ frame
        angle = np.arctan2(rays[:, 2], rays[:, 1])
        ends = angle.argmin(), angle.argmax()
        if angle[ends[1]] - angle[ends[0]] > WIDEST:
            continue
        found[:, number] = [angle[end] if inside[end] else np.nan for end in ends]
        sharpness.append(np.hypot(rays[:, 1], rays[:, 2]).mean() / np.linalg.norm(rays, axis=1).mean())
    return found, sighting.focal * float(np.median(sharpness)) if sharpness else 1e-12


def _cost(pair: _Pair, offsets: np.ndarray, step: float) -> tuple[float, float]:
    """Mean squared difference of a pair, in units of the largest that is a match, each at most CAP, and its median.

    Frames that only one of the two has count as a match that is just not one: little overlap proves little.
    """
    match = 2.0 * NOISE + MATCH * pair.width
    (one,), (other,) = _sides(pair, offsets, step, (0.0,))
    most = float((CAP * pair.width / match) ** 2)
    squares = np.minimum(((one - other) / match) ** 2, most)
    known = squares[np.isfinite(squares)]
    if len(known) < LEAST_FRAMES:
        return most, np.inf
    missing = max(2 * max(len(a[0]) for a in pair.angles) - len(known), 0)
    return float((known.sum() + missing) / (len(known) + missing)), float(np.median(known))


def _sides(pair: _Pair, offsets: np.ndarray, step: float, shifts: Sequence[float]) -> list[list[np.ndarray]]:
    """The angles of both cameras on common times, and so many frames later [pixels, (2, T)]."""
    late = offsets[[pair.one, pair.other]]
    stamps = [own + offset for own, offset in zip(pair.stamps, late, strict=True)]
    start, end = max(times[0] for times in stamps) - 1e-6 * step, min(times[-1] for times in stamps)
    grid = np.arange(start, end + 1e-3 * step, step)
    if len(grid) < LEAST_FRAMES:
        return [[np.full((2, 1), np.nan)] * len(shifts)] * 2
    return [
        [pair.sharpness * curve.at(grid + (shift * step - offset)).T for shift in shifts]
        for curve, offset in zip(pair.curves, late, strict=True)
    ]


def _whole_frames(pairs: Sequence[_Pair], sightings: Sequence[Sighting], step: float) -> np.ndarray:
    """Offsets in whole frames at which the pairs match best together [(V,)]: one camera after the other, that with the
    clearest match first, and then each again as long as that helps.
    """
    count = len(sightings)
    longest = max(float(sighting.times[-1] - sighting.times[0]) / step for sighting in sightings)
    reach = int(max(min(longest, LATEST / step) - LEAST_FRAMES + 1, 0))
    apart = np.arange(-2 * reach, 2 * reach + 1)
    costs = np.full((count, count, len(apart)), np.nan)  # of camera a against b, by offset of a less that of b
    for pair in tqdm(pairs, desc="clocks of the cameras", delay=2.0, leave=False):
        for number, lag in enumerate(apart):
            offsets = np.zeros(count)
            offsets[pair.one] = lag * step
            cost = _cost(pair, offsets, step)[0] if abs(lag) <= reach else CAP**2 / MATCH**2
            costs[pair.one, pair.other, number] = costs[pair.other, pair.one, len(apart) - 1 - number] = cost
    lags = np.arange(-reach, reach + 1)

    def total(camera: int, others: Sequence[int], found: np.ndarray) -> np.ndarray:
        rows = [costs[camera, other][lags - found[other] + 2 * reach] for other in others]
        rows = [row for row in rows if np.isfinite(row).all()]
        return np.sum(rows, axis=0) if rows else np.where(lags == 0, 0.0, 1e-9)

    found, placed = np.zeros(count, int), [0]
    while len(placed) < count:
        curves = {camera: total(camera, placed, found) for camera in set(range(count)) - set(placed)}
        camera = max(curves, key=lambda one: float(np.median(curves[one]) - curves[one].min()))
        found[camera] = _best(lags, curves[camera])
        placed.append(camera)
    for _ in range(STEPS):
        before = found.copy()
        for camera in range(count):
            found[camera] = _best(lags, total(camera, [other for other in range(count) if other != camera], found))
        if np.array_equal(before, found):
            break
    return found - int(np.median(found))


def _best(lags: np.ndarray, costs: np.ndarray) -> int:
    """The lag of least cost; of equal ones the smallest."""
    return int(min(zip(costs.round(9), np.abs(lags), lags, strict=True))[2])


def _refined(pairs: Sequence[_Pair], whole: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and standard errors [s, (V,) each], from whole frames on, by Gauss and Newton with bounded residuals.

    A pair may differ by a constant, which an error of its calibration explains. The same outline is in all pairs of its
    camera, so the information of V - 1 pairs is that of two.
    """
    count, offsets = len(whole), whole.astype(float)
    covariance, scale, centre = np.full((count, count), np.nan), 1.0, np.eye(count) - 1.0 / count
    for _ in range(STEPS):
        normal, slope, squares, rows = 1e-9 / step**2 * np.eye(count), np.zeros(count), 0.0, 0
        for pair in pairs:
            (one, ahead, behind), (other, later, sooner) = _sides(pair, offsets, step, (0.0, 0.05, -0.05))
            difference, by_one, by_other = one - other, (behind - ahead) / (0.1 * step), (later - sooner) / (0.1 * step)
            bound = 2.0 * NOISE + MATCH * pair.width
            for side in range(2):
                known = np.isfinite(difference[side] + by_one[side] + by_other[side])
                if known.sum() < LEAST_FRAMES:
                    continue
                r = difference[side, known]
                weight = 1.0 / np.maximum(1.0, np.abs(r - np.median(r)) / bound)
                jacobian = np.zeros((known.sum(), count))
                jacobian[:, pair.one], jacobian[:, pair.other] = by_one[side, known], by_other[side, known]
                table = np.column_stack((r, jacobian)) * np.sqrt(weight)[:, None]
                kept = NOISE / np.sqrt(NOISE**2 + len(r) * POSE_ERROR**2)  # of a constant that is marginalised
                whitened = (table - (1.0 - kept) * table.mean(axis=0)) / NOISE
                normal += whitened[:, 1:].T @ whitened[:, 1:]
                slope += whitened[:, 1:].T @ whitened[:, 0]
                squares, rows = squares + float(whitened[:, 0] @ whitened[:, 0]), rows + len(r)
        change = -np.linalg.solve(normal, slope)
        offsets = offsets + np.clip(change, -0.5 * step, 0.5 * step)
        covariance, scale = centre @ np.linalg.inv(normal) @ centre, max(1.0, squares / max(rows - count, 1))
        if np.abs(change).max() < 1e-4 * step:
            break
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0) * scale * count / 2.0)
    return offsets, np.where(errors < step, errors, np.nan)
