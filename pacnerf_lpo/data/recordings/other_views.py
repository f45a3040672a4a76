"""What the other cameras say about where a camera sees the object: their visual hull without it (Laurentini 1994).

A matte that is wrong in one view, where colours do not tell object and background apart, is right in most others. The
hull is looked for along the ray of each pixel, as what every other view sees on its object (image-based visual hulls:
Matusik et al. 2000), so that it is as exact as the outlines are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.recordings.footage import enlarged
from pacnerf_lpo.data.recordings.voxel_hull import projected
from pacnerf_lpo.data.recordings.written_scene import View

FEWEST = 3
"""Other views that a hull needs: two allow everything along their lines of sight."""
OUTVOTED = 4
"""Other views from which on one of them may miss a part of the object."""
DEPTHS = 96
"""Points along each ray within the room of the motion: then a body is missed at its rim alone, by a part of a pixel."""
ROOM = 1.4
"""Size of that room relative to what the middle one of the cameras sees of the motion."""
IN_STEP = 0.1
"""Frames nearer in time than this part of a frame are of one moment; else those before and after count together."""
UNSURE = 2.0
"""Pixels by which outlines of good mattes and calibrations differ from each other's hull: a half in each of four."""
AGREES = 0.5
"""Part of a matte that lies on the others' hull, below which a calibration or clock is wrong and says nothing here."""
BINS = 3
"""Depths in the hull are counted up to so many pixels, positive and negative: beyond, nothing depends on them."""
SURE = 4.0
"""Log odds against the object down to which the hull counts: an outline has two per cent of wrong pixels."""
INSIDE = 1.0
"""Log odds for it up to which the hull counts: a body fills three quarters of what a handful of views allow it."""
FREE = -2.0
"""Log odds below which a pixel counts as background: seven to one."""


@dataclass(frozen=True)
class Silhouettes:
    """What a camera showed, at reduced resolution.

    view: its pose and intrinsics
    times: of its frames, by the common clock [s, (F,)]
    masks: where the object is in each [(F, H, W), bool]
    """

    view: View
    times: np.ndarray
    masks: np.ndarray

    def at(self, time: float, step: float) -> np.ndarray:
        """The mask at a time [s]; the frames before and after it together, where there is none then [(H, W), bool]."""
        near = np.abs(self.times - time) < step
        exact = np.abs(self.times - time) < IN_STEP * step
        return np.asarray(self.masks[exact if exact.any() else near].any(axis=0))


@dataclass(frozen=True)
class Expectation:
    """What the others say about a camera, at reduced resolution.

    depth: how far inside their hull each pixel is, negative outside [pixels, (F, H, W)]
    loose: the same for the hull if one of them may be wrong
    contradicted: largest part of a matte of this camera that lies outside their hull by more than UNSURE
    table: log odds of the object by both depths [pixels from -BINS to BINS, (loose, depth)]
    """

    depth: np.ndarray
    loose: np.ndarray
    contradicted: float
    table: np.ndarray

    def log_odds(self, frame: int, shape: tuple[int, ...] | None = None) -> np.ndarray:
        """Log odds of the object in each pixel of a frame, before its colour is looked at [(H, W)]; of ``shape``."""
        found = self.table[_bins(self.loose[frame]), _bins(self.depth[frame])]
        return found if shape is None else enlarged(found, shape)

    def free(self, frame: int) -> np.ndarray:
        """Where the others are sure that a frame shows background [(H, W), bool]."""
        return (self.loose[frame] < -UNSURE) | (self.log_odds(frame) < FREE)


def expectations(cameras: Sequence[Silhouettes], centre: np.ndarray) -> list[Expectation | None]:
    """For each camera of a recording what the others say; None where they are too few or contradict it. ``centre`` is a
    point near the middle of the motion, in the unit of the poses (3,).
    """
    if len(cameras) <= FEWEST:
        return [None] * len(cameras)
    half, step = _room(cameras, centre), float(np.median(np.diff(cameras[0].times)))
    wrong = int(len(cameras) > OUTVOTED)
    found: list[tuple[np.ndarray, np.ndarray, float] | None] = []
    # of pixels off and on an object, by their depths in the loose hull and in the strict one; Jeffreys' prior
    counts = np.full((2, 2 * BINS + 1, 2 * BINS + 1), 0.5)
    for number, camera in enumerate(cameras):
        others, shape = [*cameras[:number], *cameras[number + 1 :]], camera.masks.shape[1:]
        rays = _rays(camera.view, shape, centre, half, others, wrong)
        masks = ([other.at(time, step) for other in others] for time in camera.times)
        depth, loose = np.array([_depths(*rays, shown, shape, wrong) for shown in masks], np.int8).swapaxes(0, 1)
        inside = (camera.masks & (loose > -UNSURE)).sum()
        seen = camera.masks.any() and (depth > 0).any() and inside >= AGREES * camera.masks.sum()
        off = (camera.masks & (depth < -UNSURE)).sum(axis=(1, 2)) / np.maximum(camera.masks.sum(axis=(1, 2)), 1)
        found.append((depth, loose, float(off.max())) if seen else None)
        if seen:
            cells = np.ravel_multi_index((camera.masks.astype(int), _bins(loose), _bins(depth)), counts.shape)
            counts += np.bincount(cells.ravel(), minlength=counts.size).reshape(counts.shape)
    table = np.clip(np.log(counts[1] / counts[0]), -SURE, INSIDE)
    return [None if one is None else Expectation(*one, table) for one in found]


def _bins(depth: np.ndarray) -> np.ndarray:
    return np.clip(depth, -BINS, BINS).astype(int) + BINS


def _room(cameras: Sequence[Silhouettes], centre: np.ndarray) -> float:
    """How far around the centre there is motion."""
    reaches = []
    for camera in cameras:
        y, x = np.nonzero(camera.masks.any(axis=0))
        middle, depth = projected(centre[None], camera.view)
        if len(x) and depth[0] > 0:
            away = np.linalg.norm(np.stack((x, y), axis=-1) + 0.5 - middle, axis=-1).max()
            reaches.append(away * depth[0] / camera.view.intrinsic[0, 0])
    return ROOM * float(np.median(reaches))


def _rays(
    view: View, shape: tuple[int, ...], centre: np.ndarray, half: float, others: Sequence[Silhouettes], wrong: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Points along the rays of a camera's pixels that more than half of the other views see, without those that are
    off the motion in more than ``wrong`` of them: for each its pixel [(N,)], and in each other view its pixel in a flat
    image, or the end of that where it does not see it [(N,) each].
    """
    distance = float(-(centre - view.pose[:, 3]) @ view.pose[:, 2])
    depths = distance + half * np.linspace(-1.0, 1.0, DEPTHS)
    depths = depths[depths > 0.0]
    row, column = np.indices(shape).reshape(2, -1) + 0.5
    (fx, _, cx), (_, fy, cy), _ = view.intrinsic
    rays = np.column_stack(((column - cx) / fx, (cy - row) / fy, -np.ones(row.size))) @ view.pose[:, :3].T
    pixel, depth = np.repeat(np.arange(row.size), len(depths)), np.tile(depths, row.size).astype(np.float32)
    flat: list[np.ndarray] = []
    for other in others:
        turn, ((fx, _, cx), (_, fy, cy), _) = other.view.pose[:, :3], other.view.intrinsic
        start = ((view.pose[:, 3] - other.view.pose[:, 3]) @ turn)[:, None]
        x, y, z = start + np.take((rays @ turn).T.astype(np.float32, order="C"), pixel, axis=1) * depth
        away = np.minimum(z, -1e-6 * abs(fx))
        column, row = np.floor(cx - fx * x / away), np.floor(cy + fy * y / away)
        height, width = other.masks.shape[1:]
        inside = (z < 0.0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        place = np.where(inside, row * width + column, 0).astype(np.int32)
        flat.append(np.where(inside & other.view.valid.ravel()[place], place, np.int32(height * width)))
        motion = [np.asarray(one.masks.any(axis=0)) for one in others[: len(flat)]]
        kept = np.flatnonzero(_missed(flat, motion) <= wrong)
        pixel, depth, flat = pixel[kept], depth[kept], [place[kept] for place in flat]
    seen = sum(place < other.masks[0].size for place, other in zip(flat, others, strict=True))
    enough = np.flatnonzero(seen > len(others) / 2)
    return pixel[enough], [place[enough] for place in flat]


def _depths(
    pixel: np.ndarray, flat: Sequence[np.ndarray], masks: Sequence[np.ndarray], shape: tuple[int, ...], wrong: int
) -> list[np.ndarray]:
    """How far inside the hull each pixel of :func:`_rays` is, and inside that in which ``wrong`` of the other views, of
    masks [(H, W), bool], may be wrong [(H, W) each].
    """
    missed, found = _missed(flat, masks), []
    for allowed in (0, wrong):
        hull = np.zeros(shape, bool)
        hull.ravel()[pixel[missed <= allowed]] = True
        away = -ndimage.distance_transform_edt(~hull) if hull.any() else np.full(shape, -np.inf)
        signed = np.where(hull, ndimage.distance_transform_edt(hull), away)
        found.append(np.clip(np.round(signed), -BINS - UNSURE, BINS + UNSURE))
    return found


def _missed(flat: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """In how many views that see a point it is off the object [(N,)]."""
    missed = np.zeros(len(flat[0]), np.int8)
    for place, mask in zip(flat, masks, strict=True):
        missed += np.append(~mask, False)[place]
    return missed
