"""A progress bar per phase, with the loss and the physical parameters; without a terminal, a line every 5 s."""

import sys
import time
from collections.abc import Mapping
from typing import Any, cast

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import ProgressBar
from tqdm import tqdm

from pacnerf_lpo.heartbeat import doing
from pacnerf_lpo.phases.base import AbstractPhase


class PhaseProgress(ProgressBar):
    """Shows how far a phase is, on standard error.

    Args:
        title: name of the phase, such as ``round 1 of 4, physics``.
    """

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

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Leave the finished bar on the screen."""
        self._close()

    def on_exception(self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException) -> None:
        """Leave the bar where it stopped."""
        self._close()

    def _show(self, done: int, now: float, description: str) -> None:
        if self._bar is not None:
            self._bar.set_postfix_str(description, refresh=False)
            self._bar.update(done - self._bar.n)
            self._bar.refresh()
            return
        elapsed = now - self._started
        left = elapsed / max(done - self._first, 1) * (self._total - done)
        print(f"{self.title}: {done}/{self._total} [{elapsed:.0f} s, {left:.0f} s left] {description}", file=sys.stderr)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def describe(metrics: Mapping[str, torch.Tensor], phase: AbstractPhase) -> str:
    """``loss 0.0123, E 1.2e+05 Pa``: the loss a phase has logged and its current values."""
    losses = [f"loss {value:.4g}" for name, value in metrics.items() if name.rpartition("/")[2] == "loss"]
    return ", ".join([*losses[:1], *(f"{name} {value}" for name, value in phase.progress_metrics().items())])
