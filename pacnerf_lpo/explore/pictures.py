"""What a camera saw, what the model says, and the residual, with both outlines, as one picture."""

from collections.abc import Sequence

import numpy as np
import torch
from matplotlib import colormaps
from PIL import Image, ImageDraw

from pacnerf_lpo.data.cameras import project
from pacnerf_lpo.data.images import contours
from pacnerf_lpo.evaluation.prediction import to_bytes
from pacnerf_lpo.explore.records import Camera, Outlines
from pacnerf_lpo.report.residual_colours import NEGATIVE, POSITIVE, residual_colours

MEASURED = tuple(round(255 * value) for value in POSITIVE)
MODEL = tuple(round(255 * value) for value in NEGATIVE)
"""Colours of the outlines: those of what only the video, and only the model shows in the residual."""
Window = tuple[float, float, float, float]
"""Left, top, width and height of a part of an image [pixels]."""
GAP = 2
SCALE = colormaps["cividis"].with_extremes(bad="#a0a0a0")
"""Of values on particles: evenly readable with every colour vision; grey where there is none."""
SHADE = 0.6
"""Grey of a body where no particle was drawn."""


def triptych(seen: Outlines, drawn: np.ndarray, side: int, close: bool = False) -> np.ndarray:
    """The measured image with both outlines, large; model and residual, half as large, below each other on its right
    [0..255, (side, W', 3), uint8].

    Args:
        seen: one camera at one frame.
        drawn: the model as the camera sees it [0..1, (H, W, 3)].
        side: height of the picture [pixels].
        close: show a square around the measured body, half as large again, instead of the whole image.
    """
    window = around(seen) if close else (0.0, 0.0, seen.measured.shape[1], seen.measured.shape[0])
    lines = contours(seen.measured), contours(np.nan_to_num(seen.model))
    residual = residual_colours(torch.as_tensor(np.nan_to_num(seen.residual)), 1.0).numpy()
    half = (side - GAP) // 2
    large = enlarged(seen.image, lines, window, side)
    small = [enlarged(drawn, ([], lines[1]), window, half), enlarged(residual, lines, window, half)]
    sheet = Image.new("RGB", (large.width + GAP + small[0].width, side), (190, 190, 190))
    sheet.paste(large, (0, 0))
    for row, image in enumerate(small):
        sheet.paste(image, (large.width + GAP, row * (half + GAP)))
    return np.asarray(sheet)


def around(seen: Outlines) -> Window:
    """A square around the measured body, or around the model's where nothing was measured."""
    height, width = seen.measured.shape
    inside = seen.measured > 0.5 if (seen.measured > 0.5).any() else seen.model > 0.5
    if not inside.any():
        return 0.0, 0.0, width, height
    rows, columns = np.nonzero(inside)
    side = min(1.5 * max(np.ptp(rows), np.ptp(columns)) + 8.0, float(max(height, width)))
    return (columns.min() + columns.max() - side) / 2, (rows.min() + rows.max() - side) / 2, side, side


def enlarged(
    image: np.ndarray, lines: tuple[Sequence[np.ndarray], Sequence[np.ndarray]], window: Window, height: int
) -> Image.Image:
    """A part of a picture [0..1, (H, W, 3)] at another height, with the outlines of the video and of the model."""
    left, top, wide, high = window
    factor = height / high
    whole = Image.fromarray(to_bytes(torch.as_tensor(np.nan_to_num(image))))
    whole = whole.resize((round(image.shape[1] * factor), round(image.shape[0] * factor)), Image.Resampling.BILINEAR)
    sheet = Image.new("RGB", (round(wide * factor), height), "white")
    corner = np.array([left, top])
    sheet.paste(whole, tuple(np.rint(-corner * factor).astype(int).tolist()))
    pencil = ImageDraw.Draw(sheet)
    for some, colour in zip(lines, (MEASURED, MODEL), strict=True):
        for line in some:
            pencil.line([tuple(point) for point in (line - corner) * factor], fill=colour, width=2)
    return sheet


def drawing(positions: np.ndarray, colours: np.ndarray, size: float, opacity: np.ndarray, camera: Camera) -> np.ndarray:
    """Particles as discs before a camera, cut out along the model's outline, on white [0..1, (H, W, 3)].

    Args:
        positions: of the particles [m, (N, 3)].
        colours: of them [0..1, (N, 3)].
        size: distance between neighbouring particles [m].
        opacity: of the model [0..1, (H, W)].
    """
    height, width = opacity.shape
    pose, matrix = camera.camera_to_world, camera.intrinsics
    given = (torch.as_tensor(array).double() for array in (positions, matrix, pose))
    pixels, depth = (part.numpy() for part in project(*given))
    order = np.argsort(-depth)  # far to near: the nearest is painted last
    order = order[np.isfinite(pixels[order]).all(-1) & (depth[order] > 0)]
    (u, v), depth = pixels[order].T, depth[order]
    body = np.full((height, width, 3), SHADE)
    reach = max(1, round(0.8 * size * matrix[0, 0] / float(np.median(depth)))) if len(depth) else 1
    du, dv = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    disc = du**2 + dv**2 <= reach**2
    column, row = np.floor(u)[:, None].astype(int) + du[disc], np.floor(v)[:, None].astype(int) + dv[disc]
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    painted_by = np.broadcast_to(np.arange(len(order))[:, None], column.shape)[inside]
    body[row[inside], column[inside]] = colours[order][painted_by]
    matte = np.clip(np.nan_to_num(opacity), 0.0, 1.0)[..., None]
    return 1.0 - matte * (1.0 - body)


def painted(values: np.ndarray, most: float) -> np.ndarray:
    """Colours of values from 0 to ``most`` [(...)], grey where there is none [0..255, (..., 3), uint8]."""
    return np.asarray(SCALE(np.ma.masked_invalid(np.clip(values / (most or 1.0), 0.0, 1.0)), bytes=True)[..., :3])
