"""What every phase of Algorithm 1 is: a LightningModule that takes a particle state and gives one back."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import pytorch_lightning as pl
import torch

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases.work import Work
from pacnerf_lpo.types import ParticleState


class AbstractPhase(pl.LightningModule, ABC):
    """One phase: its losses, its optimiser and its schedules.

    The outer loop calls, in this order: :meth:`attach`, :meth:`import_state`, ``Trainer.fit``, :meth:`export_state`.
    """

    data: VideoData
    physics: Physics
    steps: int  # of the optimiser
    held_out: frozenset[tuple[int, int]] = frozenset()  # view and frame of images it must not learn from
    long_steps: bool = False  # whether a checkpoint follows each step, and none is waited for when the run is to stop
    searches: bool = True  # whether an identification looks at the whole parameter space first
    within: Mapping[str, Sequence[float]] = {}  # between which two values [SI] an identification leaves a parameter

    def attach(self, data: VideoData, physics: Physics) -> None:
        """Give the phase the video and the physical model of the run; called once, before :meth:`import_state`."""
        self.data, self.physics = data, physics
        self.check()

    def check(self) -> None:
        """Raise UserInputError where video, physical model and settings do not agree, before long work."""
        return

    @abstractmethod
    def import_state(self, state: ParticleState | None) -> None:
        """Take what the previous phase exported; ``None`` for the first phase of a run."""

    @abstractmethod
    def export_state(self) -> ParticleState:
        """The particle state after training, detached, on the CPU."""

    def export_findings(self) -> dict[str, Any] | None:
        """What it found in addition to the state, as JSON; None: nothing."""
        return None

    def batches(self, data: VideoData) -> Iterable:
        """One element per optimiser step; ``training_step`` receives it: unless a phase says otherwise, its number."""
        return StepNumbers(self.steps, lambda: self.global_step)

    def work(self, particles: int) -> Work:
        """How much it will compute for a body of so many particles, about; called after :meth:`attach`."""
        return Work()

    def progress_metrics(self) -> dict[str, str]:
        """Current values for the progress bar, formatted with their SI units."""
        return {}

    def course(self) -> dict[str, Any]:
        """How the phase went, for the manifest: what JSON can hold, and doubts are read off."""
        return {}


class StepNumbers(torch.utils.data.IterableDataset):
    """The numbers of the optimiser steps that remain of ``count``, for phases that draw their own samples by step
    number; ``done`` says, when iteration starts, how many were taken before (a resumed run).
    """

    def __init__(self, count: int, done: Callable[[], int]):
        self.count, self.done = count, done

    def __len__(self) -> int:
        return self.count

    def __iter__(self):
        return iter(range(self.done(), self.count))


def psnr(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio [dB] of colours in 0..1."""
    return -10 * math.log10(max(mean_squared_error, 1e-12))
