"""Algorithm 1 of the paper as a callback: it decides which phase comes next; the command line executes it."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import pytorch_lightning as pl

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import Manifest, PhaseRecord, write_atomically
from pacnerf_lpo.phases.base import AbstractPhase
from pacnerf_lpo.phases.held_out import held_out_error, held_out_images
from pacnerf_lpo.types import ParticleState

Role = Literal["static", "velocity", "law", "physics", "correction", "refit"]


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

    @property
    def template(self) -> str:
        """Section of ``phases`` that configures it: grids are fitted again as they were first."""
        return "static" if self.role == "refit" else self.role


def algorithm_1(rounds: int, correction: bool, refit: bool = False, law: bool = False) -> list[PhaseStep]:
    """Static grids, velocity, then ``rounds`` times: physical identification and, unless switched off, correction.

    The last line of a round in the paper, colour prediction, needs no phase of its own where the corrected particles
    themselves go into the next round; with ``refit`` their images go into another fit of the grids before it. With
    ``law``, laws compete before the first identification.
    """
    roles: list[tuple[int, Role]] = [(0, "static"), (0, "velocity")]
    if law:
        roles.append((0, "law"))
    for number in range(1, rounds + 1):
        roles.append((number, "physics"))
        if correction:
            roles.append((number, "correction"))
        if refit and number < rounds:
            roles.append((number, "refit"))
    return [PhaseStep(index, number, role) for index, (number, role) in enumerate(roles)]


class OuterLoop(pl.Callback):
    """Hands the particle state from phase to phase, in memory and on disk, and keeps the run manifest.

    Args:
        run_dir: folder of the run; must be empty or absent when a run starts.
        rounds: R of Algorithm 1, repetitions of identification and correction.
        physics_start: ``warm``: each identification goes on from the parameters of the last one, without another
            search, and inside the intervals of the weighted fit, if there was one; ``restart``: from the initial guess.
        carry: what goes into the next round. ``particles``: the corrected ones; ``refit_grid``: the static phase runs
            again, with the frame-0 images of the corrected particles in the training views as targets in addition to
            the measured ones, and particles are sampled from its grid.
        stop_when: ``never``: all rounds are run; ``held_out``: some training images are held out of the corrections,
            and the rounds end when the error in them stops falling. The round before that is the one chosen.
        run_all_rounds: with ``held_out``, choose a round but run the others too, to show what they give.
        compare_methods: after the identification, ask on a coarse body whether images and outlines agree on its answer
            (see :mod:`pacnerf_lpo.phases.method_comparison`); half a minute.
        reuse: a run whose reconstruction is taken over, and its velocity where that is still right, if they were made
            from the same video with the same settings (see :mod:`pacnerf_lpo.reuse`).
        checkpoint_seconds: time between two checkpoints of a running phase [s].
    """

    def __init__(
        self,
        run_dir: str = "runs/fit",
        rounds: int = 4,
        physics_start: Literal["warm", "restart"] = "warm",
        carry: Literal["particles", "refit_grid"] = "particles",
        stop_when: Literal["never", "held_out"] = "never",
        run_all_rounds: bool = False,
        compare_methods: bool = True,
        reuse: str | None = None,
        checkpoint_seconds: float = 60.0,
    ):
        if rounds < 0:
            raise UserInputError(f"outer_loop.rounds = {rounds}: give 0 or more")
        self.run_dir = Path(run_dir)
        self.rounds, self.physics_start, self.checkpoint_seconds = rounds, physics_start, checkpoint_seconds
        self.carry, self.stop_when, self.run_all_rounds = carry, stop_when, run_all_rounds
        self.compare_methods, self.reuse = compare_methods, reuse
        self.state: ParticleState | None = None

    def check(self, data: VideoData, correction: bool) -> None:
        """Raise UserInputError when images are to be held out and that is not possible."""
        if self.stop_when == "held_out" and not correction:
            raise UserInputError(
                "outer_loop.stop_when = held_out keeps images back from the correction, but phases.correction is null; "
                "set outer_loop.stop_when to never, or add a correction"
            )
        if self.stop_when == "held_out" and len(data.train) < 2:
            raise UserInputError(
                "outer_loop.stop_when = held_out keeps images of one view back where another one is left, but "
                "data.train_views has one view only; add a view, or set outer_loop.stop_when to never"
            )

    def start(self, correction: bool, video: str, law: bool = False) -> None:
        """Begin a run on a video with this fingerprint: make its directory and manifest. With ``law``, laws compete."""
        if self.run_dir.exists() and (not self.run_dir.is_dir() or any(self.run_dir.iterdir())):
            raise UserInputError(
                f"{self.run_dir} exists and is not empty; go on with `pacnerf-lpo fit --resume {self.run_dir}` "
                "or choose another folder with --outer_loop.run_dir"
            )
        self.steps = algorithm_1(self.rounds, correction, self.carry == "refit_grid", law)
        self.manifest = Manifest(self.run_dir, video=video)
        self.manifest.save()

    def resume(self, correction: bool, law: bool = False) -> None:
        """Go on with an earlier run: after its last finished phase. With ``law``, laws compete, or they did before."""
        self.reread()
        law = law or any(record.phase == "law" for record in self.manifest.phases)
        self.steps = algorithm_1(self.rounds, correction, self.carry == "refit_grid", law)

    def reread(self) -> None:
        """Take manifest and state from disk, where the last finished phase, or who looked back at it, left them."""
        self.manifest = Manifest.load(self.run_dir)
        if self.last_done is not None:
            self.state = ParticleState.load(self.run_dir / self.last_done.state)

    @property
    def last_done(self) -> PhaseRecord | None:
        """Record of the last finished phase."""
        return self.manifest.done[-1] if self.manifest.done else None

    def next_phase(self) -> PhaseStep | None:
        """The phase to run now; ``None`` after the last one, and when another round would not help."""
        done = len(self.manifest.done)
        chosen = self.manifest.chosen_round
        if chosen is not None and chosen < len(self.manifest.held_out_errors) and not self.run_all_rounds:
            return None
        return self.steps[done] if done < len(self.steps) else None

    def remaining(self) -> list[PhaseStep]:
        """The phases that are not done yet, as far as is known now."""
        return self.steps[len(self.manifest.done) :] if self.next_phase() is not None else []

    def searches(self, step: PhaseStep) -> bool:
        """Whether an identification looks at the whole parameter space: the first one does, unless laws have competed,
        for the space of each of them was searched then; those that restart all do.
        """
        competed = any(other.role == "law" for other in self.steps)
        return self.physics_start == "restart" or (step.round <= 1 and not competed)

    def findings(self, role: Role) -> dict[str, Any] | None:
        """What the last finished phase of this kind found in addition to its state; None: there is none."""
        found = [self.run_dir / record.findings for record in self.manifest.done if record.phase == role]
        return json.loads(found[-1].read_text()) if found and found[-1].is_file() else None

    def checkpoint(self, step: PhaseStep) -> Path:
        """Where a phase that has begun keeps its last checkpoint."""
        return self.run_dir / self.manifest.phases[step.index].checkpoint

    def begin(self, step: PhaseStep) -> None:
        """Record in the manifest that a phase starts or goes on."""
        records = self.manifest.phases
        if len(records) == step.index:
            checkpoint, state = f"checkpoints/{step.stem}/last.ckpt", f"states/{step.stem}.pt"
            records.append(PhaseRecord(step.index, step.round, step.role, "running", checkpoint, state))
        record = records[step.index]
        record.status, record.error = "running", None
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
        state, phase, record = self.state, cast(AbstractPhase, pl_module), self._current()
        role = record.phase
        if state is not None and role == "physics" and self.physics_start == "restart":
            state = state.with_(physics={})
        phase.searches = self.searches(self.steps[record.index])
        if not phase.searches:
            phase.within = self.manifest.intervals
        if role == "correction" and self.stop_when == "held_out":
            phase.held_out = held_out_images(phase.data)
        phase.import_state(state)

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Take the particle state back and record the phase as done."""
        phase = cast(AbstractPhase, pl_module)
        self.state = phase.export_state()
        record = self._current()
        if phase.held_out:
            record.held_out_error = held_out_error(phase.data, phase.physics, self.state, phase.held_out)
        write_atomically(self.run_dir / record.state, self.state.as_bytes())
        if (findings := phase.export_findings()) is not None:
            write_atomically(self.run_dir / record.findings, json.dumps(findings, indent=1).encode())
        record.status, record.steps, record.course = "done", trainer.global_step, phase.course()
        record.seconds += time.monotonic() - self._started
        self.manifest.save()

    def _current(self) -> PhaseRecord:
        return self.manifest.phases[len(self.manifest.done)]
