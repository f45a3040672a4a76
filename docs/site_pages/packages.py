"""The picture of the packages, made from the layers that ``pyproject.toml`` declares and ``make lint`` checks."""

from __future__ import annotations

import importlib
import inspect
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT, GAP = 760, 34, 8
WORDS = """
A package imports only packages in rows below its own, inside functions too. Packages in one row do not import each
other. `make lint` checks this; the picture is made from the same declaration in `pyproject.toml`.
"""


def layers() -> list[list[str]]:
    """Names of packages and modules, the highest layer first; those of one layer do not import each other."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (contract,) = (one for one in declared if one["type"] == "layers")
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def picture() -> str:
    """The layers as an SVG."""
    parts = []
    for row, names in enumerate(layers()):
        width = (WIDTH - GAP * (len(names) - 1)) / len(names)
        for column, name in enumerate(names):
            x, y = column * (width + GAP), row * (HEIGHT + GAP)
            parts.append(
                f'<rect x="{x:.0f}" y="{y}" width="{width:.0f}" height="{HEIGHT}" rx="4" fill="#4051b5" '
                f'fill-opacity="{0.95 - 0.022 * row:.2f}"/><text x="{x + width / 2:.0f}" y="{y + HEIGHT / 2 + 5:.0f}" '
                f'text-anchor="middle" fill="#fff" font-family="monospace" font-size="14">{name}</text>'
            )
    height = len(layers()) * (HEIGHT + GAP)
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}">{"".join(parts)}</svg>'


def _purpose(name: str) -> str:
    lines = (inspect.getdoc(importlib.import_module(f"pacnerf_lpo.{name}")) or "").splitlines()
    return lines[0] if lines else ""


def pages() -> dict[str, str]:
    """The page of the packages, and its picture."""
    rows = [f"| `{name}` | {_purpose(name)} |" for names in layers() for name in names if name != "__main__"]
    table = "\n".join(["| package or module | what it is for |", "|---|---|", *rows])
    shown = "![The packages in layers, from the command line at the top to errors at the bottom](packages.svg)"
    text = "\n\n".join(["# The packages", WORDS.strip(), shown, table]) + "\n"
    return {"packages.md": text, "packages.svg": picture()}
