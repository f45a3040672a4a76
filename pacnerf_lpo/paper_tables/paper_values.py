"""What the paper's supplement prints (``paper.yaml``)."""

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import yaml

AVERAGE = "average"


@cache
def _content() -> dict[str, Any]:
    return yaml.safe_load((files("pacnerf_lpo.paper_tables") / "paper.yaml").read_text(encoding="utf-8"))


def paper_truth(scene: str) -> dict[str, float]:
    """Ground truth of one of the paper's scenes by this project's names [SI, degrees]."""
    return dict(_content()["truth"][scene])


def paper_values(table: str, scene: str, quantity: str) -> Sequence[float | None]:
    """A row of a table, one value per column; empty where the paper has no such row.

    Args:
        table: ``table4`` ... ``table16``.
        scene: its name, ``average`` or ``deviation``.
        quantity: ``psnr``, ``ssim``, ``lpips``, the name of a parameter, or a process of Table 9.
    """
    return _content().get(table, {}).get(scene, {}).get(quantity, [])
