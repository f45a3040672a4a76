"""HTML from the templates among the assets, the shell that all self-contained pages share, and images, numbers and
files as text inside it.
"""

import base64
import io
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup, escape
from PIL import Image

from pacnerf_lpo.quantities import duration, figure, published, quantity, symbol
from pacnerf_lpo.report.wording import capitalised, readable

PARTS = "_parts.html"
"""Ending of templates with macros: in those, line breaks and the indentation after them are no part of the HTML."""


@cache
def environment() -> Environment:
    """The templates. What they are given is escaped, unless it is HTML already (``Markup``)."""
    made = Environment(
        loader=FunctionLoader(_source),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    named = (capitalised, duration, figure, options, published, quantity, readable, share, short_symbol, shown, signed)
    made.filters |= {function.__name__: function for function in named}
    made.filters |= {"form": format, "symbol": symbol_html, "places": places, "decades": lambda x: x / math.log(10.0)}
    made.tests["finite"] = math.isfinite
    return made


def parts(name: str) -> Any:
    """The macros of ``NAME_parts.html``, as functions that return HTML."""
    return environment().get_template(name + PARTS).module


def page(
    name: str, title: str, styles: Sequence[str], scripts: Sequence[str], data: Mapping[str, Any], **values: Any
) -> str:
    """A page as text: ``values`` fill its template, ``NAME.html``; styles and scripts are names of assets, in their
    order, and the scripts read ``data``.
    """
    template = environment().get_template
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")  # inside a script element
    return template("page.html").render(
        title=title,
        style=Markup("\n".join(map(asset, styles))),
        body=Markup(template(f"{name}.html").render(values)),
        data=Markup(text),
        scripts=Markup("\n".join(map(asset, scripts))),
    )


def shown(value: float, unit: str) -> Markup:
    """A value with its unit, or infinity; the minus sign as in print."""
    size = quantity(abs(value), unit) if math.isfinite(value) else "∞"
    return Markup("&minus;{}" if value < 0 else "{}").format(size)


def signed(value: float) -> Markup:
    """With one digit and a true minus sign."""
    return Markup(f"{value if abs(value) >= 0.05 else 0.0:.1f}".replace("-", "&minus;"))


def share(value: float, most: float) -> str:
    """A length on an axis that ends at ``most``, as CSS has it."""
    return f"{100 * min(max(value / max(most, 1e-12), 0.0), 1.0):.1f}%"


def options(words: str) -> Markup:
    """Plain text with options of the command line as code, each on one line."""
    return Markup(re.sub(r"--\w+", r"<code>\g<0></code>", str(escape(words))))


def places(points: Iterable[tuple[float, float]]) -> str:
    """Points of a line as SVG has them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def symbol_html(name: str) -> Markup:
    """The usual symbol of a parameter with its index."""
    head, _, tail = symbol(name).partition("_")
    return Markup("{}<sub>{}</sub>" if tail else "{}").format(head, tail)


def short_symbol(name: str) -> Markup:
    """The usual symbol; nothing where a parameter has only a name."""
    head, _, tail = symbol(name).partition("_")
    return Markup("") if len(head) > 1 or len(tail) > 2 else symbol_html(name)


def _source(name: str) -> str:
    text = asset(name)
    return "".join(map(str.strip, text.splitlines())) if name.endswith(PARTS) else text


def asset(name: str) -> str:
    """A template, style sheet or script of the pages."""
    return (files("pacnerf_lpo.report") / "assets" / name).read_text()


def plain(values: np.ndarray) -> list[Any]:
    """Numbers as JSON has them, nested as the array is; None where there is none."""
    if values.ndim > 1:
        return [plain(row) for row in values]
    return [round(float(value), 5) if np.isfinite(value) else None for value in values]


def webp_uri(picture: Image.Image, quality: int) -> str:
    """A picture as a data URI, ``data:image/webp;base64,...``; quality 0..100."""
    content = io.BytesIO()
    picture.save(content, "WEBP", quality=quality, method=4)
    return f"data:image/webp;base64,{base64.b64encode(content.getvalue()).decode()}"


def base64_array(values: np.ndarray) -> str:
    """The raw little-endian bytes of an array, base64."""
    return base64.b64encode(np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()).decode()


def size_within(longest: int, height: int, width: int) -> tuple[int, int]:
    """Width and height of a picture that is reduced until its longer side has no more than so many pixels."""
    ratio = min(1.0, longest / max(height, width))
    return max(1, round(width * ratio)), max(1, round(height * ratio))


def atlas_columns(frames: int) -> int:
    """Columns of an atlas of that many frames."""
    return math.ceil(math.sqrt(frames))


def atlas(frames: np.ndarray, size: tuple[int, int], quality: int) -> str:
    """All frames of a view [0..255, (F, H, W[, 3]), uint8] in one WebP picture of a quality 0..100, row by row, as a
    data URI; ``size``: width and height of one frame in the picture.
    """
    columns = atlas_columns(len(frames))
    rows = math.ceil(len(frames) / columns)
    sheet = Image.new("RGB", (columns * size[0], rows * size[1]), "white")
    for index, frame in enumerate(frames):
        image = Image.fromarray(np.ascontiguousarray(frame)).resize(size, Image.Resampling.BOX)
        sheet.paste(image, (index % columns * size[0], index // columns * size[1]))
    return webp_uri(sheet, quality)


def quantised(positions: np.ndarray) -> tuple[np.ndarray, list[float], list[float]]:
    """Positions [m, (..., 3)] as 16-bit integers within their bounding box: integers, lower corner, extent [m]."""
    lower = positions.reshape(-1, 3).min(0)
    extent = np.maximum(positions.reshape(-1, 3).max(0) - lower, 1e-9)
    return np.rint((positions - lower) / extent * 65535).astype(np.uint16), lower.tolist(), extent.tolist()
