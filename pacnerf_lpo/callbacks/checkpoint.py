"""One checkpoint per phase, replaced whole every so many seconds and when the run is asked to stop."""

import io
import time
from pathlib import Path
from typing import Any, cast

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Checkpoint

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.errors import Interrupted
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.phases.base import AbstractPhase


class PhaseCheckpoint(Checkpoint):
    """Writes the checkpoint of a phase and stops the phase when asked to.

    The state of torch's random generator goes with it, so that a phase goes on as if it had not been interrupted.

    Args:
        path: the checkpoint file.
        seconds: time between two writes [s].
        stop: where the wish to stop arrives.
    """

    def __init__(self, path: Path, seconds: float, stop: StopRequest):
        self.path, self.seconds, self.stop = path, seconds, stop
        self._restored_generator: torch.Tensor | None = None

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Begin to count and to listen, and put the random generator where the checkpoint left it."""
        self._written = time.monotonic()
        self.stop.listen()
        self.stop.deferred = not cast(AbstractPhase, pl_module).long_steps
        if self._restored_generator is not None:
            torch.set_rng_state(self._restored_generator)

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write when due or when the run is asked to stop; then stop it."""
        due = cast(AbstractPhase, pl_module).long_steps or time.monotonic() - self._written >= self.seconds
        if self.stop.requested or due:
            self._write(trainer)
        if self.stop.requested:
            raise Interrupted

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Write the finished phase."""
        self._write(trainer)
        self.stop.deferred = False

    def state_dict(self) -> dict[str, Any]:
        """State of torch's CPU generator."""
        return {"generator": torch.get_rng_state()}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Keep the generator's state until training starts."""
        self._restored_generator = state_dict["generator"]

    def _write(self, trainer: pl.Trainer) -> None:
        content = io.BytesIO()
        torch.save(trainer._checkpoint_connector.dump_checkpoint(), content)
        write_atomically(self.path, content.getvalue())
        self._written = time.monotonic()
