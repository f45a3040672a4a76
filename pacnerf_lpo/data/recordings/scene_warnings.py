"""What a careful colleague would say about a recording before it is fitted: what is doubtful, where, and the remedy."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pacnerf_lpo.data.recordings.agreement import GAP, largest_gap, odd_one_out
from pacnerf_lpo.data.recordings.clocks import ENOUGH
from pacnerf_lpo.data.recordings.conversion import frame_ranges
from pacnerf_lpo.data.recordings.findings import SCALE_ERROR
from pacnerf_lpo.data.recordings.look import Appearance, Look
from pacnerf_lpo.data.recordings.scene_file import SPACING
from pacnerf_lpo.data.recordings.sharpness import blur

DISAGREES = 0.5 * GAP
"""Gap between views from which on it is reported: half of what is refused, and twice that of right recordings."""
FEW_VIEWS = 3
"""Two outlines allow everything along their lines of sight; each further view cuts that."""
ONE_SIDE = 45.0
"""Views within this angle [degrees] see a body from one side: a hull is 1 / tan(22.5 degrees) = 2.4 times too deep."""
FINEST = SPACING / 4
"""Finest voxel that ``init`` chooses, relative to the longest edge of the body."""
PIXELS = 2 / FINEST
"""Pixels along the body: two for each of the finest voxels, as sampling needs."""
BLURRED = 0.5 * FINEST
"""Blur relative to the object: half of the finest voxel; by that much the outline is uncertain."""
LEAST_BLUR = 1.5
"""Blur that resampling of pixels alone can bring about [pixels]."""
EXPOSURE = 1.2
"""Blur cannot be longer than the motion from frame to frame, up to what its measurement leaves open."""
LOOSE, HAZY = 0.05, 0.05
"""Parts of a matte off its largest piece, or half transparent: five per cent of the volume are hardly seen in a fit."""
JUMP = np.log(4 / 3)
"""An outline's area, relative to the frames before and after, does not change by a third in one view alone: at impact
views of seven bodies differ by a fifth."""
AFTER = 5
"""Frames from contact on: of a soft body at usual frame rates, compression, its turning point and some rebound."""
LATEST = 0.8
"""Contact after this part of a video leaves little of it to the material."""
FASTER = 1.5
"""Speeds relative to the fastest of the fall: impacts only slow a body, and its deforming moves its middle a little."""
OFF_GRAVITY = 0.1
"""Difference between measured and stated gravity that is said, relative to it; air drags most bodies by less."""
OUTSIDE = 0.02
"""Part of the body's size by which outlines may exceed the box: their own uncertainty."""


@dataclass(frozen=True)
class SceneWarning:
    """Something doubtful.

    kind: disagreement, views, box, contact, flight, throws, gravity, border, matte, blur, pixels or clock
    what: a sentence without its full stop
    remedy: what to do, as a clause
    cameras, frames: where; empty where it is everywhere
    """

    kind: str
    what: str
    remedy: str
    cameras: tuple[str, ...] = ()
    frames: tuple[int, ...] = ()

    def __str__(self) -> str:
        return f"{self.what}; {self.remedy}"


def scene_warnings(look: Look) -> list[SceneWarning]:
    """Everything doubtful about a scene, the most important first."""
    parts = (
        _disagreement, _views, _box, _contact, _flight, _throws, _gravity, _border, _mattes, _blur, _pixels, _clocks,
    )  # fmt: skip
    return [warning for part in parts for warning in part(look)]


def _in_frames(frames: Sequence[int]) -> str:
    return f"in frame{'s' * (len(frames) > 1)} {frame_ranges(frames)}"


def _disagreement(look: Look) -> Iterator[SceneWarning]:
    planes = look.planes
    gap = largest_gap(planes)
    if not gap > DISAGREES:
        return
    share = f"{100 * gap:.1f} % of the body's size" if np.isfinite(gap) else "so far that nothing is left of the body"
    wrong = odd_one_out(planes, gap, DISAGREES)
    names = tuple(view.name for view in look.scene.views)
    if wrong is None:
        which = "which one is wrong cannot be determined" + (f" from {len(names)} views" if len(names) < ENOUGH else "")
        what = f"the outlines of the cameras contradict each other by {share}; {which}"
        remedy = "look where the outline of the matte leaves that of the hull, then calibrate again or give masks"
    else:
        names = (names[wrong],)
        what = f"camera {names[0]} disagrees with the others: with it the outlines contradict each other by {share}"
        remedy = "its pose, its clock or its matte is wrong: calibrate it again, give its masks, or init with "
        remedy += f"--leave_out {names[0]}"
    yield SceneWarning("disagreement", what, remedy, names)


def _clocks(look: Look) -> Iterator[SceneWarning]:
    step = float(np.diff(look.scene.times).mean())
    for view in look.scene.views:
        if view.offset:
            when = "later" if view.offset > 0.0 else "earlier"
            yield SceneWarning(
                "clock",
                f"camera {view.name} is out of step: its frames are taken {1e3 * abs(view.offset):.3g} ms "
                f"({abs(view.offset) / step:.2g} of a frame) {when} than those of the others",
                "nothing has to be done, time_offset in all_data.json says so to fit; one trigger for all is better",
                (view.name,),
            )


def _views(look: Look) -> Iterator[SceneWarning]:
    views = look.scene.views
    towards = np.stack([0.5 * (look.scene.lower + look.scene.upper) - view.pose[:, 3] for view in views])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    widest = float(np.degrees(np.arccos(np.clip(np.abs(towards @ towards.T).min(), 0.0, 1.0))))
    if len(views) < FEW_VIEWS:
        what = f"only {len(views)} views: the shape along their lines of sight is a guess, and with it mass and volume"
        remedy = "add a camera that looks from another side, best at a right angle to the others"
    elif widest < ONE_SIDE:
        what = (
            f"all views look along nearly the same line, within {widest:.0f} degrees: the depth of the body is a guess"
        )
        remedy = "place the cameras around the object, two of them at about a right angle"
    else:
        return
    yield SceneWarning("views", what, remedy, tuple(view.name for view in views))


def _box(look: Look) -> Iterator[SceneWarning]:
    room = OUTSIDE * look.size
    for end, side, beyond in (
        ("lower", "below", look.scene.lower - look.lower),
        ("upper", "above", look.upper - look.scene.upper),
    ):
        for axis, excess in zip("xyz", beyond, strict=True):
            ground = axis == "y" and end == "lower" and look.scene.lower[1] <= look.scene.ground_height + room
            if excess > room and not ground:
                yield SceneWarning(
                    "box",
                    f"the body reaches {excess:.3g} m {side} the box along {axis} at frame 0",
                    f"change {axis} of data.box_{end} in scene.yaml",
                    frames=(0,),
                )


def _contact(look: Look) -> Iterator[SceneWarning]:
    hit, count = look.scene.hit_frame, len(look.scene.times)
    left = count - hit
    if left < AFTER:
        what = f"the recording ends soon after the first contact: {left} frame{'s' * (left > 1)} from frame {hit} on, "
        what += "the stiffness is hardly visible"
        remedy = f"record longer, at least {AFTER} frames from contact on; E will be uncertain"
    elif hit > LATEST * count:
        what = f"the contact is late: {left} of {count} frames show the material"
        remedy = "record longer after the contact"
    else:
        return
    yield SceneWarning("contact", what, remedy, frames=tuple(range(hit, count)))


def _flight(look: Look) -> Iterator[SceneWarning]:
    hit, error = look.scene.hit_frame, _gravity_error(look)
    if hit < look.flight or error > SCALE_ERROR:
        how = f"{hit} frame{'s' * (hit > 1)}" + (f", gravity is seen to {100 * error:.0f} %" if hit >= 3 else "")
        yield SceneWarning(
            "flight",
            f"the free flight is too short to measure gravity ({how}): neither scale nor up direction can be checked",
            "begin the recording earlier, or drop from higher; make sure that unit, up and frame rate are right",
            frames=tuple(range(hit)),
        )


def _throws(look: Look) -> Iterator[SceneWarning]:
    """No body moves up or down faster than it fell before the contact."""
    times = look.scene.times
    until = times[: min(look.scene.hit_frame, len(times) - 1) + 1, None]
    fastest = float(np.abs((look.motion.velocity + look.motion.acceleration * until)[:, 1]).max())
    speeds = np.abs(np.diff(look.centre)) / np.diff(times)
    jumps = np.flatnonzero(speeds > FASTER * fastest + look.size * OUTSIDE / np.diff(times)) + 1
    if len(jumps):
        yield SceneWarning(
            "throws",
            f"the object moves {speeds[jumps - 1].max():.2g} m/s up or down before frame {jumps[0]}, and its fastest "
            f"before the contact was {fastest:.2g} m/s: several throws in one video, or frames in a wrong order",
            f"cut all videos before frame {jumps[0]}; each throw is a recording of its own",
            frames=tuple(jumps.tolist()),
        )


def _gravity(look: Look) -> Iterator[SceneWarning]:
    stated, found = look.scene.gravity, look.motion.acceleration
    strength, error = float(np.linalg.norm(stated)), _gravity_error(look)
    if strength == 0.0 or look.scene.hit_frame < look.flight or error > SCALE_ERROR:
        return
    if float(np.linalg.norm(found - stated)) > (OFF_GRAVITY + 3.0 * error) * strength:
        speed = float(np.linalg.norm(found))
        angle = np.degrees(np.arccos(np.clip(found @ stated / (speed * strength), -1.0, 1.0)))
        yield SceneWarning(
            "gravity",
            f"the body falls at {speed:.3g} m/s^2, {angle:.0f} degrees off the stated gravity of {strength:.3g} m/s^2",
            "check unit, frame rate and up direction (--unit, --fps, --up); drag, wind or an early touch do the same",
            frames=tuple(range(look.flight)),
        )


def _gravity_error(look: Look) -> float:
    """Standard error of the measured acceleration, relative to gravity; 0 without gravity, which nothing measures."""
    strength = float(np.linalg.norm(look.scene.gravity))
    return float(np.linalg.norm(look.motion.error)) / strength if strength > 0.0 else 0.0


def _border(look: Look) -> Iterator[SceneWarning]:
    for view, row in zip(look.scene.views, look.appearances, strict=True):
        cut = [number for number, one in enumerate(row) if one.cut]
        gone = [number for number, one in enumerate(row) if not one.seen]
        remedy = f"aim this camera at the whole motion; if much is missing, init with --leave_out {view.name}"
        worst = ", and box and shape come from frame 0" if 0 in cut else ""
        if gone:
            what = f"camera {view.name} does not see the object {_in_frames(gone)}"
            yield SceneWarning("border", what, remedy, (view.name,), tuple(gone))
        if cut:
            what = f"the object touches the image border {_in_frames(cut)}, it may be cut off{worst}"
            yield SceneWarning("border", f"camera {view.name}: {what}", remedy, (view.name,), tuple(cut))


def _mattes(look: Look) -> Iterator[SceneWarning]:
    remedy = "look at data/m_*.png of this camera; give masks, or a background plate, if a part is missing or too much"
    jumps = np.stack([_jumps(row) for row in look.appearances])
    for number, (view, row) in enumerate(zip(look.scene.views, look.appearances, strict=True)):
        alone = np.abs(jumps[number] - np.median(np.delete(jumps, number, axis=0), axis=0)) > JUMP
        doubts = {
            "in several pieces (a shadow, something else that moves, or a gap)": [one.loose > LOOSE for one in row],
            "half transparent in places": [one.hazy > HAZY for one in row],
            "larger or smaller than in the frames before and after, in this view alone": alone.tolist(),
        }
        for how, places in doubts.items():
            frames = tuple(np.flatnonzero(places).tolist())
            if frames:
                what = f"camera {view.name}: the matte is doubtful {_in_frames(frames)}, {how}"
                yield SceneWarning("matte", what, remedy, (view.name,), frames)


def _jumps(row: Sequence[Appearance]) -> np.ndarray:
    """Logarithm of the outline's area less the mean of the frames before and after; 0 where it is not wholly seen."""
    areas = np.log([one.pixels if one.seen and not one.cut else np.nan for one in row])
    return np.nan_to_num(np.pad(areas[1:-1] - 0.5 * (areas[:-2] + areas[2:]), 1))


def _blur(look: Look) -> Iterator[SceneWarning]:
    found = [(view.name, list(_blurred(row))) for view, row in zip(look.scene.views, look.appearances, strict=True)]
    found = [(name, seen) for name, seen in found if len(seen) > len(look.scene.times) // 4]
    if not found:
        return
    name, seen = max(found, key=lambda one: float(np.median([length for _, length, _ in one[1]])))
    frames, lengths, steps = (list(part) for part in zip(*seen, strict=True))
    more = f" (and in {len(found) - 1} other camera{'s' * (len(found) > 2)})" if len(found) > 1 else ""
    yield SceneWarning(
        "blur",
        f"motion blur is possible: in camera {name}{more} edges across the motion are about {np.median(lengths):.1f} "
        f"pixels wider than those along it {_in_frames(frames)}, where the object moves {np.median(steps):.0f} pixels "
        "per frame",
        "use a shorter exposure and more light; outlines are uncertain by half of that width",
        tuple(name for name, _ in found),
        tuple(sorted({frame for _, seen in found for frame, _, _ in seen})),
    )


def _blurred(row: Sequence[Appearance]) -> Iterator[tuple[int, float, float]]:
    """Frames of a camera with blur, its length there and the motion since the frame before [pixels]."""
    for number, (before, now) in enumerate(pairwise(row), 1):
        step = now.centre - before.centre
        moved = float(np.linalg.norm(step))
        if moved > LEAST_BLUR and not (now.cut or before.cut):
            length = blur(now.widths, step)
            if max(BLURRED * now.size, LEAST_BLUR) < length < EXPOSURE * moved:
                yield number, length, moved


def _pixels(look: Look) -> Iterator[SceneWarning]:
    small = [(v.name, row[0].size) for v, row in zip(look.scene.views, look.appearances, strict=True) if row[0].seen]
    small = [(name, size) for name, size in small if size < PIXELS]
    if small:
        name, least = min(small, key=lambda one: one[1])
        yield SceneWarning(
            "pixels",
            f"the object is small: {least:.0f} pixels long in camera {name} at frame 0, and below {PIXELS:.0f} in "
            f"{len(small)} of {len(look.scene.views)} cameras",
            "go nearer, zoom in or use a higher resolution; a coarser voxel (base_spacing) loses nothing then",
            tuple(name for name, _ in small),
            (0,),
        )
