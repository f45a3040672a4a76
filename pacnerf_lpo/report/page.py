"""The shell that all self-contained pages share: head, style, body, data and scripts in one file."""

import html
from collections.abc import Mapping, Sequence
from string import Template
from typing import Any

from pacnerf_lpo.report.encoding import asset, json_text


def page(
    name: str, title: str, styles: Sequence[str], scripts: Sequence[str], data: Mapping[str, Any], **parts: str
) -> str:
    """A page as text.

    Args:
        name: of its template among the assets, without ``.html``.
        title: of the window.
        styles, scripts: names of assets, in their order.
        data: that the scripts read.
        parts: HTML of the places of the template; ``$particles`` is the stage of moving particles everywhere.
    """
    return Template(asset("page.html")).substitute(
        title=html.escape(title),
        style="\n".join(map(asset, styles)),
        body=Template(asset(f"{name}.html")).substitute(particles=asset("particles.html"), **parts),
        data=json_text(data),
        scripts="\n".join(map(asset, scripts)),
    )
