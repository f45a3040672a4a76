"""One TensorBoard run per fit: tags carry the phase, and steps go on from phase to phase."""

from collections.abc import Mapping
from pathlib import Path

from pytorch_lightning.loggers import TensorBoardLogger

from pacnerf_lpo.events import FOLDER, tagged


class PhaseLogger(TensorBoardLogger):
    """Logs a phase into the folder ``tensorboard`` of a run, behind the optimiser steps of all phases before it."""

    def __init__(self, run_dir: Path, phase: str, first_step: int):
        super().__init__(str(run_dir), name=FOLDER, version="")
        self.phase, self.first_step = phase, first_step

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Log scalars at a step of the phase."""
        named = {tagged(self.phase, name): value for name, value in metrics.items() if name != "epoch"}
        super().log_metrics(named, self.first_step + (step or 0))
