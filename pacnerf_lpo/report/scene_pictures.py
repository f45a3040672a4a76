"""Each camera's first and contact frame with what is known drawn in, as SVG, and the scene in 3-D as data."""

from typing import Any

import numpy as np

from pacnerf_lpo.data.recordings.look import Look
from pacnerf_lpo.data.recordings.voxel_hull import hull_picture
from pacnerf_lpo.data.recordings.written_scene import View, picture
from pacnerf_lpo.report import overlay
from pacnerf_lpo.report.encoding import atlas, base64_array, quantised
from pacnerf_lpo.report.page import parts

IMAGE_BUDGET = 4_500_000
LADDER = ((1280, 80), (960, 78), (720, 75), (540, 70), (400, 60))
"""Longest side [pixels] and quality of the images, of which the first that fits the budget is taken."""
MOST_POINTS = 8000
FRUSTUM = 0.18
"""Length of a drawn camera, relative to its distance from the body."""


def camera_pictures(look: Look) -> list[list[str]]:
    """The SVG of every camera's first and contact frame [(V, 2)], small enough to travel inside the page."""
    frames = (0, look.scene.hit_frame)
    photos = [[_photo(look, view, frame) for frame in frames] for view in look.scene.views]
    for longest, quality in LADDER:
        images = [[_encoded(photo, longest, quality) for photo in row] for row in photos]
        if sum(len(uri) for row in images for uri in row) <= IMAGE_BUDGET:
            break
    return [
        [_drawn(look, number, frame, uri) for frame, uri in zip(frames, row, strict=True)]
        for number, row in enumerate(images)
    ]


def ground_step(look: Look) -> float:
    """Edge of the squares of the drawn ground [m]."""
    return _ground(look)[1]


def space_data(look: Look) -> dict[str, Any]:
    """Cameras, hull at frame 0, box and ground for the page's view into space."""
    hull = look.hulls[0]
    chosen = np.random.default_rng(0).permutation(len(hull.points))[:MOST_POINTS]
    points = hull.points[chosen] if len(chosen) else look.scene.lower[None]
    integers, lower, extent = quantised(points)
    middle = 0.5 * (look.scene.lower + look.scene.upper)
    return {
        "points": base64_array(integers),
        "lower": lower,
        "extent": extent,
        "count": len(chosen),
        "cell": hull.cell,
        "box": [look.scene.lower.tolist(), look.scene.upper.tolist()],
        "ground": look.scene.ground_height,
        "axis": _axis_length(look),
        "cameras": [_frustum(view, middle) for view in look.scene.views],
    }


def _photo(look: Look, view: View, frame: int) -> np.ndarray:
    """What the camera saw [0..255, (H, W, 3), uint8]; grey where it shows nothing."""
    seen = picture(look.scene.pixels(view, frame), view.plate)
    seen = np.where(view.valid[..., None], seen, 0.5)
    return np.round(255.0 * np.clip(seen, 0.0, 1.0)).astype(np.uint8)


def _encoded(photo: np.ndarray, longest: int, quality: int) -> str:
    height, width = photo.shape[:2]
    ratio = min(1.0, longest / max(height, width))
    return atlas(photo[None], (max(1, round(width * ratio)), max(1, round(height * ratio))), quality)


def _drawn(look: Look, number: int, frame: int, image: str) -> str:
    scene, view, hull = look.scene, look.scene.views[number], look.hulls[frame]
    moving = look.views[frame][number]
    height, width = view.valid.shape
    layers = (
        ("grid", overlay.lines(_ground(look)[0], view)),
        ("box", overlay.lines(overlay.box_edges(scene.lower, scene.upper), moving)),
        ("hull", overlay.outline(*hull_picture(hull.points, hull.cell, moving))),
        ("matte", overlay.outline(hull.mattes[number], np.zeros(2), 1.0)),
    )
    origin = 0.5 * (scene.lower + scene.upper)
    origin[1] = scene.ground_height
    size = 0.055 * max(height, width)
    least, most = 0.9 * size, (width - 0.9 * size, height - 0.5 * size)
    axes = [
        (name, line, *np.clip(end, least, most)) for name, line, end in overlay.axes(origin, _axis_length(look), view)
    ]
    title = f"camera {view.name}, frame {frame}"
    return parts("scene").picture(width, height, title, image, layers, axes, size)


def _ground(look: Look) -> tuple[list[overlay.Segment], float]:
    """Grid under the box and the body at contact, with half their size around them, and its step [m]."""
    hulls = [hull.points for hull in look.hulls.values() if len(hull.points)]
    every = np.concatenate([look.scene.lower[None], look.scene.upper[None], *hulls])
    lower, upper = every.min(axis=0), every.max(axis=0)
    room = 0.5 * float((upper - lower)[[0, 2]].max())
    return overlay.ground_grid(lower - room, upper + room, look.scene.ground_height)


def _axis_length(look: Look) -> float:
    return 0.6 * float((look.scene.upper - look.scene.lower).max())


def _frustum(view: View, middle: np.ndarray) -> dict[str, Any]:
    """Name, centre and the four corners of the image at a distance [m]."""
    height, width = view.valid.shape
    depth = FRUSTUM * float(np.linalg.norm(middle - view.pose[:, 3]))
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    ahead = (corners - view.intrinsic[:2, 2]) / view.intrinsic[[0, 1], [0, 1]] * [1.0, -1.0]
    rays = np.column_stack((ahead, -np.ones(4))) @ view.pose[:, :3].T
    return {
        "name": view.name,
        "centre": view.pose[:, 3].round(5).tolist(),
        "corners": (view.pose[:, 3] + depth * rays).round(5).tolist(),
    }
