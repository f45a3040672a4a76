"""Looking at a written scene: outlines, hulls and motion as they are with the values that scene.yaml has now."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pacnerf_lpo.data.recordings.appearances import Appearance, appearance
from pacnerf_lpo.data.recordings.clocks import resampled
from pacnerf_lpo.data.recordings.fall import Ballistic, fit_ballistic, lowest_point, places
from pacnerf_lpo.data.recordings.tangents import Planes, bounds, tangent_planes
from pacnerf_lpo.data.recordings.voxel_hull import outside_share, visual_hull
from pacnerf_lpo.data.recordings.written_scene import View, WrittenScene, read_written_scene
from pacnerf_lpo.errors import UserInputError

UP = np.array([0.0, 1.0, 0.0])
FEWEST = 3
"""Frames that a parabola needs."""


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
    appearances, mattes = _appearances(scene)
    planes = tuple(_planes(scene, *pair) for pair in zip(scene.views, appearances, strict=True))
    frames = [Planes.of(parts) for parts in zip(*planes, strict=True)]
    flight = min(max(scene.hit_frame, FEWEST), len(frames))
    if any(len(planes.offsets) == 0 for planes in frames[:flight]) or flight < FEWEST:
        raise UserInputError(f"{folder}: the object is not seen in the first {FEWEST} frames; look at the images m_*")
    motion = fit_ballistic(frames[:flight], scene.times[:flight])
    place = places(frames, motion.shape)
    away = (place - motion.at(scene.times))[:flight]
    lower, upper = bounds(frames[0])
    views = {frame: _at_common_time(scene, place, frame) for frame in mattes}
    hulls = {frame: _hull(views[frame], frames[frame], seen) for frame, seen in mattes.items()}
    lowest = np.array([lowest_point(planes, UP) for planes in frames])
    residual, centre = float(np.sqrt(np.nanmean((away**2).sum(axis=1)))), place[:, 1]
    return Look(scene, appearances, planes, views, lower, upper, motion, flight, centre, lowest, residual, hulls)


def _appearances(scene: WrittenScene) -> tuple[tuple[tuple[Appearance, ...], ...], dict[int, list[np.ndarray]]]:
    """What every image shows, by view and frame, and where the object is in the first and the contact frame."""
    mattes: dict[int, list[np.ndarray]] = {0: [], scene.hit_frame: []}
    found: list[tuple[Appearance, ...]] = []
    with tqdm(total=len(scene.views) * len(scene.times), desc="looking at the scene", delay=2.0, leave=False) as bar:
        for view in scene.views:
            row = []
            for frame in range(len(scene.times)):
                pixels = scene.pixels(view, frame)
                row.append(appearance(pixels, view))
                if frame in mattes:
                    mattes[frame].append((pixels[..., 3] > 0.5) & view.valid)
                bar.update()
            found.append(tuple(row))
    return tuple(found), mattes


def _planes(scene: WrittenScene, view: View, seen: Sequence[Appearance]) -> tuple[Planes, ...]:
    tangents = np.stack([one.tangents for one in seen])
    if view.offset:
        tangents = resampled(tangents, scene.times + view.offset, scene.times)
    return tuple(tangent_planes(row, view.pose) for row in tangents)


def _at_common_time(scene: WrittenScene, place: np.ndarray, frame: int) -> tuple[View, ...]:
    """The cameras less what the body moves between the common time and theirs; ``place`` is where it is [m, (F, 3)]."""
    found = []
    for view in scene.views:
        later = resampled(place, scene.times, scene.times[frame : frame + 1] + view.offset)[0] - place[frame]
        found.append(view.after(later) if view.offset and np.isfinite(later).all() else view)
    return tuple(found)


def _hull(views: Sequence[View], planes: Planes, mattes: Sequence[np.ndarray]) -> Hull:
    lower, upper = bounds(planes)
    if not (np.isfinite(lower).all() and np.isfinite(upper).all()):
        return Hull(np.empty((0, 3)), 1.0, tuple(mattes), (float("nan"),) * len(mattes))
    points, cell = visual_hull(views, mattes, lower, upper)
    outside = [outside_share(matte, points, cell, view) for matte, view in zip(mattes, views, strict=True)]
    return Hull(points, cell, tuple(mattes), tuple(outside))
