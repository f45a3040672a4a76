"""Identification by outlines alone: so cheap that the whole parameter space is searched before the first step."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from copy import copy
from typing import TYPE_CHECKING

import numpy as np
import torch
from tqdm import tqdm

from pacnerf_lpo.diagnosis.fitting import fit, sensitivities
from pacnerf_lpo.diagnosis.model import VELOCITY, Model
from pacnerf_lpo.diagnosis.problem import StateProblem
from pacnerf_lpo.diagnosis.processes import check_jobs, processes
from pacnerf_lpo.diagnosis.search import lowest, points, promising, span
from pacnerf_lpo.diagnosis.split import Split
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.optimisation.levenberg_marquardt import NormalEquations
from pacnerf_lpo.phases.identification_methods import GaussNewton, IdentificationMethod, finite_loss

if TYPE_CHECKING:
    from pacnerf_lpo.phases.physics_id import PhysicsIDModule
    from pacnerf_lpo.types import ParticleState

FALL_ITERATIONS = 4
SUNK = 1.0
"""The ground is put out of the way where the fall is fitted [m]: a coarse grid feels it a cell or two too early."""


class OutlineGaussNewton(GaussNewton):
    """Levenberg-Marquardt on ten numbers for each outline (centroid, area, widths, edges; see
    :mod:`pacnerf_lpo.diagnosis.summaries`), relative to frame 0, instead of on pixels.

    No image is rendered: particles are splatted, a misfit costs little more than a rollout. So first a low-discrepancy
    sample of the parameter space is tried on a coarse body, then the best few are improved there, and the best of those
    is fitted at full resolution. Shading, which pulls colours towards a wrong motion, does not enter.

    A body's plastic flow converges slowly with its resolution, its sensitivities do not need to: the residual is that
    of a fine body, the Jacobian that of a coarser one (space mapping with an additive correction, Bandler et al. 2004).
    A corrected body is compared pixel by pixel, moved by its own particles: the correction has made those agree with
    the images, and neither its outlines by splats nor another sampling of it do.

    Args:
        iterations: at most, at full resolution.
        samples: points of the search, with the initial guess one more; a power of two is best. 0: no search.
        scan_decades: log10 parameters are searched so many decades to either side of the guess.
        starts: how many of the best points are improved.
        particles, probe_particles, scan_particles: number of particles of the body for the residual, for its
            sensitivities and in the search.
        jobs: simulations at the same time, each in a process of its own; None: as many as torch may use threads, at
            most 8, and one on a GPU.
    """

    def __init__(
        self,
        iterations: int = 12,
        samples: int = 128,
        scan_decades: float = 3.0,
        starts: int = 3,
        particles: int = 14000,
        probe_particles: int = 4000,
        scan_particles: int = 1500,
        jobs: int | None = None,
    ):
        super().__init__(0, iterations, scan_decades, pool=1)
        bodies = (particles, probe_particles, scan_particles)
        if samples < 0 or starts < 1 or min(bodies) < 100:
            raise UserInputError(
                f"OutlineGaussNewton: samples = {samples}, starts = {starts}, particles = {particles}, "
                f"probe_particles = {probe_particles}, scan_particles = {scan_particles}; give at least 0, 1, and 100 "
                "particles"
            )
        check_jobs(jobs, "OutlineGaussNewton")
        self.samples, self.starts, self.jobs = samples, starts, jobs
        self.particles, self.probe_particles, self.scan_particles = bodies
        self._misfits: tuple[Misfit, Misfit] | None = None
        self._correction: np.ndarray | float = 0.0

    def suited_to(self, state: ParticleState) -> IdentificationMethod:
        """Pixel by pixel for a corrected state."""
        return GaussNewton(0, self.main_iterations, self.scan_decades, pool=1) if state.corrected else self

    def prepare(self, module: PhysicsIDModule) -> None:
        """Fit the velocity before contact, then search the parameter space; both on a coarse body."""
        if self.samples > 0:
            with processes(self.jobs):
                self._fit_fall(module)
                self._search(module)

    def _search(self, module: PhysicsIDModule) -> None:
        coarse = Misfit(module, self.scan_particles)
        spans = {parameter.name: self._span(module, parameter) for parameter in coarse.model.unknowns}
        wide = {name: ends for name, ends in spans.items() if ends}
        tried = points(coarse.model, wide, self.samples)
        found = promising(coarse.model, coarse.residual, tried, wide, self.starts, _bar)
        if found:
            fine, _ = self._fine_and_probe(module)
            self._set(module, fine.model, lowest(fine.model, fine.residual, found))

    def _fit_fall(self, module: PhysicsIDModule) -> None:
        """The velocity by the frames before contact; colours, which the velocity phase fits, pull it down by percents,
        and with it the search into another valley.
        """
        early = Misfit(module, self.scan_particles, frames=module.hit_frame, sunk=SUNK)
        model = early.model
        moving = np.isin(model.names, [parameter.name for parameter in VELOCITY])
        low, high = (np.where(moving, bound, model.start) for bound in model.bounds)
        with suppress(SimulationError):
            found = model.physical(fit(early.residual, model.start, model.scales, (low, high), FALL_ITERATIONS).free)
            with torch.no_grad():
                module.velocity.copy_(torch.tensor([found[parameter.name] for parameter in VELOCITY]))

    def _span(self, module: PhysicsIDModule, parameter: Parameter) -> tuple[float, float] | None:
        if parameter.name not in module.free:
            return None
        return span(parameter, module.free[parameter.name].item(), self.scan_decades)

    def _fine_and_probe(self, module: PhysicsIDModule) -> tuple[Misfit, Misfit]:
        if self._misfits is None:
            fine = Misfit(module, self.particles)
            self._misfits = (
                fine,
                Misfit(module, self.probe_particles) if self.probe_particles < self.particles else fine,
            )
        return self._misfits

    def iterate(self, module: PhysicsIDModule, optimiser, step: int) -> float:
        """One iteration, then back into the bounds."""
        loss = super().iterate(module, optimiser, step)
        fine, _ = self._fine_and_probe(module)
        self._set(module, fine.model, np.clip(fine.free(module), *fine.model.bounds))
        return loss

    def _trial_loss(self, module: PhysicsIDModule) -> float:
        """By the coarser body and the difference of the two where the step began."""
        _, probe = self._fine_and_probe(module)
        return finite_loss(lambda: float(np.mean((probe.residual(probe.free(module)) + self._correction) ** 2)))

    def _normal_equations(self, module: PhysicsIDModule) -> NormalEquations:
        """In the order of ``module.unknowns``."""
        fine, probe = self._fine_and_probe(module)
        free, model = fine.free(module), fine.model
        now, there = fine.residual(free), probe.residual(free)
        self._correction = now - there
        order = [model.names.index(name) for name in (*module.free, *(parameter.name for parameter in VELOCITY))]
        with processes(self.jobs):
            jacobian = sensitivities(probe.residual, free, there, model.scales, model.bounds)[:, order]
        gradient, hessian = jacobian.T @ now / len(now), jacobian.T @ jacobian / len(now)
        return NormalEquations(float(np.mean(now**2)), torch.as_tensor(gradient), torch.as_tensor(hessian))

    @staticmethod
    @torch.no_grad()
    def _set(module: PhysicsIDModule, model: Model, free: np.ndarray) -> None:
        """Give the module the free coordinates of the model [(K,)]."""
        values = dict(zip(model.names, free.tolist(), strict=True))
        for name, unknown in module.free.items():
            unknown.fill_(values[name])
        module.velocity.copy_(torch.tensor([values[parameter.name] for parameter in VELOCITY]))


def _bar(losses: Iterator[float], count: int) -> Iterable[float]:
    return tqdm(losses, "physics: search", count, leave=False)


class Misfit:
    """Weighted residual of the outlines in the training views.

    Args:
        module: supplies video, state, model and the values to start from.
        particles: number of particles of the body.
        frames: only the first so many are compared; None: all.
        sunk: the ground lies so much lower [m]
    """

    def __init__(self, module: PhysicsIDModule, particles: int, frames: int | None = None, sunk: float = 0.0):
        data, physics = module.data, copy(module.physics)
        physics.ground_height -= sunk
        views = np.zeros(len(data.video.images), bool)
        views[data.train] = True
        held = Split(views, np.arange(len(data.video.times)) < (frames or len(data.video.times)))
        problem = StateProblem("", data, module.state, physics, held, bright=False, particles=particles)
        if not problem.fitted.any():
            raise UserInputError(
                f"{data.video.source}: no outline of a training view can be measured; they touch the border of the "
                "image in every frame. Use the method GaussNewton"
            )
        velocity = dict(zip((parameter.name for parameter in VELOCITY), module.velocity.tolist(), strict=True))
        known = {**problem.first_guess, **module.export_values(), **velocity}
        known[GROUND_HEIGHT.name] -= sunk
        self.model = problem.model(physics.effects, known)
        self._weighted = problem.weighted_residual_of(self.model)

    def residual(self, free: np.ndarray) -> np.ndarray:
        """At free coordinates [(K,)], in units of its error [(D,)]. Raises SimulationError."""
        return self._weighted(np.clip(free, *self.model.bounds))

    def free(self, module: PhysicsIDModule) -> np.ndarray:
        """The module's unknowns in the order of the model [(K,)]."""
        values = {name: unknown.item() for name, unknown in module.free.items()}
        values |= dict(zip((parameter.name for parameter in VELOCITY), module.velocity.tolist(), strict=True))
        return np.array([values[name] for name in self.model.names])
