"""The command ``fit`` with phases of a few scalar steps in place of the real ones, to test the loop around them."""

from __future__ import annotations

import time
from pathlib import Path

import pytorch_lightning as pl
import torch
from torch.utils.data import DataLoader

from pacnerf_lpo import __main__, cli
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.phases.base import AbstractPhase, StepNumbers
from pacnerf_lpo.types import ParticleState


class FakeMaterial:
    def __init__(self, E: float = 1e5, nu: float = 0.3):
        if E < 0:
            raise UserInputError(f"physics.material: E = {E:g} Pa is not a possible Young's modulus")
        self.E, self.nu = E, nu


class FakePhysics:
    decided = True

    def __init__(self, material: FakeMaterial, rho: float = 1000.0):
        self.material = material
        self.guess = {"E": material.E, "nu": material.nu}

    def known(self, values: dict[str, float]) -> dict[str, float]:
        return values


class FakeData(pl.LightningDataModule):
    def __init__(self, root: str):
        super().__init__()
        self.root = root

    @property
    def fingerprint(self) -> str:
        return self.root

    def prepare(self) -> None:
        if self.root == "missing":
            raise UserInputError("missing: no such folder")

    def train_dataloader(self) -> DataLoader:
        return DataLoader(self.trainer.lightning_module.batches(self), batch_size=None)


class FakePhase(AbstractPhase):
    """Pulls one value towards random targets; what it ends at depends on every step and on the random generator."""

    def __init__(self, steps: int = 6, seconds: float = 0.0, unstable: bool = False):
        super().__init__()
        self.steps, self.seconds, self.unstable = steps, seconds, unstable
        self.value = torch.nn.Parameter(torch.zeros(1))

    def import_state(self, state: ParticleState | None) -> None:
        self.incoming = state
        with torch.no_grad():
            self.value.fill_(float(state.positions[0, 0]) if state else 0.0)

    def export_state(self) -> ParticleState:
        physics = {**(self.incoming.physics if self.incoming else {}), "E": 1e5 + self.value.item()}
        return ParticleState(
            positions=self.value.detach().repeat(1, 3),
            velocity=torch.zeros(1, 3),
            density=torch.zeros(1),
            features=torch.zeros(1, 12),
            physics=physics,
            spacing=0.1,
            base_spacing=0.1,
        )

    def batches(self, data) -> StepNumbers:
        return StepNumbers(self.steps, lambda: self.global_step)

    def training_step(self, batch: int) -> torch.Tensor:
        if self.unstable and batch == 2:
            raise SimulationError(4, 17, "|v| dt > dx (v = 310 m/s)")
        time.sleep(self.seconds)
        loss = ((self.value - torch.rand(1)) ** 2).sum()
        self.log("loss", loss)
        return loss

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.parameters(), lr=0.1)

    def progress_metrics(self) -> dict[str, str]:
        return {"E": f"{1e5 + self.value.item():.3g} Pa"}


def arguments(run_dir, **phases: str) -> list[str]:
    """A complete command line; ``phases`` gives options of single phases, as ``velocity="seconds=0.1"``."""
    words = ["--data.root=x", "--physics.material=FakeMaterial", f"--outer_loop.run_dir={run_dir}"]
    words += [f"--phases.{role}=FakePhase" for role in ("static", "velocity", "physics", "correction")]
    words += [f"--phases.{role}.{option}" for role, options in phases.items() for option in options.split(",")]
    return [*words, "--trainer.accelerator=cpu", "--outer_loop.rounds=1", "--trainer.log_every_n_steps=1"]


def look_back(*_: object) -> None:
    """The fake phases have no video to doubt or to fit again."""


def finish(run_dir: Path, truth: str | None) -> None:
    """The fake particles cannot be rendered."""


def main(words: list[str]) -> int:
    """``pacnerf-lpo fit`` with the fake classes."""
    return __main__.guarded(lambda: cli.fit(words, FakeData, FakePhysics, look_back, finish))
