"""What a recording does not say and its outlines do: which way is up, the scale, the ground, the contact, the box."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.data.recordings.agreement import Views, common_size
from pacnerf_lpo.data.recordings.conventions import rotation_onto
from pacnerf_lpo.data.recordings.fall import Ballistic, fit_ballistic, lowest_point, places
from pacnerf_lpo.data.recordings.recording import AXES, UNITS, Recording
from pacnerf_lpo.data.recordings.tangents import Planes, bounds
from pacnerf_lpo.errors import Unmeasured, UserInputError

log = logging.getLogger(__name__)

LEFT_PARABOLA = 0.02
"""So far from the parabola before it, relative to the size of the body, a body is no longer in free flight."""
RESTING = 0.02
"""Heights of the lowest point so close to the least of all, relative to the size of the body, are on the ground."""
GROUND_ERROR = 0.05
"""What the shape of the lower side leaves uncertain, relative to the size of the body: the worst of eight videos with a
known ground and all views; with three views twice that."""
AXIS_SNAP = 1.0
"""An up direction this close to an axis of the calibration is that axis [degrees]: an axis is how it was meant."""
UNIT_SNAP = 0.05
"""A scale this close to metres, centimetres or millimetres is that unit, even where the layout has any scale."""
UP_ERROR, SCALE_ERROR = 3.0, 0.1
"""Standard errors beyond which free fall is too uncertain [degrees, part of the scale]."""
PLAUSIBLE = (0.5, 2.0)
"""Accelerations, relative to gravity, that are no sign of a wrong unit or frame rate: drag and wind change it, too."""
NO_CONTACT = "the body is not seen to fall onto a ground; use a longer video, which begins before the contact"
TILTED = 5.0
"""A stated up direction may be so far from the measured one [degrees]."""
ASTRAY = 45.0
"""From here on it is another axis: no wind in which videos are taken pushes harder than gravity [degrees]."""
LIKELY = (0.8, 1.1)
"""Accelerations relative to gravity beyond which more than a little drag is going on."""
ELSEWHERE = 0.5
"""A body cannot come to rest this far from the ground, relative to its size; a stated ground that says so is wrong."""
SINKS = 0.15
"""A body whose lowest point sinks by more than this part of its size after contact moves down a slope, or no ground
holds it: three times the uncertainty of that point."""


@dataclass(frozen=True)
class Found:
    """A value and, in words, where it comes from and how sure it is."""

    value: float
    why: str


@dataclass(frozen=True)
class Findings:
    """What was found out.

    rotation, scale: x -> scale * rotation x takes the recording's world to metres and y along the ground's normal
    gravity: in these axes [m/s^2, (3,)]
    velocity: of the body at frame 0, in these axes [m/s, (3,)]
    up_why, scale_why: where the two come from
    ground: height of the ground along y, to be subtracted [m]
    ground_error: of it; 0 where it was stated [m]
    hit_frame: first frame in which the body touches the ground
    lower, upper: box around the body at frame 0, over the ground at y = 0 [m, (3,) each]
    """

    rotation: np.ndarray
    scale: float
    gravity: np.ndarray
    velocity: np.ndarray
    up_why: str
    scale_why: str
    ground: Found
    ground_error: float
    hit_frame: Found
    lower: np.ndarray
    upper: np.ndarray


def investigate(views: Views, times: np.ndarray, recording: Recording) -> Findings:
    """Find out what the recording does not say from views in its world, at the times of the frames [s, (F,)]. Raises
    UserInputError where the views contradict each other, or something can neither be read nor measured.
    """
    size = common_size(views, recording)
    frames = [Planes.of(parts) for parts in zip(*views, strict=True)]
    flight = free_flight(frames, times, size)
    lands = flight < len(times)
    if not lands and recording.ground is None:
        raise UserInputError(f"{recording.source}: {NO_CONTACT}, or give --ground")
    for _ in range(2):
        motion = fit_ballistic(frames[:flight], times[:flight])
        up, up_why = find_up(recording, motion)
        normal = up if recording.normal is None else np.array(recording.normal)
        heights = np.array([lowest_point(planes, normal) for planes in frames])
        ground, error, ground_why = find_ground(heights, flight, size) if lands else (recording.ground or 0.0, 0.0, "")
        if recording.ground is not None:
            _compare_grounds(recording, ground, size)
            ground, error, ground_why = recording.ground, 0.0, recording.stated("--ground")
        reached = find_contact(heights, ground, motion.at(times) @ normal, flight)
        if reached is None:
            raise UserInputError(f"{recording.source}: {NO_CONTACT}")
        hit = reached
        flight = min(max(hit, 3), len(times) - 1)
    scale, scale_why = find_scale(recording, motion)
    hit_why = f"its free fall reaches the ground between frames {hit - 1} and {hit}; exact to a frame"
    check_slope(heights, hit, size, _angle(up, normal))
    rotation = rotation_onto(normal, np.array([0.0, 1.0, 0.0]))
    lower, upper = bounds(frames[0].moved(rotation, scale))
    lower[1], upper[1] = max(0.0, lower[1] - scale * ground), upper[1] - scale * ground
    ground_why += f"; {ground:.4g} along {_name(normal)} in the calibration's unit, as --ground states it"
    up_why = f"{_name(up)} of the calibration: {up_why}"
    if recording.normal is not None:
        up_why += f"; the ground is tilted by {_angle(up, normal):.1f} degrees"
    gravity, velocity = -recording.gravity * rotation @ up, scale * rotation @ motion.velocity
    found = Found(scale * ground, ground_why), scale * error, Found(hit, hit_why)
    return Findings(rotation, scale, gravity, velocity, up_why, scale_why, *found, lower, upper)


def free_flight(frames: Sequence[Planes], times: np.ndarray, size: float) -> int:
    """How many frames (tangent planes, at times [s, (F,)]) from the first lie on one parabola; at least three. ``size``
    of the body is in the unit of the planes.
    """
    for flight in range(3, len(times)):
        motion = fit_ballistic(frames[:flight], times[:flight])
        place = places(frames[flight : flight + 1], motion.shape)[0]
        away = float(np.linalg.norm(place - motion.at(times[flight : flight + 1])[0]))
        if not away < LEFT_PARABOLA * size:
            return flight
    return max(len(times), 3)


def find_up(recording: Recording, motion: Ballistic) -> tuple[np.ndarray, str]:
    """The unit vector against gravity (3,), and its source; UserInputError where it is neither stated nor seen."""
    size = float(np.linalg.norm(motion.acceleration))
    measured = -motion.acceleration / max(size, 1e-30)
    error = float(np.degrees(np.linalg.norm(motion.error) / max(size, 1e-30)))
    if recording.up is not None:
        up = np.array(recording.up, float)
        angle = _angle(up, measured)
        if error < UP_ERROR and angle > ASTRAY:
            raise UserInputError(
                f"{recording.source}: the body falls {'against' if angle > 135.0 else f'{angle:.0f} degrees off'} the "
                f"stated up direction {_vector(up)}; give --up"
            )
        if error < UP_ERROR and angle > TILTED + 2.0 * error:
            log.warning("the body falls %.0f degrees off the stated up direction %s; check --up", angle, _vector(up))
        return up, recording.stated("--up")
    if not error < UP_ERROR or not recording.gravity:
        raise Unmeasured(
            f"{recording.source}: which side is up cannot be measured, the body hardly falls before it touches "
            f"something (uncertain by {error:.2g} degrees); give --up",
            "up",
        )
    nearest = min((np.array(axis, float) for axis in AXES.values()), key=lambda axis: _angle(axis, measured))
    angle = _angle(nearest, measured)
    if angle < AXIS_SNAP:
        return nearest, f"an axis of the calibration, {angle:.2g} degrees from the direction of free fall"
    return measured, f"the direction of free fall, to {max(error, 0.1):.1f} degrees"


def find_scale(recording: Recording, motion: Ballistic) -> tuple[float, str]:
    """Metres per unit, and where that comes from. Raises UserInputError where it is neither stated nor measurable, or
    the body falls as it could not with the stated one.
    """
    size = float(np.linalg.norm(motion.acceleration))
    error = float(np.linalg.norm(motion.error)) / max(size, 1e-30)
    gravity = recording.gravity
    if not gravity and recording.unit is not None:
        return recording.unit, recording.stated("--unit")
    measured = gravity / max(size, 1e-30)
    near = min(UNITS, key=lambda name: abs(np.log(UNITS[name] / max(measured, 1e-30))))
    falls = f"the body falls at {size * UNITS[near]:.3g} m/s^2"
    ratio = (UNITS[near] if recording.unit is None else recording.unit) / max(measured, 1e-30)
    plausible = PLAUSIBLE[0] - 3.0 * error < ratio < PLAUSIBLE[1] + 3.0 * error
    if recording.unit is not None:
        if not plausible:
            raise UserInputError(
                f"{recording.source}: with {recording.unit:g} m per unit the body falls at {gravity * ratio:.3g} m/s^2 "
                f"instead of {gravity:g}; with --unit {near} {falls}; check --unit, --fps and --gravity"
            )
        _doubt(ratio, error, gravity)
        return recording.unit, recording.stated("--unit")
    if not error < SCALE_ERROR or not gravity:
        raise Unmeasured(
            f"{recording.source}: the scale cannot be measured, the body hardly falls before it touches something; "
            "give --unit",
            "unit",
        )
    if abs(ratio - 1.0) < UNIT_SNAP or (recording.metric and plausible):
        _doubt(ratio, error, gravity)
        return UNITS[near], f"{near}, as in it {falls}"
    return measured, (
        f"free fall at {gravity:g} m/s^2, to {100 * max(error, 0.01):.0f} %; "
        "another gravity, or drag, would pass for scale"
    )


def _doubt(ratio: float, error: float, gravity: float) -> None:
    """Warn where the body falls unlike a body under gravity, given the acceleration relative to it and its error."""
    if not LIKELY[0] - 3.0 * error < ratio < LIKELY[1] + 3.0 * error:
        log.warning(
            f"the body falls at {ratio * gravity:.3g} m/s^2 instead of {gravity:.3g}: unless drag or wind does that, "
            "check the focal lengths, --unit and --fps"
        )


def find_ground(heights: np.ndarray, flight: int, size: float) -> tuple[float, float, str]:
    """Height of the ground and its error, in the recording's unit, and where it comes from: where the lowest point, of
    these heights in every frame [(F,)], comes to rest after a flight of so many frames. ``size`` is the body's.
    """
    after = heights[flight - 1 :]
    least = float(np.nanmin(after))
    resting = after[after < least + RESTING * size]
    spread = max(float(resting.std()) / size, GROUND_ERROR)
    frames = f"{len(resting)} frame{'s' * (len(resting) > 1)}"
    why = f"lowest point of the outlines in {frames}, to about {100 * spread:.1g} % of the body; "
    return float(resting.mean()), spread * size, why + "physics.fit_ground_height finds it more exactly"


def find_contact(heights: np.ndarray, ground: float, path: np.ndarray, flight: int) -> int | None:
    """The first frame at or after the moment at which the lowest point, on its parabola, reaches the ground; None where
    it does not within the video. Its heights in every frame [(F,)] follow those of ``path`` [(F,)] during the flight.
    """
    before = slice(max(flight - 3, 0), max(flight - 1, 2))  # the last frames in the air, seen from similar angles
    lowest = path + np.nanmean((heights - path)[before])
    below = np.flatnonzero(lowest <= ground)
    return int(below[0]) if len(below) and below[0] > 0 else None


def check_slope(heights: np.ndarray, hit: int, size: float, tilt: float) -> None:
    """Warn where the body does not stay on the ground as it is believed to lie; ``tilt`` [degrees] against gravity."""
    after = heights[hit:][np.isfinite(heights[hit:])]
    if len(after) > 1 and after[0] - after[-1] > SINKS * size:
        log.warning(
            f"after contact the lowest point of the body sinks by {100 * (after[0] - after[-1]) / size:.0f} % of its "
            f"size: the ground, tilted by {tilt:.0f} degrees here, may be a slope (give --ground_normal), or the "
            "contact later (cut the videos)"
        )


def _compare_grounds(recording: Recording, measured: float, size: float) -> None:
    off = (measured - (recording.ground or 0.0)) / size
    side = "above" if off > 0 else "below"
    said = (
        f"the body comes to rest {100 * abs(off):.0f} % of its size {side} the stated ground, at {measured:.4g} units "
        "of the calibration; check --ground and --ground_normal"
    )
    if abs(off) > ELSEWHERE:
        raise UserInputError(f"{recording.source}: {said}")
    if abs(off) > 0.1:
        log.warning(said)


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ other, -1.0, 1.0))))


def _name(axis: np.ndarray) -> str:
    """An axis of the calibration by its name, another direction by its numbers."""
    near = [name for name, own in AXES.items() if np.allclose(axis, own, atol=1e-6)]
    return near[0] if near else _vector(axis)


def _vector(up: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:g}" for value in up) + ")"
