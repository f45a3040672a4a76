"""Looking at a written scene: outlines, hulls and motion as they are with the values that scene.yaml has now."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path

import numpy as np
from scipy import ndimage
from tqdm import tqdm

from pacnerf_lpo.data.matting import RIM
from pacnerf_lpo.data.recordings.clocks import resampled
from pacnerf_lpo.data.recordings.fall import Ballistic, fit_ballistic, lowest_point, places
from pacnerf_lpo.data.recordings.sharpness import SIDES, edge_widths
from pacnerf_lpo.data.recordings.shots import LEAST_OBJECT
from pacnerf_lpo.data.recordings.tangents import (
    DIRECTIONS,
    Planes,
    bounds,
    outline_points,
    outline_tangents,
    tangent_planes,
)
from pacnerf_lpo.data.recordings.voxel_hull import outside_share, visual_hull
from pacnerf_lpo.data.recordings.written_scene import View, WrittenScene, picture, read_written_scene
from pacnerf_lpo.errors import UserInputError

UP = np.array([0.0, 1.0, 0.0])
FEWEST = 3
"""Frames that a parabola needs."""
REACH = 0.15
"""How far from an outline its edge is looked for, relative to the object: blur by more than that moves the outline."""
ROOM = 4
"""Pixels kept around the object, so that nothing at the outline is cut away."""


@dataclass(frozen=True)
class Appearance:
    """One image.

    tangents: how far the outline reaches (DIRECTIONS,), NaN where it is cut off, see :func:`outline_tangents`
    pixels: of the object
    size: its longer side [pixels]
    centre: of its pixels, x right, y down [pixels, (2,)]
    cut: it touches the border of what the camera shows
    hazy: part of it that is half transparent, the rim left out
    loose: part of it that does not belong to its largest piece
    widths: of its edge by side [pixels, (SIDES,)], see :func:`edge_widths`
    """

    tangents: np.ndarray
    pixels: int
    size: float
    centre: np.ndarray
    cut: bool
    hazy: float
    loose: float
    widths: np.ndarray

    @property
    def seen(self) -> bool:
        """Whether the object is in the image at all."""
        return self.pixels >= LEAST_OBJECT


NOTHING = Appearance(np.full(DIRECTIONS, np.nan), 0, 0.0, np.full(2, np.nan), False, 0.0, 0.0, np.full(SIDES, np.nan))


def appearance(pixels: np.ndarray, view: View) -> Appearance:
    """Look at one image, colour and opacity [0..1, (H, W, 4)]."""
    height, width = (int(np.flatnonzero(view.valid.any(axis=1 - axis))[-1]) + 1 for axis in (0, 1))
    solid = pixels[:height, :width, 3] > 0.5
    if np.count_nonzero(solid) < LEAST_OBJECT:
        return NOTHING
    rows, columns = (np.flatnonzero(solid.any(axis=1 - axis)) for axis in (0, 1))
    size = float(max(np.ptp(rows), np.ptp(columns)) + 1)
    room = ROOM + int(np.ceil(REACH * size))
    top, left = max(rows[0] - room, 0), max(columns[0] - room, 0)
    part = np.s_[top : min(rows[-1] + room + 1, height), left : min(columns[-1] + room + 1, width)]
    near, solid = pixels[part], solid[part]
    intrinsic = view.intrinsic - np.array([[0.0, 0.0, left], [0.0, 0.0, top], [0.0, 0.0, 0.0]])
    seen = picture(near, None if view.plate is None else view.plate[part])
    points, inside = outline_points(near[..., 3], intrinsic, view.valid[:height, :width][part])
    y, x = np.nonzero(solid)
    within, beyond = ndimage.binary_erosion(solid, iterations=RIM), ~ndimage.binary_dilation(solid, iterations=RIM)
    hazy = (near[..., 3] < 0.9) & within | (near[..., 3] > 0.1) & beyond  # away from the outline's rim in a matte
    areas = np.bincount(ndimage.label(solid, structure=np.ones((3, 3)))[0].ravel())[1:]
    return Appearance(
        tangents=outline_tangents(points, inside),
        pixels=len(x),
        size=size,
        centre=np.array([x.mean() + left + 0.5, y.mean() + top + 0.5]),
        cut=not inside.all(),
        hazy=float(hazy.sum() / len(x)),
        loose=float(1.0 - areas.max() / areas.sum()),
        widths=edge_widths(seen, near[..., 3], REACH * size),
    )


@dataclass(frozen=True)
class Hull:
    """What all views allow in a frame.

    points, cell: centres of its cells [m, (N, 3)] and their edge [m]
    mattes: where the object is in every view [(H, W), bool]
    outside: part of each matte that the hull does not cover [(V,)]
    """

    points: np.ndarray
    cell: float
    mattes: tuple[np.ndarray, ...]
    outside: tuple[float, ...]


@dataclass(frozen=True)
class Look:
    """A scene and what its images say.

    appearances: of every view and frame
    planes: tangent planes of every view at the common times
    views: of every frame: the cameras to which the body looks at the common time as in the image, which may be later
    lower, upper: box that the outlines allow at frame 0 [m, (3,) each]; NaN where nothing is
    motion: parabola of the frames before contact, of three where contact is earlier
    flight: number of these frames
    centre, lowest: height in every frame [m, (F,)], NaN where too little is seen
    residual: rms distance from the parabola in its frames [m]
    hulls: of the first and the contact frame
    """

    scene: WrittenScene
    appearances: tuple[tuple[Appearance, ...], ...]
    planes: tuple[tuple[Planes, ...], ...]
    views: Mapping[int, tuple[View, ...]]
    lower: np.ndarray
    upper: np.ndarray
    motion: Ballistic
    flight: int
    centre: np.ndarray
    lowest: np.ndarray
    residual: float
    hulls: Mapping[int, Hull]

    @property
    def size(self) -> float:
        """Longest edge of the body at frame 0 [m]."""
        return float((self.upper - self.lower).max())

    @property
    def parabolas(self) -> tuple[np.ndarray, np.ndarray]:
        """Heights of the centre and of the lowest point on the parabola in every frame [m, (F,) each]."""
        centre = self.motion.at(self.scene.times)[:, 1]
        below = np.nanmean((self.lowest - centre)[: self.flight])
        return centre, centre + below


def examine(folder: Path) -> Look:
    """Look at every image of a scene; UserInputError for a missing or damaged file, or where too little is seen."""
    scene = read_written_scene(folder)
    images = tqdm(list(product(scene.views, range(len(scene.times)))), "looking at the scene", delay=2.0, leave=False)
    shown = (appearance(scene.pixels(view, frame), view) for view, frame in images)
    appearances = tuple(tuple(islice(shown, len(scene.times))) for _ in scene.views)
    planes = tuple(_planes(scene, *pair) for pair in zip(scene.views, appearances, strict=True))
    frames = [Planes.of(parts) for parts in zip(*planes, strict=True)]
    flight = min(max(scene.hit_frame, FEWEST), len(frames))
    if any(len(planes.offsets) == 0 for planes in frames[:flight]) or flight < FEWEST:
        raise UserInputError(f"{folder}: the object is not seen in the first {FEWEST} frames; look at the images m_*")
    motion = fit_ballistic(frames[:flight], scene.times[:flight])
    place = places(frames, motion.shape)
    away = (place - motion.at(scene.times))[:flight]
    lower, upper = bounds(frames[0])
    views = {frame: tuple(_at_common_time(scene, place, frame)) for frame in (0, scene.hit_frame)}
    hulls = {frame: _hull(scene, frame, views[frame], frames[frame]) for frame in views}
    lowest = np.array([lowest_point(planes, UP) for planes in frames])
    residual, centre = float(np.sqrt(np.nanmean((away**2).sum(axis=1)))), place[:, 1]
    return Look(scene, appearances, planes, views, lower, upper, motion, flight, centre, lowest, residual, hulls)


def _planes(scene: WrittenScene, view: View, seen: Sequence[Appearance]) -> tuple[Planes, ...]:
    tangents = np.stack([one.tangents for one in seen])
    if view.offset:
        tangents = resampled(tangents, scene.times + view.offset, scene.times)
    return tuple(tangent_planes(row, view.pose) for row in tangents)


def _at_common_time(scene: WrittenScene, place: np.ndarray, frame: int) -> Iterator[View]:
    """The cameras less what the body moves between the common time and theirs; ``place`` is where it is [m, (F, 3)]."""
    for view in scene.views:
        later = resampled(place, scene.times, scene.times[frame : frame + 1] + view.offset)[0] - place[frame]
        yield view.after(later) if view.offset and np.isfinite(later).all() else view


def _hull(scene: WrittenScene, frame: int, views: Sequence[View], planes: Planes) -> Hull:
    mattes = tuple((scene.pixels(view, frame)[..., 3] > 0.5) & view.valid for view in views)
    lower, upper = bounds(planes)
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        return Hull(np.empty((0, 3)), 1.0, mattes, (float("nan"),) * len(mattes))
    points, cell = visual_hull(views, mattes, lower, upper)
    outside = [outside_share(matte, points, cell, view) for matte, view in zip(mattes, views, strict=True)]
    return Hull(points, cell, mattes, tuple(outside))
