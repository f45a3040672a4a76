"""What positions say of a flight: which way is up, whether lengths are metres, when it ends, whether it began at rest.

Flights of one source share axes and unit. Their acceleration is a = g - k |v| v along smooth paths, with the vector g
and the drag k found together, so that a ball that air slows down is not taken for one in another unit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import polynomial
from scipy.optimize import nnls

from pacnerf_lpo.data.recordings.conventions import rotation_onto
from pacnerf_lpo.data.recordings.findings import PLAUSIBLE, Found
from pacnerf_lpo.data.recordings.recording import AXES, GRAVITY, UNITS
from pacnerf_lpo.data.trajectories.noise import Noise, noise_of
from pacnerf_lpo.data.trajectories.trajectory import LEAST_SAMPLES, Trajectory
from pacnerf_lpo.errors import UserInputError

TILTED = 35.0
"""Measured gravity may be so far from an axis that is up [degrees]: a side force and noise bend a short flight."""
AT_REST = 0.2
"""A body that is let go begins with less than this part of the speed that it reaches; one that is thrown or hit does
not, and noise in the first samples of a drop does not reach it."""
REWEIGHTED = 10
NOISES = 6.0
"""A rise after a fall, or a jump of the velocity, is a contact from so many standard deviations of the noise on."""
JUMP, SIDE = 0.3, 6
"""A jump of this part of the speed, as a path of so many samples to either side shows it, is a hit: air takes that much
only from the lightest bodies, and not within a few samples."""
LEAST_COMPARED = 5
OUTLYING = 5.0
"""Of several flights one that departs from a smooth path by so many times what is typical is no free flight."""
WHOLE = 3
"""Order of the path along which an acceleration is measured: that of drag along a curved path needs the third."""
RELEASES = 60
"""Times of release that are tried."""


@dataclass(frozen=True)
class Direction:
    """Which way is up in the positions of a source, and metres per unit, each with where it comes from."""

    up: np.ndarray
    why: str
    scale: float
    scale_why: str


def find_direction(recordings: Sequence[Trajectory], up: str | None, unit: str | None) -> Direction:
    """Of all recordings of a source together, with the axis that points up (None: as it is measured, or the second one
    where that is a height) and the unit of lengths (None: as the file says, else metres). Raises UserInputError where
    gravity shows no direction, another one than the stated, or another unit.
    """
    first = recordings[0]
    for option, value, known in (("--up", up, AXES), ("--unit", unit, UNITS)):
        if value is not None and value not in known:
            raise UserInputError(f"{first.source}: {option} {value}: of positions, give one of {', '.join(known)}")
    stated = first.unit if unit is None else UNITS[unit]
    scale = 1.0 if stated is None else stated
    if up is None and not first.upward and not all(one.measured.all() for one in recordings):
        raise UserInputError(
            f"{first.source}: not all of x, y and z were measured, so gravity does not show what is up; give --up"
        )
    axis = up or ("y" if first.upward else None)
    tried = list(AXES) if axis is None else [axis]
    falls = {name: fall for name in tried if (fall := _fall(recordings, np.array(AXES[name], float), scale))}
    if not falls:
        raise UserInputError(
            f"{first.source}: no recording has {LEAST_SAMPLES} positions before it touches something; give longer ones"
        )
    best = min(falls, key=lambda name: falls[name].left)
    found = falls[best]
    low, high = (bound * GRAVITY for bound in PLAUSIBLE)
    if not low - 3 * found.error < found.size < high + 3 * found.error:
        near = min(UNITS, key=lambda name: abs(np.log(max(UNITS[name] / scale * found.size, 1e-30) / GRAVITY)))
        mended = found.size * UNITS[near] / scale
        fits = low < mended < high and UNITS[near] != scale
        other = f"with --unit {near} at {mended:.3g} m/s^2" if fits else "which no unit of length mends"
        lengths = "the stated unit" if stated is not None else "lengths in metres"
        raise UserInputError(
            f"{first.source}: with {lengths} the body falls at {found.size:.3g} m/s^2 instead of {GRAVITY}, {other}; "
            "check the unit of length, that of the times, and that the body is in free flight"
        )
    if found.tilt > TILTED:
        raise UserInputError(
            f"{first.source}: the bodies fall {found.tilt:.0f} degrees off the direction opposite to {best}; give "
            "another --up, or a part of the recording in free flight"
        )
    said = "stated by --up" if up else "the column of heights" if first.upward else "the axis against which bodies fall"
    why = f"{'stated' if stated is not None else 'taken for metres'}; bodies fall at {found.size:.3g} m/s^2 less drag"
    return Direction(np.array(AXES[best], float), f"{best}, {said}, to {found.tilt:.0f} degrees", scale, why)


@dataclass(frozen=True)
class _Fall:
    """How bodies fall if an axis is up: acceleration against it, its error, what that and drag leave, typically [m/s^2
    each], and how far off the axis that points [degrees].
    """

    size: float
    error: float
    left: float
    tilt: float


def _fall(recordings: Sequence[Trajectory], up: np.ndarray, scale: float) -> _Fall | None:
    """Of all flights, with a = -G up - k |v| v, G and k >= 0, by least absolute values; None: all are too short."""
    parts = [part for one in recordings if (part := _accelerations(one, up, scale)) is not None]
    if not parts:
        return None
    speeds, pushes = (np.concatenate(values) for values in zip(*parts, strict=True))
    drag = -np.linalg.norm(speeds, axis=1, keepdims=True) * speeds
    design = np.stack((np.tile(-up, len(pushes)), drag.ravel()), axis=1)
    weight = np.ones(len(pushes))
    for _ in range(REWEIGHTED):
        w = np.repeat(np.sqrt(weight), 3)
        size, k = nnls(w[:, None] * design, w * pushes.ravel())[0]
        rest = np.linalg.norm(pushes + size * up - k * drag, axis=1)
        weight = 1 / np.maximum(rest, 1e-3 * GRAVITY)
    left = float(np.median(rest))
    free = np.median(pushes - k * drag, axis=0)
    tilt = float(np.degrees(np.arccos(np.clip(-free @ up / max(float(np.linalg.norm(free)), 1e-30), -1, 1))))
    return _Fall(float(size), left / np.sqrt(len(parts)), left, tilt if recordings[0].measured.sum() > 1 else 0.0)


def _accelerations(one: Trajectory, up: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Velocities [m/s] and accelerations [m/s^2] at three times of a flight [(3, 3) each], 0 along what was not
    measured; None where it is too short.
    """
    seen, positions = one.measured, scale * one.positions
    heights = positions @ up if seen.all() else positions[:, seen][:, 0]
    end = min(contact_of(one.times, heights), hit_of(one.times, positions))
    inside = (np.arange(len(one.times)) <= end) & np.isfinite(positions[:, seen]).all(1)
    if inside.sum() < LEAST_SAMPLES:
        return None
    t = one.times[inside] - one.times[inside].mean()
    path = polynomial.polyfit(t, positions[inside][:, seen], WHOLE)
    speeds, pushes = np.zeros((2, 3, 3))
    for order, values in ((1, speeds), (2, pushes)):
        values[:, seen] = polynomial.polyval(np.linspace(t[0], t[-1], 5)[1:-1], polynomial.polyder(path, order)).T
    return speeds, pushes


def _known(times: np.ndarray, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of the samples of which all that is ever measured is known [(n,)], their times and that [(n, K)]."""
    seen = np.isfinite(positions).any(0)
    known = np.flatnonzero(np.isfinite(positions[:, seen]).all(1))
    return known, times[known], positions[known][:, seen]


def hit_of(times: np.ndarray, positions: np.ndarray) -> int:
    """Number of the last sample, at times [s, (F,)], before the velocity of a moving body jumps, in any direction; the
    last where it never does. A jump is what a path of second order around a sample needs besides. Positions are in any
    unit [(F, 3)], NaN where unknown.
    """
    known, t, x = _known(times, positions)
    if len(t) < 2 * SIDE:
        return len(times) - 1
    fastest = float(np.median(np.linalg.norm(np.diff(x, axis=0), axis=1) / np.diff(t)))
    for at in range(SIDE, len(t) - SIDE):
        s = t[at - SIDE : at + SIDE] - (t[at - 1] + t[at]) / 2
        design = np.stack((np.ones_like(s), s, s**2, np.clip(s, 0.0, None)), axis=1)
        inverse = np.linalg.inv(design.T @ design)
        found = inverse @ design.T @ x[at - SIDE : at + SIDE]
        rest = x[at - SIDE : at + SIDE] - design @ found
        error = float(np.sqrt((rest**2).sum() / (rest.size - found.size) * inverse[3, 3]))
        before, jump = float(np.linalg.norm(found[1])), float(np.linalg.norm(found[3]))
        if jump > max(NOISES * error, JUMP * before) and before > JUMP * fastest:
            return int(known[at]) - 1
    return len(times) - 1


def contact_of(times: np.ndarray, heights: np.ndarray) -> int:
    """Number of the last sample, at times [s, (F,)], before a body that fell rises again; the last where it never does.
    Heights are in any unit [(F,)], NaN where unknown.
    """
    known = np.flatnonzero(np.isfinite(heights))
    h = heights[known]
    steps = np.diff(h, 3)
    noise = 1.4826 * float(np.median(np.abs(steps))) / np.sqrt(20.0) if len(steps) else 0.0
    least = NOISES * max(noise, 1e-6 * float(np.ptp(h)) if len(h) else 0.0)
    for low in range(1, len(h) - 1):
        turns = h[low] <= h[: low + 1].min() and h[low] < h[low + 1]
        if turns and h[:low].max() - h[low] > least and h[low : low + LEAST_SAMPLES].max() - h[low] > least:
            return int(known[low]) - 1
    return len(times) - 1


def begins_at_rest(times: np.ndarray, positions: np.ndarray) -> tuple[bool, str]:
    """Whether a body is let go rather than already flying at its first sample, by how fast it is at first and at the
    end; and that in words. Of times [s, (F,)] and positions [m, (F, 3)], NaN where unknown.
    """
    _, t, x = _known(times, positions)
    t = t - t[0]
    half = max(len(t) // 2, LEAST_SAMPLES // 2)
    first = float(np.linalg.norm(polynomial.polyfit(t[:half], x[:half], 2)[1]))
    last = float(np.linalg.norm(polynomial.polyfit(t[-half:] - t[-1], x[-half:], 2)[1]))
    return first < AT_REST * last, f"it moves at {first:.2g} m/s at first and at {last:.2g} m/s in the end"


def release_of(times: np.ndarray, positions: np.ndarray) -> float:
    """When a body that is at rest at first begins to move [s]: of resting until then and falling with a constant
    acceleration afterwards, what describes the first half best.
    """
    _, t, x = _known(times, positions)
    half = max(len(t) // 2, LEAST_SAMPLES // 2)
    t, x = t[:half], x[:half]

    def left(release: float) -> float:
        design = np.stack((np.ones_like(t), np.clip(t - release, 0.0, None) ** 2), axis=1)
        rest = x - design @ np.linalg.lstsq(design, x, rcond=None)[0]
        return float((rest**2).sum())

    return float(min(np.linspace(t[0], t[0] + 0.8 * (t[-1] - t[0]), RELEASES), key=left))


@dataclass(frozen=True)
class Findings:
    """One flight, in metres and with y up, from its first sample on, and where each of that comes from.

    one: times from 0 [s], positions [m], spin [rad/s]
    end: time at which the flight ends, and why [s]
    held: whether it is held at first, and why
    guess: start, velocity and release [SI]
    """

    one: Trajectory
    end: Found
    held: tuple[bool, str]
    guess: dict[str, float]


def investigate(one: Trajectory, direction: Direction, start: str | None) -> Findings:
    """Turn a recording to metres and y up, and find out where its flight begins and ends. ``start`` is ``held`` or
    ``flying``; None: whichever describes its first half better. Raises UserInputError where too few samples are in
    flight.
    """
    turn = np.round(rotation_onto(direction.up, np.array([0.0, 1.0, 0.0])), 12)
    known = np.nan_to_num(one.positions) @ turn.T * direction.scale
    hidden = ~np.isfinite(one.positions).astype(bool) @ (np.abs(turn) > 1e-9).T
    positions = np.where(hidden, np.nan, known)
    times = one.times - one.times[0]
    rises = contact_of(times, positions[:, 1])
    last = min(rises, hit_of(times, positions))
    if last + 1 < LEAST_SAMPLES:
        raise UserInputError(
            f"{one.source}, recording {one.name}: the body touches something after {last + 1} positions; a flight "
            f"needs at least {LEAST_SAMPLES}"
        )
    event, why = "rises again" if last == rises else "changes its velocity at once", "the last sample"
    if last + 1 < len(times):
        why = f"the body {event} after {times[last]:.4g} s: it touches something"
    spin = None if one.spin is None else turn @ one.spin
    cut = replace(one, times=times[: last + 1], positions=positions[: last + 1], unit=1.0, upward=True, spin=spin)
    held, said = begins_at_rest(cut.times, cut.positions)
    if start is not None:
        held, said = start == "held", f"stated by --start; {said}"
    return Findings(cut, Found(float(times[last]), why), (held, said), _guess(cut, held))


def _guess(one: Trajectory, held: bool) -> dict[str, float]:
    """Start, velocity and release [SI]."""
    found = {"release": release_of(one.times, one.positions)} if held else {}
    for axis, name in enumerate("xyz"):
        values = one.positions[:, axis]
        seen = np.isfinite(values)
        if not seen.any():
            continue
        t = one.times[seen]
        if held:
            found[f"{name}_0"] = float(values[seen][t <= max(found["release"], t[0])].mean())
        else:
            path = polynomial.polyfit(t, values[seen], WHOLE)
            found |= {f"{name}_0": float(path[0]), f"v_{name}": float(path[1])}
    return found


def outlying(flights: Sequence[Findings]) -> list[bool]:
    """Which of several flights depart from a smooth path by far more than the others."""
    if len(flights) < LEAST_COMPARED:
        return [False] * len(flights)
    sizes = []
    for flight in flights:
        _, t, x = _known(flight.one.times, flight.one.positions)
        path = polynomial.polyfit(t, x, WHOLE)
        rest = x - polynomial.polyval(t, path).T
        sizes.append(float(np.sqrt((rest**2).sum() / max(rest.size - path.size, 1))))
    return (np.array(sizes) > OUTLYING * float(np.median(sizes))).tolist()


def noises(flights: Sequence[Findings]) -> Iterator[Noise | None]:
    """Of every coordinate, in the flights of a source after their release; None for what was not measured."""
    for axis in range(3):
        tracks = []
        for flight in flights:
            times, values = flight.one.times, flight.one.positions[:, axis]
            seen = np.isfinite(values) & (times >= flight.guess.get("release", 0.0))
            tracks.append((times[seen], values[seen]))
        yield noise_of(tracks) if any(len(times) for times, _ in tracks) else None
