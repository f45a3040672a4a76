"""Images, numbers and files as text inside an HTML page."""

import base64
import io
import json
import math
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

import numpy as np
from PIL import Image


def asset(name: str) -> str:
    """A template, style sheet or script of the pages."""
    return (files("pacnerf_lpo.report") / "assets" / name).read_text()


def json_text(values: Mapping[str, Any]) -> str:
    """JSON that may stand inside a script element."""
    return json.dumps(values, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def plain(values: np.ndarray, digits: int = 5) -> list[Any]:
    """Numbers as JSON has them, nested as the array is; None where there is none."""
    if values.ndim > 1:
        return [plain(row, digits) for row in values]
    return [round(float(value), digits) if np.isfinite(value) else None for value in values]


def data_uri(content: bytes, kind: str) -> str:
    """A data URI, such as ``data:image/webp;base64,...``."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def base64_array(values: np.ndarray) -> str:
    """The raw little-endian bytes of an array, base64."""
    return base64.b64encode(np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()).decode()


def atlas_columns(frames: int) -> int:
    """Columns of an atlas of that many frames."""
    return math.ceil(math.sqrt(frames))


def atlas(frames: np.ndarray, size: tuple[int, int], quality: int) -> str:
    """All frames of a view in one WebP picture, row by row, as a data URI.

    Args:
        frames: [0..255, (F, H, W, 3), uint8]
        size: (width, height) of one frame in the picture.
        quality: WebP quality, 0..100.
    """
    columns = atlas_columns(len(frames))
    rows = math.ceil(len(frames) / columns)
    sheet = Image.new("RGB", (columns * size[0], rows * size[1]), "white")
    for index, frame in enumerate(frames):
        image = Image.fromarray(np.ascontiguousarray(frame))
        if image.size != size:
            image = image.resize(size, Image.Resampling.BOX)
        sheet.paste(image, (index % columns * size[0], index // columns * size[1]))
    content = io.BytesIO()
    sheet.save(content, "WEBP", quality=quality, method=4)
    return data_uri(content.getvalue(), "image/webp")


def quantised(positions: np.ndarray) -> tuple[np.ndarray, list[float], list[float]]:
    """Positions [m, (..., 3)] as 16-bit integers within their bounding box: integers, lower corner, extent [m]."""
    lower = positions.reshape(-1, 3).min(0)
    extent = np.maximum(positions.reshape(-1, 3).max(0) - lower, 1e-9)
    return np.rint((positions - lower) / extent * 65535).astype(np.uint16), lower.tolist(), extent.tolist()
