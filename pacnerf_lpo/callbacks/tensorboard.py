"""One TensorBoard run per fit: tags carry the phase, and steps go on from phase to phase."""

from collections.abc import Mapping
from pathlib import Path

from pytorch_lightning.loggers import TensorBoardLogger
from torch import Tensor

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
