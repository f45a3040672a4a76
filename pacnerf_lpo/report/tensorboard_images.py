"""Pictures and chart layout for TensorBoard."""

import re
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.callbacks.tensorboard import PhaseLogger
from pacnerf_lpo.evaluation.prediction import predict
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.report.residual_colours import comparison_panel

TITLE = "rendered | measured | residual (orange: model darker, blue: brighter)"


def log_evaluation(run: Run, results: Mapping[str, Any]) -> None:
    """Show what ``evaluate_run`` returned: image metrics and rendered-vs-measured images at the last step of each
    phase.
    """
    step = 0
    for stage, result in zip(run.stages, results["phases"], strict=True):
        logger = PhaseLogger(run.run_dir, stage.record.phase, step)
        step += stage.record.steps
        for views, metrics in (result.get("image_metrics") or {}).items():
            numbers = {f"{name} ({views} views)": value for name, value in (metrics or {}).items()}
            logger.log_metrics({k: v for k, v in numbers.items() if isinstance(v, float)}, stage.record.steps)
        if "images" in result:
            _log_comparisons(logger, run, stage)
        if stage is run.last:
            logger.experiment.add_custom_scalars(scalar_layout(results))
        logger.finalize("success")


def _log_comparisons(logger: PhaseLogger, run: Run, stage: Stage) -> None:
    """First, middle and last frame of the first training and the first test view."""
    video, images = run.data.video, predict(run, stage).images
    frames = sorted({0, images.shape[1] // 2, images.shape[1] - 1})
    for view in [*run.data.train[:1], *run.data.test[:1]]:
        for frame in frames:
            predicted = torch.from_numpy(images[view, frame].copy()).float() / 255
            tag = f"view {video.view_ids[view]}, frame {video.frame_ids[frame]}"
            log_comparison(logger, tag, predicted, video.images[view, frame], stage.record.steps)


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
    """The page "custom scalars": a chart for each physical parameter, the initial velocity, and the image metrics, as
    ``SummaryWriter.add_custom_scalars`` takes it: chapter, chart, and patterns of the tags in it.
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
