"""Which law the body moves by, where nobody has said it: between the velocity and the first identification."""

from typing import Any

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.laws import PARTICLES, Competition
from pacnerf_lpo.identification.problem import COARSER, StateProblem
from pacnerf_lpo.identification.processes import check_jobs, processes
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.mpm.materials.auto import Auto
from pacnerf_lpo.phases.dynamic import DynamicPhase
from pacnerf_lpo.phases.work import Work
from pacnerf_lpo.types import ParticleState

SEARCHED, FITTED = 130, 40
"""Rollouts of a search of one law on a coarse body, and of its fit; about, as counted on a ball."""
NOISE, COARSE_NOISE = 130, 100
"""Rollouts that show what the best law may leave, a finer grid counted as what it costs, and those of a coarse body."""
HELD_SHARE = 3
"""One of so many training views is held out, and one of so many frames that remain after contact."""


class LawChoice(DynamicPhase):
    """Laws compete to explain the outlines of the training views, see :mod:`pacnerf_lpo.identification.laws`. A third
    of the views and the last frames are held out. A step is a search or a fit of one law.

    Args:
        particles: the body is sampled by about so many.
        jobs: simulations at the same time, each in a process of its own; None: as many as torch may use threads, at
            most 8, and one on a GPU.
    """

    long_steps = True

    def __init__(self, particles: int = PARTICLES, jobs: int | None = None):
        super().__init__(1)
        self.automatic_optimization = False
        if particles < 100:
            raise UserInputError(f"LawChoice: particles = {particles}; give at least 100")
        check_jobs(jobs, "LawChoice")
        self.particles, self.jobs = particles, jobs
        self.taken = nn.Parameter(torch.zeros(()))  # what a step of the optimiser counts

    def begin(self) -> None:
        """Prepare the comparison of the laws; their parameters start from guesses."""
        data = self.data
        problem = StateProblem(
            data.video.source, data, self.state, self.physics, held_back(data), bright=False, particles=self.particles
        )
        problem.usable[np.setdiff1d(np.arange(len(data.video.images)), data.train)] = False
        if not problem.fitted.any():
            raise UserInputError(
                f"{data.video.source}: no outline of a training view can be measured; they touch the border of the "
                "image in every frame. Laws are compared by outlines: give physics.material"
            )
        self.competition = Competition(problem)
        self.steps = self.competition.steps

    def work(self, particles: int) -> Work:
        """See :meth:`AbstractPhase.work`: half of the laws are left after their searches."""
        assert isinstance(self.physics.material, Auto)
        laws = len(self.physics.material.laws)
        fine = (self.particles / particles) ** (4 / 3)  # half the spacing is half the step
        coarse = fine / COARSER**4
        rollouts = (laws * SEARCHED + COARSE_NOISE) * coarse + (laws * FITTED / 2 + NOISE) * fine
        return Work(frames=rollouts * len(self.data.video.times))

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """One that changes nothing: the steps are those of the competition."""
        return torch.optim.SGD([self.taken], lr=0.0)

    def training_step(self, step: int, _: int) -> None:
        """A search or a fit of one law, the noise, or the verdict."""
        title = f"law: {self.competition.describe(step)}"
        with processes(self.jobs):
            self.competition.step(step, lambda items, count: tqdm(items, title, count, leave=False))
        optimiser: Any = self.optimizers()
        optimiser.step()

    def progress(self) -> dict[str, Any]:
        return self.competition.found()

    def take_up(self, progress: dict[str, Any]) -> None:
        self.competition.restore(progress)

    def export_state(self) -> ParticleState:
        """The imported state with the parameters of the chosen law; the velocity that images gave stays."""
        law = self.competition.chosen
        known = law.known or {}
        own = {name: known[name] for name in self.competition.problems[law.law].physics.material.parameters}
        return self.state.with_(physics={**self.state.physics, **own})

    def export_findings(self) -> dict[str, Any]:
        """The table of the laws, the one that is used, and what a person should know of the choice."""
        return self.competition.summary()

    def progress_metrics(self) -> dict[str, str]:
        best = self.competition.ranked[0]
        return {"best": best.family} if best.coarse is not None else {}


def held_back(data: VideoData) -> Split:
    """Every third training view, where at least two are left, and a third of the last frames, at most two, are held
    out; views that are no training views are not looked at.
    """
    views, frames = data.video.images.shape[:2]
    train = np.asarray(data.train)
    held = train[HELD_SHARE - 1 :: HELD_SHARE] if len(train) >= HELD_SHARE else train[:0]
    fitted = np.isin(np.arange(views), np.setdiff1d(train, held))
    return Split(fitted, np.arange(frames) < frames - min(2, frames // (2 * HELD_SHARE)))
