"""The error before and after a diagnosis in TensorBoard, by view and by frame."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.callbacks.tensorboard import PhaseLogger
from pacnerf_lpo.report.residual_colours import residual_colours

CELL = 14
"""Side of a cell of the view x frame picture [pixels]."""
GAP = 6


def log_diagnosis(run_dir: Path) -> None:
    """Log ``RUN/diagnosis/diagnosis.json`` under ``diagnosis/``: scalars by added effect and by view (at the number of
    added effects), by frame (at the frame's index), and the view x frame map of the excess error before and after.
    """
    result = json.loads((run_dir / "diagnosis" / "diagnosis.json").read_text())
    logger, unit = PhaseLogger(run_dir, "diagnosis", 0), result["unit"]
    for number, stage in enumerate(result["stages"]):
        whole = {f"error, {part} data [{unit}]": value for part, value in stage["error"].items()}
        views = {
            f"error by view/{view} [{unit}]": value
            for view, value in zip(result["views"], stage["by_view"], strict=True)
            if value is not None
        }
        logger.log_metrics(whole | views, number)
        for frame, value in enumerate(stage["by_frame"]):
            if value is not None:
                logger.log_metrics({f"error by frame/{number} {stage['readable']} [{unit}]": value}, frame)
    if result["views"]:
        logger.log_image("excess error, view by frame (above: before, below: after)", excess_picture(result), 0)
    logger.finalize("success")


def excess_picture(result: Mapping[str, Any]) -> Tensor:
    """Excess error of the first and of the last stage as shades of orange [0..1, (H, W, 3)], on a common scale."""
    shown = result["stages"][:1] if len(result["stages"]) == 1 else [result["stages"][0], result["stages"][-1]]
    roots = [
        torch.tensor([[max(value or 0.0, 0.0) ** 0.5 for value in row] for row in stage["excess"]]) for stage in shown
    ]
    most = max(float(root.max()) for root in roots) or 1.0
    gap = torch.zeros(GAP, roots[0].shape[1] * CELL)
    parts: list[Tensor] = []
    for root in roots:
        parts += [gap, root.repeat_interleave(CELL, 0).repeat_interleave(CELL, 1)]
    return residual_colours(-torch.cat(parts[1:]), most)
