"""Tangent planes of a body from its outlines, and what follows from them alone. Pure NumPy and SciPy.

A line that touches an outline, and the camera's centre, span a plane that touches the body: with its outward normal n
(unit) and offset h, every point x of the body has n . x <= h, and one has equality. So h is the body's support function
in the direction n. Nothing is lost to voxels, and an outline of which a part is cut off at the image border still gives
the planes of the rest. The planes of all views together enclose the convex hull of the visual hull (Laurentini 1994).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.optimize import linprog

from pacnerf_lpo.data.images import contours

DIRECTIONS = 72
"""Lines around an outline."""
ANGLES = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
ACROSS = np.stack((np.cos(ANGLES), np.sin(ANGLES)), axis=-1)
BORDER = 1.5
"""An outline that comes this near to the image border may be cut off there [pixels]."""
SMALLEST = 4
"""Pixels that an outline encloses at least."""


@dataclass(frozen=True)
class Planes:
    """Tangent planes: outward unit ``normals`` [(N, 3)] and ``offsets`` n . x [(N,)], in the unit of the poses."""

    normals: np.ndarray
    offsets: np.ndarray

    @staticmethod
    def of(parts: "Sequence[Planes]") -> "Planes":
        """The planes of several views together."""
        return Planes(np.concatenate([p.normals for p in parts]), np.concatenate([p.offsets for p in parts]))

    def moved(self, rotation: np.ndarray, scale: float) -> "Planes":
        """The planes after x -> scale * rotation x."""
        return Planes(self.normals @ rotation.T, scale * self.offsets)


def outline_points(
    silhouette: np.ndarray, intrinsic: np.ndarray, valid: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Points of an outline [x / z right and y / z up, (K, 2)], and which of them are away from what the image cuts off
    [(K,), bool]; none where nothing is seen.

    The outline is the level 0.5 of the opacity ``silhouette`` [0..1, (H, W)], to a fraction of a pixel; intrinsics are
    [pixels, (3, 3)]. ``valid`` is False where the image shows nothing [(H, W), bool]; None: it is nowhere so.
    """
    if np.count_nonzero(silhouette > 0.5) < SMALLEST:
        return np.empty((0, 2)), np.empty(0, bool)
    pixels = np.concatenate(contours(silhouette))
    height, width = silhouette.shape
    inside = np.all((pixels > BORDER) & (pixels < (width - BORDER, height - BORDER)), axis=1)
    if valid is not None and not valid.all():
        room = ndimage.distance_transform_edt(valid)
        column, row = np.clip(pixels.astype(int), 0, (width - 1, height - 1)).T
        inside &= room[row, column] > BORDER
    return (pixels - intrinsic[:2, 2]) / (intrinsic[0, 0], -intrinsic[1, 1]), inside


def outline_tangents(points: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """How far an outline of :func:`outline_points` reaches in each of :data:`DIRECTIONS` directions of the image plane
    [(DIRECTIONS,)]; NaN where nothing is seen, and where the outermost point lies at the image border.
    """
    if len(points) == 0:
        return np.full(DIRECTIONS, np.nan)
    along = ACROSS @ points.T
    return np.where(inside[along.argmax(axis=1)], along.max(axis=1), np.nan)


def tangent_planes(tangents: np.ndarray, pose: np.ndarray) -> Planes:
    """The planes through the tangents of an outline [(DIRECTIONS,), NaN for none] in a camera of a pose (3, 4)."""
    known = np.isfinite(tangents)
    normals = np.column_stack((ACROSS, tangents))[known]
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True) @ pose[:, :3].T
    return Planes(normals, normals @ pose[:, 3])


def outline_planes(silhouette: np.ndarray, intrinsic: np.ndarray, pose: np.ndarray) -> Planes:
    """The tangent planes of an outline, see :func:`outline_points`, in a camera of a pose (camera to world, OpenGL axes
    (3, 4)); none where nothing is seen. Tangents at the image border are left out.
    """
    return tangent_planes(outline_tangents(*outline_points(silhouette, intrinsic)), pose)


def bounds(planes: Planes) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the axis-aligned box around everything that the planes allow [(3,) each]; NaN where nothing is."""
    found = [
        linprog(direction, A_ub=planes.normals, b_ub=planes.offsets, bounds=(None, None), method="highs")
        for direction in (*np.eye(3), *-np.eye(3))
    ]
    least = np.array([one.fun if one.status == 0 else np.nan for one in found], float)
    return least[:3], -least[3:]


def ball(planes: Planes) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of the largest ball that the planes allow; a negative radius is how much they disagree."""
    rows = np.column_stack((planes.normals, np.ones(len(planes.offsets))))
    found = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=planes.offsets, bounds=(None, None), method="highs")
    return (found.x[:3], float(found.x[3])) if found.status == 0 else (np.full(3, np.nan), float("nan"))
