"""One TensorBoard run per fit: tags carry the phase, and steps go on from phase to phase."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from pytorch_lightning.loggers import TensorBoardLogger
from torch import Tensor

if TYPE_CHECKING:
    from pacnerf_lpo.evaluation.run_directory import Run, Stage

FOLDER = "tensorboard"


class PhaseLogger(TensorBoardLogger):
    """The logger of one phase of a run.

    Args:
        run_dir: events go to its folder ``tensorboard``.
        phase: put before every tag that does not begin with it: ``physics/loss``.
        first_step: optimiser steps of all phases before this one.
    """

    def __init__(self, run_dir: Path, phase: str, first_step: int):
        super().__init__(str(run_dir), name=FOLDER, version="")
        self.phase, self.first_step = phase, first_step

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Log scalars at a step of the phase."""
        tagged = {self._tag(name): value for name, value in metrics.items() if name != "epoch"}
        super().log_metrics(tagged, self.first_step + (step or 0))

    def log_image(self, name: str, image: Tensor, step: int) -> None:
        """Log an image [0..1, (H, W, 3)] at a step of the phase."""
        self.experiment.add_image(self._tag(name), image, self.first_step + step, dataformats="HWC")

    def _tag(self, name: str) -> str:
        return name if name.startswith(f"{self.phase}/") else f"{self.phase}/{name}"


def log_evaluation(run: Run, results: Mapping[str, Any]) -> None:
    """Show what an evaluation measured: image metrics and rendered-vs-measured images at the last step of each phase.

    Args:
        run: the run.
        results: what ``evaluate_run`` returned.
    """
    from pacnerf_lpo.report.tensorboard_images import scalar_layout

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
    from pacnerf_lpo.evaluation.prediction import predict
    from pacnerf_lpo.report.tensorboard_images import log_comparison

    video, images = run.data.video, predict(run, stage).images
    frames = sorted({0, images.shape[1] // 2, images.shape[1] - 1})
    for view in [*run.data.train[:1], *run.data.test[:1]]:
        for frame in frames:
            predicted = torch.from_numpy(images[view, frame].copy()).float() / 255
            tag = f"view {video.view_ids[view]}, frame {video.frame_ids[frame]}"
            log_comparison(logger, tag, predicted, video.images[view, frame], stage.record.steps)
