"""Pictures and chart layout for TensorBoard."""

from __future__ import annotations

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


def parameter_layout(tags: Mapping[str, list[str]]) -> dict[str, Any]:
    """Custom-scalars layout that shows one chart per physical parameter over all phases.

    Args:
        tags: for each parameter the scalar tags it is logged under, such as ``{"E [Pa]": ["physics/E [Pa]"]}``.

    Returns:
        What ``SummaryWriter.add_custom_scalars`` takes.
    """
    return {"physical parameters": {name: ["Multiline", found] for name, found in tags.items()}}
