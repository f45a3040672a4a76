"""The TensorBoard events of a run: where they are, and how what is known after the phases is added to them."""

from collections.abc import Mapping
from pathlib import Path

from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

FOLDER = "tensorboard"


def tagged(phase: str, name: str) -> str:
    """The tag of what a phase logs under a name: ``physics/loss``."""
    return name if name.startswith(f"{phase}/") else f"{phase}/{name}"


class PhaseEvents(SummaryWriter):
    """Adds to the events of a phase, or of the diagnosis, of a finished run; use it in ``with``. The steps of a phase
    are counted from ``first_step``, the optimiser steps of all phases before it.
    """

    def __init__(self, run_dir: Path, phase: str, first_step: int = 0):
        super().__init__(str(run_dir / FOLDER))
        self.phase, self.first_step = phase, first_step

    def add_metrics(self, metrics: Mapping[str, float], step: int) -> None:
        """Add scalars at a step of the phase."""
        for name, value in metrics.items():
            self.add_scalar(tagged(self.phase, name), value, self.first_step + step)

    def add_picture(self, name: str, image: Tensor, step: int) -> None:
        """Add an image [0..1, (H, W, 3)] at a step of the phase."""
        self.add_image(tagged(self.phase, name), image, self.first_step + step, dataformats="HWC")
