"""Algorithm 1 of the paper as a callback: it decides which phase comes next; the command line executes it."""

from __future__ import annotations

import io
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import pytorch_lightning as pl

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import Manifest, PhaseRecord, write_atomically
from pacnerf_lpo.phases.base import AbstractPhase
from pacnerf_lpo.types import ParticleState

Role = Literal["static", "velocity", "physics", "correction"]


@dataclass(frozen=True)
class PhaseStep:
    """One phase in the order of Algorithm 1; ``round`` is 0 before the first identification."""

    index: int
    round: int
    role: Role

    @property
    def stem(self) -> str:
        """Name of its files, such as ``00_static`` or ``02_r1_physics``."""
        return f"{self.index:02d}_{self.role}" if self.round == 0 else f"{self.index:02d}_r{self.round}_{self.role}"


def algorithm_1(rounds: int, correction: bool) -> list[PhaseStep]:
    """Static grids, velocity, then ``rounds`` times: physical identification and, unless switched off, correction.

    The last line of a round in the paper, colour prediction, needs no phase of its own here: the corrected particles
    themselves go into the next round, and the evaluation renders them.
    """
    roles: list[tuple[int, Role]] = [(0, "static"), (0, "velocity")]
    for number in range(1, rounds + 1):
        roles.append((number, "physics"))
        if correction:
            roles.append((number, "correction"))
    return [PhaseStep(index, number, role) for index, (number, role) in enumerate(roles)]


class OuterLoop(pl.Callback):
    """Hands the particle state from phase to phase, in memory and on disk, and keeps the run manifest.

    Args:
        run_dir: folder of the run; must be empty or absent when a run starts.
        rounds: R of Algorithm 1, repetitions of identification and correction.
        physics_start: ``warm``: each identification starts from the parameters of the last one; ``restart``: from the
            initial guess.
        checkpoint_seconds: time between two checkpoints of a running phase [s].
    """

    def __init__(
        self,
        run_dir: str = "runs/fit",
        rounds: int = 4,
        physics_start: Literal["warm", "restart"] = "warm",
        checkpoint_seconds: float = 60.0,
    ):
        if rounds < 0:
            raise UserInputError(f"outer_loop.rounds = {rounds}: give 0 or more")
        self.run_dir = Path(run_dir)
        self.rounds, self.physics_start, self.checkpoint_seconds = rounds, physics_start, checkpoint_seconds
        self.state: ParticleState | None = None

    def start(self, correction: bool) -> None:
        """Begin a run: make its directory and its manifest."""
        if self.run_dir.exists() and (not self.run_dir.is_dir() or any(self.run_dir.iterdir())):
            raise UserInputError(
                f"{self.run_dir} exists and is not empty; go on with `pacnerf-lpo fit --resume {self.run_dir}` "
                "or choose another folder with --outer_loop.run_dir"
            )
        self.steps = algorithm_1(self.rounds, correction)
        self.manifest = Manifest(self.run_dir)
        self.manifest.save()

    def resume(self, correction: bool) -> None:
        """Go on with an earlier run: after its last finished phase."""
        self.steps = algorithm_1(self.rounds, correction)
        self.manifest = Manifest.load(self.run_dir)
        done = self._done()
        if done:
            self.state = ParticleState.load(self.run_dir / done[-1].state)

    def next_phase(self) -> PhaseStep | None:
        """The phase to run now; ``None`` after the last one."""
        done = len(self._done())
        return self.steps[done] if done < len(self.steps) else None

    def first_step(self) -> int:
        """Optimiser steps of all finished phases: where the next one begins on the time line."""
        return sum(record.steps for record in self._done())

    def checkpoint(self, step: PhaseStep) -> Path:
        """Where the phase keeps its last checkpoint."""
        return self.run_dir / "checkpoints" / step.stem / "last.ckpt"

    def begin(self, step: PhaseStep) -> None:
        """Record in the manifest that a phase starts or goes on."""
        records = self.manifest.phases
        if len(records) == step.index:
            checkpoint = self.checkpoint(step).relative_to(self.run_dir)
            state = f"states/{step.stem}.pt"
            records.append(PhaseRecord(step.index, step.round, step.role, "running", str(checkpoint), state))
        records[step.index].status, records[step.index].error = "running", None
        self._started = time.monotonic()
        self.close("running")

    def abandon(self, status: Literal["interrupted", "failed"], error: str | None = None) -> None:
        """Record that the run stopped, and in which phase if in one."""
        for record in self.manifest.phases:
            if record.status == "running":
                record.status, record.error = status, error
                record.seconds += time.monotonic() - self._started
        self.close(status)

    def close(self, status: str) -> None:
        """Set the status of the whole run."""
        self.manifest.status = status
        self.manifest.save()

    def setup(self, trainer: pl.Trainer, pl_module: pl.LightningModule, stage: str) -> None:
        """Hand the particle state over. Here, and not later, because a checkpoint may be loaded into it afterwards."""
        state = self.state
        if state is not None and self._current(trainer).phase == "physics" and self.physics_start == "restart":
            state = state.with_(physics={})
        cast(AbstractPhase, pl_module).import_state(state)

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Take the particle state back and record the phase as done."""
        self.state = cast(AbstractPhase, pl_module).export_state()
        record = self._current(trainer)
        content = io.BytesIO()
        self.state.save(content)
        write_atomically(self.run_dir / record.state, content.getvalue())
        record.status, record.steps = "done", trainer.global_step
        record.seconds += time.monotonic() - self._started
        self.manifest.save()

    def _current(self, trainer: pl.Trainer) -> PhaseRecord:
        return self.manifest.phases[len(self._done())]

    def _done(self) -> list[PhaseRecord]:
        return [record for record in self.manifest.phases if record.status == "done"]
