"""What the other cameras say about where a camera sees the object: their visual hull without it (Laurentini 1994).

A matte that is wrong in one view, where colours do not tell object and background apart, is right in most others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage
from tqdm import tqdm

from pacnerf_lpo.data.recordings.voxel_hull import RASTER, hull_picture, projected
from pacnerf_lpo.data.recordings.written_scene import View

FEWEST = 3
"""Other views that a hull needs: two allow everything along their lines of sight."""
OUTVOTED = 4
"""Other views from which on one of them may miss a part of the object."""
CELLS = 44
"""Cells along the box around all motion."""
HALVED = 2
"""How often cells on the object are halved: then they are about as large as a pixel, where it fills a third of one."""
NEAR = 2
"""Pixels by which outlines are widened while cells are large, so that none is lost whose middle is off the object."""
ROOM = 1.4
"""Size of that box relative to what the middle one of the cameras sees of the motion."""
IN_STEP = 0.1
"""Frames nearer in time than this part of a frame are of one moment; else those before and after count together."""
UNSURE = 1.5
"""Pixels by which outlines of good mattes and calibrations differ from each other's hull, beside its cells."""
AGREES = 0.5
"""Part of a matte that lies on the others' hull, below which a calibration or clock is wrong and says nothing here."""
BINS = 3
"""Depths in the hull are counted up to so many pixels, positive and negative: beyond, nothing depends on them."""
SURE = 4.0
"""Log odds up to which the hull counts: an outline has two per cent of wrong pixels."""
FREE = -2.0
"""Log odds below which a pixel counts as background: seven to one."""


@dataclass(frozen=True)
class Silhouettes:
    """What a camera showed.

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
    """What the others say about a camera.

    depth: how far inside their hull each pixel is, negative outside [pixels, (F, H, W)]
    loose: the same for the hull if one of them may be wrong
    unsure: how exact that is [pixels]
    table: log odds of the object by both depths [pixels from -BINS to BINS, (loose, depth)]
    """

    depth: np.ndarray
    loose: np.ndarray
    unsure: float
    table: np.ndarray

    def log_odds(self, frame: int) -> np.ndarray:
        """Log odds of the object in each pixel of a frame, before its colour is looked at [(H, W)]."""
        return self.table[_bins(self.loose[frame]), _bins(self.depth[frame])]

    def free(self, frame: int) -> np.ndarray:
        """Where the others are sure that a frame shows background [(H, W), bool]."""
        return (self.loose[frame] < -self.unsure) | (self.log_odds(frame) < FREE)

    def at(self, frames: np.ndarray) -> Expectation:
        """Of some of the frames, by their numbers."""
        return replace(self, depth=self.depth[frames], loose=self.loose[frames])


def expectations(cameras: Sequence[Silhouettes], centre: np.ndarray) -> list[Expectation | None]:
    """For each camera what the others say; None where they are too few or contradict it.

    Args:
        cameras: of one recording. centre: a point near the middle of the motion, in the unit of the poses (3,).
    """
    if len(cameras) <= FEWEST:
        return [None] * len(cameras)
    points, cell = _box(cameras, centre)
    places = [_pixels(points, camera) for camera in cameras]
    step = float(np.median(np.diff(cameras[0].times)))
    found: list[tuple[np.ndarray, np.ndarray, float] | None] = []
    for number, camera in enumerate(tqdm(cameras, desc="comparing the views", delay=2.0, leave=False)):
        others = [other for other in range(len(cameras)) if other != number]
        depths: list[list[np.ndarray]] = []
        sizes = [1.0]
        for time in camera.times:
            masks = [cameras[other].at(time, step) for other in others]
            wide = [ndimage.binary_dilation(mask, iterations=NEAR) for mask in masks]
            missed, fine = _missed([places[other] for other in others], wide), points
            for level in range(HALVED):
                fine = _halves(fine[missed <= int(len(others) >= OUTVOTED)], cell / 2**level)
                seen = [_pixels(fine, cameras[other]) for other in others]
                missed = _missed(seen, masks if level == HALVED - 1 else wide)
            depths.append([])
            for wrong in (0, int(len(others) >= OUTVOTED)):
                hull = fine[missed <= wrong]
                if len(hull):
                    picture, corner, scale = hull_picture(hull, cell / 2**HALVED, camera.view)
                    sizes.append(RASTER / scale)
                    depths[-1].append(_depth(picture, corner, scale, camera.masks.shape[1:]))
                else:
                    depths[-1].append(np.full(camera.masks.shape[1:], -float(max(camera.masks.shape))))
        strict, loose = np.array(depths, np.float32).swapaxes(0, 1)
        unsure = UNSURE + float(np.median(sizes))
        found.append((strict, loose, unsure) if _agrees(strict, loose, unsure, camera.masks) else None)
    table = _table([(*one[:2], camera.masks) for one, camera in zip(found, cameras, strict=True) if one is not None])
    return [None if one is None else Expectation(*one, table) for one in found]


def _agrees(strict: np.ndarray, loose: np.ndarray, unsure: float, masks: np.ndarray) -> bool:
    inside = (masks & (loose > -unsure)).sum()
    return bool(masks.any() and (strict > 0.0).any() and inside >= AGREES * masks.sum())


def _bins(depth: np.ndarray) -> np.ndarray:
    return (np.clip(np.round(depth), -BINS, BINS) + BINS).astype(int)


def _table(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Log odds of the object at each pair of depths, counted in all views and frames [(2 BINS + 1, 2 BINS + 1)].

    Args:
        parts: depth in the hull and in the loose one, and masks, of each view [(F, H, W) each].
    """
    counts = np.full((2, 2 * BINS + 1, 2 * BINS + 1), 0.5)  # Jeffreys' prior
    for strict, loose, masks in parts:
        np.add.at(counts, (masks.astype(int), _bins(loose), _bins(strict)), 1.0)
    return np.clip(np.log(counts[1] / counts[0]), -SURE, SURE)


def _halves(points: np.ndarray, cell: float) -> np.ndarray:
    """The centres of the eight halves of each cell, of this edge [(8 N, 3)]."""
    corners = 2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0
    return (points[:, None] + 0.25 * cell * corners).reshape(-1, 3)


def _box(cameras: Sequence[Silhouettes], centre: np.ndarray) -> tuple[np.ndarray, float]:
    """Centres of cells [(N, 3)] around all motion, and their edge."""
    reaches = []
    for camera in cameras:
        y, x = np.nonzero(camera.masks.any(axis=0))
        middle, depth = projected(centre[None], camera.view)
        if len(x) and depth[0] > 0:
            away = np.linalg.norm(np.stack((x, y), axis=-1) + 0.5 - middle, axis=-1).max()
            reaches.append(away * depth[0] / camera.view.intrinsic[0, 0])
    half = ROOM * float(np.median(reaches))
    cell = 2.0 * half / CELLS
    axis = (np.arange(CELLS) + 0.5) * cell - half
    return centre + np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3), cell


def _pixels(points: np.ndarray, camera: Silhouettes) -> tuple[np.ndarray, np.ndarray]:
    """Index of each point's pixel in a flat image, and whether the camera sees it [(N,) each]."""
    pixels, depth = projected(points, camera.view)
    height, width = camera.masks.shape[1:]
    inside = (depth > 0) & np.all((pixels >= 0) & (pixels < (width, height)), axis=1)
    column, row = np.where(inside[:, None], pixels, 0.0).astype(int).T
    flat = row * width + column
    return flat, inside & camera.view.valid.ravel()[flat]


def _missed(places: Sequence[tuple[np.ndarray, np.ndarray]], masks: Sequence[np.ndarray]) -> np.ndarray:
    """In how many views that see a point it is off the object; all of them, where too few see it [(N,)]."""
    missed, seen = np.zeros((2, len(places[0][0])), int)
    for (flat, inside), mask in zip(places, masks, strict=True):
        missed += inside & ~mask.ravel()[flat]
        seen += inside
    return np.where(seen > len(masks) / 2, missed, len(masks))


def _depth(picture: np.ndarray, corner: np.ndarray, scale: float, shape: tuple[int, int]) -> np.ndarray:
    """Signed distance from the rim of a hull's picture in each pixel of an image, positive inside [pixels, (H, W)]."""
    room = round(10 * scale)
    padded = np.pad(picture, room)
    signed = ndimage.distance_transform_edt(padded) - ndimage.distance_transform_edt(~padded)
    rows, columns = (
        np.floor((np.arange(n) + 0.5 - c) * scale).astype(int) + room for n, c in zip(shape, corner[::-1], strict=True)
    )
    grid = np.ix_(np.clip(rows, 0, padded.shape[0] - 1), np.clip(columns, 0, padded.shape[1] - 1))
    outside = ~np.logical_and.outer(_within(rows, padded.shape[0]), _within(columns, padded.shape[1]))
    return np.where(outside, -float(max(shape)), signed[grid] / scale)


def _within(places: np.ndarray, count: int) -> np.ndarray:
    return (places >= 0) & (places < count)
