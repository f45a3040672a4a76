"""What surrounds a phase: one checkpoint, replaced whole every so many seconds and when the run is asked to stop, and a
progress bar with the loss and the physical parameters; without a terminal, a line every 5 s.
"""

import io
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import Checkpoint, ProgressBar
from tqdm import tqdm

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.errors import Interrupted
from pacnerf_lpo.heartbeat import doing
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.phases.base import AbstractPhase


class PhaseCheckpoint(Checkpoint):
    """Writes the checkpoint of a phase every so many ``seconds`` and stops the phase when asked to.

    The state of torch's random generator goes with it, so that a phase goes on as if it had not been interrupted.
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

    def on_train_batch_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: Any) -> None:
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


class PhaseProgress(ProgressBar):
    """Shows how far a phase is, on standard error, by its title, such as ``round 1 of 4, physics``."""

    def __init__(self, title: str):
        super().__init__()
        self.title = title
        self._enabled = True
        self._bar: tqdm | None = None

    def disable(self) -> None:
        """Lightning's switch for processes other than the first."""
        self._enabled = False

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Open the bar where the phase stands: not at zero when it is resumed."""
        terminal = sys.stderr.isatty()
        self._interval = 0.2 if terminal else 5.0
        self._started = self._shown = time.monotonic()
        limits = [trainer.num_training_batches, *([trainer.max_steps] if trainer.max_steps >= 0 else [])]
        self._total = int(min(limits))
        self._first = trainer.fit_loop.epoch_loop.batch_progress.current.ready
        if self._enabled and terminal:
            self._bar = tqdm(total=self._total, initial=self._first, desc=self.title, dynamic_ncols=True)

    def on_train_batch_start(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Name the step, for a sign of life where it is long."""
        doing(f"at {self.title}, step {batch_idx + 1} of {self._total}")

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Advance by one optimiser step; describe it when the last description is old enough."""
        done = batch_idx + 1
        now = time.monotonic()
        if self._enabled and (now - self._shown >= self._interval or done == self._total):
            self._shown = now
            self._show(done, now, describe(trainer.callback_metrics, cast(AbstractPhase, pl_module)))

    def on_train_end(self, *_: Any) -> None:
        """Leave the bar where it is."""
        if self._bar is not None:
            self._bar.close()

    def on_exception(self, *_: Any) -> None:
        self.on_train_end()

    def _show(self, done: int, now: float, description: str) -> None:
        if self._bar is not None:
            self._bar.set_postfix_str(description, refresh=False)
            self._bar.update(done - self._bar.n)
            self._bar.refresh()
            return
        elapsed = now - self._started
        left = elapsed / max(done - self._first, 1) * (self._total - done)
        print(f"{self.title}: {done}/{self._total} [{elapsed:.0f} s, {left:.0f} s left] {description}", file=sys.stderr)


def describe(metrics: Mapping[str, torch.Tensor], phase: AbstractPhase) -> str:
    """``loss 0.0123, E 1.2e+05 Pa``: the loss a phase has logged and its current values."""
    losses = [f"loss {value:.4g}" for name, value in metrics.items() if name.rpartition("/")[2] == "loss"]
    return ", ".join([*losses[:1], *(f"{name} {value}" for name, value in phase.progress_metrics().items())])
