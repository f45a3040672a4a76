"""Pictures and chart layout for TensorBoard."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from torch import Tensor

from pacnerf_lpo.report.residual_colours import comparison_panel

if TYPE_CHECKING:
    from pacnerf_lpo.callbacks.tensorboard import PhaseLogger

TITLE = "rendered | measured | residual (orange: model darker, blue: brighter)"


def log_comparison(logger: PhaseLogger, tag: str, predicted: Tensor, measured: Tensor, step: int) -> None:
    """Log one picture: rendered, measured and signed residual side by side.

    Args:
        logger: logger of the running phase; it puts the phase's name before the tag.
        tag: which image it is, such as ``view 3, frame 7``.
        predicted, measured: [0..1, (H, W, 3)]
        step: optimiser step within the phase.

    Example:
        >>> log_comparison(phase.logger, "view 0, frame 0", image, video.images[0, 0], phase.global_step)
    """
    panel = comparison_panel(predicted.detach().cpu(), measured.detach().cpu())
    logger.log_image(f"{tag}: {TITLE}", panel, step)


def scalar_layout(results: Mapping[str, Any]) -> dict[str, Any]:
    """The page "custom scalars": a chart for each physical parameter, the initial velocity, and the image metrics.

    Args:
        results: what ``evaluate_run`` returned.

    Returns:
        What ``SummaryWriter.add_custom_scalars`` takes: chapter, chart, and patterns of the tags in it.
    """
    last = results["phases"][-1]["parameters"]
    parameters = {}
    for name in results["free"]:
        unit = last[name]["unit"]
        tag = f"{name} [{unit.replace('/', '|')}]"
        parameters[f"{last[name]['label']} {name} [{unit}]"] = ["Multiline", [f"physics/{re.escape(tag)}"]]
    parameters["initial velocity [m/s]"] = ["Multiline", [r"(velocity|physics)/v_[xyz].*"]]
    quality = {
        f"{metric}, {views} views": ["Multiline", [rf".*/{metric} \({views} views\)"]]
        for views in ("test", "train")
        for metric in ("psnr", "ssim")
    }
    return {"physical parameters": parameters, "image quality after each phase": quality}
