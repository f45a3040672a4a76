"""Identification by outlines alone: so cheap that the whole parameter space is searched before the first step."""

from collections.abc import Iterable, Sequence
from copy import copy

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.forward_model import VELOCITY, Model
from pacnerf_lpo.identification.least_squares import Effort, Fit, fit_or_none, sensitivities
from pacnerf_lpo.identification.levenberg_marquardt import NormalEquations
from pacnerf_lpo.identification.multistart import Stage, horizons, multistart
from pacnerf_lpo.identification.problem import StateProblem
from pacnerf_lpo.identification.processes import check_jobs, processes
from pacnerf_lpo.identification.silhouette_moments import KINDS
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.mpm.parameters import Log10
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.phases.identification_methods import TRIALS, DampedLeastSquares, GaussNewton, finite_loss
from pacnerf_lpo.phases.physics_id import PhysicsIDModule
from pacnerf_lpo.phases.work import Work
from pacnerf_lpo.types import ParticleState

FALL_ITERATIONS, SEARCH_ITERATIONS, FINER_ITERATIONS = 4, 6, 3
HALVINGS = 1
"""Of the time step: what needs a finer one is not worth its time in a search."""
FINALISTS = 3
"""Optima of a coarse body that are followed on a finer one: its error moves them and changes their order."""
COMPETING = 2.0
"""Of the best cost: an optimum above it is discarded."""
APART = 0.2
"""Of its span in one of the coordinates: so far apart lie the points of a sample that are followed."""
SAME = 0.5
"""Scales: fits that end nearer to each other than that in every coordinate have found the same minimum."""
NEIGHBOURS = (-0.5, 0.5)
"""Decades: the local minima of a modulus that a plastic impact weakly identifies lie about so far apart."""
MUCH_LOWER = 0.9
"""Of the cost: between minima that differ by less, finer bodies decide."""
FINER = 2
"""So many times as many particles have the bodies that decide between minima."""
SUNK = 1.0
"""The ground is put out of the way where the fall is fitted [m]: a coarse grid feels it a cell or two too early."""


class OutlineGaussNewton(DampedLeastSquares):
    """Levenberg-Marquardt on ten numbers for each outline (centroid, area, widths, edges; see
    :mod:`pacnerf_lpo.identification.silhouette_moments`), relative to frame 0, instead of on pixels.

    No image is rendered: particles are splatted, an evaluation takes little longer than a rollout. So first a
    low-discrepancy sample of the parameter space is tried on a coarse body. From its best points that lie well apart,
    by the first frames after contact and by all, short fits take in more and more frames
    (see :mod:`pacnerf_lpo.identification.multistart`). Their best optima go on with finer bodies, and at last some fits
    start from neighbours of the best. Where two end about as low, fits of both with still finer bodies decide. Shading,
    which pulls colours to a wrong motion, does not enter.

    A coarse grid makes a body too stiff where it flows, and a fit on it ends in a wrong local minimum. So what
    outlines say is extrapolated to vanishing node spacing from bodies of two resolutions (Richardson 1911, see
    :class:`OutlineCost`). A corrected body is compared pixel by pixel, moved by its own particles: the correction has
    made those agree with the images, and neither its outlines by splats nor another sampling of it do.

    Args:
        iterations: at most, after the search.
        samples: points of the search, with the initial guess one more; a power of two is best. 0: no search.
        scan_decades: log10 parameters are searched so many decades to either side of the guess.
        starts: how many of the best points are followed by short fits.
        particles, coarse_particles: number of particles of the two bodies.
        scan_particles: number of particles of the body that is coarser still, of the first short fits.
        jobs: simulations at the same time, each in a process of its own; None: as many as torch may use threads, at
            most 8, and one on a GPU.
    """

    def __init__(
        self,
        iterations: int = 12,
        samples: int = 128,
        scan_decades: float = 3.0,
        starts: int = 12,
        particles: int = 4000,
        coarse_particles: int = 1500,
        scan_particles: int = 700,
        jobs: int | None = None,
    ):
        super().__init__(0, iterations, scan_decades)
        if samples < 0 or starts < 1 or not 100 <= scan_particles < coarse_particles < particles:
            raise UserInputError(
                f"OutlineGaussNewton: samples = {samples}, starts = {starts}, particles = {particles}, "
                f"coarse_particles = {coarse_particles}, scan_particles = {scan_particles}; give at least 0 and 1, and "
                "three numbers of particles from the largest to the smallest, which is at least 100"
            )
        check_jobs(jobs, "OutlineGaussNewton")
        self.searches = samples > 0
        self.samples, self.starts, self.jobs = samples, starts, jobs
        self.particles, self.coarse_particles, self.scan_particles = particles, coarse_particles, scan_particles
        self._kept: OutlineCost | None = None

    def work(self, module: PhysicsIDModule, particles: int) -> Work:
        """No images. Fits of the search converge after half of their iterations; half of the optima are compared."""
        each = len(module.physics.free_names) + len(VELOCITY) + TRIALS
        short, stages = SEARCH_ITERATIONS * each / 2, len(horizons(module.hit_frame, module.frame_count))
        follow = min(self.starts, FINALISTS)
        numbers = self.coarse_particles, self.scan_particles, self.particles
        coarse, scan, fine = ((count / particles) ** (4 / 3) for count in numbers)  # half the spacing is half the step
        searched = coarse * self.samples + (coarse + scan) * self.starts * stages * short
        finer = (fine + coarse) * (follow * 2 * short + len(NEIGHBOURS) * short)
        searches = self.searches and module.searches
        rollouts = (searched + finer) * searches + (fine + coarse) * self.main_iterations * each / 2
        return Work(frames=rollouts * module.frame_count)

    def suited_to(self, state: ParticleState) -> DampedLeastSquares:
        if not state.corrected:
            return self
        return PixelsAfterOutlines(0, self.main_iterations, self.scan_decades, coarse_pool=1, pool=1)

    def prepare(self, module: PhysicsIDModule) -> None:
        if self.searches:
            with processes(self.jobs):
                self._fit_fall(module)
                self._search(module)

    def _search(self, module: PhysicsIDModule) -> None:
        points = OutlineCost(module, self.coarse_particles)
        model, frames = points.model, len(module.data.video.times)
        spans = {model.names.index(name): ends for name, ends in self.span(module).items()}
        widths = np.array([np.ptp(spans.get(index, (-np.inf, np.inf))) for index in range(len(model.names))])
        rows = [points.rows(until) for until in horizons(module.hit_frame, frames)]
        model.physics.most_halvings = HALVINGS
        sample = Stage(
            points.residual, model.scales, model.bounds, (rows[-min(len(rows), 3)], None), -(-self.starts // 2),
            spans=spans, samples=self.samples, apart=APART * widths,
        )  # fmt: skip
        found = multistart([sample], [model.start], _bar).fits
        outline_cost, found = self._fits(module, (self.coarse_particles, self.scan_particles), found, rows)
        outline_cost, found = self._fits(module, (self.particles, self.coarse_particles), found, rows[-2:])
        if not found:
            return
        moduli = {index: ends for index, ends in spans.items() if isinstance(model.unknowns[index].transform, Log10)}
        neighbours = outline_cost.stage(keep=FINALISTS, spans=moduli, offsets=NEIGHBOURS, apart=SAME * model.scales)
        best, *others = multistart([neighbours], found[:1], _bar).fits
        if others and MUCH_LOWER * others[0].cost < best.cost:
            best = min(self._on_finer(module, [best, others[0]]), key=lambda fit: fit.cost, default=best)
        self._set(module, outline_cost.model, best.free)

    def _fits(
        self,
        module: PhysicsIDModule,
        bodies: tuple[int, int],
        starts: Sequence[Fit],
        rows: Sequence[np.ndarray | None] = (None,),
    ) -> "tuple[OutlineCost, list[Fit]]":
        """Short fits that end apart, the best first, and of what; all at the same time step. Every step costs some of
        the rebound, so a stiffness that needs half the step must not be compared with one that does not.
        """
        outline_cost = self._searched(module, bodies)
        found = multistart([outline_cost.stage(rows, FINALISTS, within=COMPETING)], starts, _bar).fits
        if not any(outline_cost.needs_shorter_step(fit.free) for fit in found):
            return outline_cost, found
        module.physics.halvings += 1
        return self._fits(module, bodies, found, rows[-1:])

    @staticmethod
    def _searched(module: PhysicsIDModule, bodies: tuple[int, int]) -> "OutlineCost":
        """The cost of a search, whose steps are at most :data:`HALVINGS` shorter than the run's."""
        outline_cost = OutlineCost(module, *bodies)
        outline_cost.model.physics.most_halvings = max(HALVINGS - module.physics.halvings, 0)
        return outline_cost

    def _on_finer(self, module: PhysicsIDModule, fits: Sequence[Fit]) -> list[Fit]:
        """Where fits lead with finer bodies, the best first: one pair of grids has an error that a wrong minimum fits,
        and another pair has another. Fits decide, not points: the bottoms of minima lie elsewhere there.
        """
        finer = self._searched(module, (FINER * self.particles, FINER * self.coarse_particles))
        return multistart([finer.stage(iterations=FINER_ITERATIONS)], fits).fits

    def _fit_fall(self, module: PhysicsIDModule) -> None:
        """The velocity by the frames before contact; colours, which the velocity phase fits, pull it down by percents,
        and with it the search into another local minimum.
        """
        early = OutlineCost(module, self.coarse_particles, frames=module.hit_frame, sunk=SUNK)
        model = early.model
        moving = np.isin(model.names, [parameter.name for parameter in VELOCITY])
        low, high = (np.where(moving, bound, model.start) for bound in model.bounds)
        ended = fit_or_none(early.residual, model.start, model.scales, (low, high), Effort(FALL_ITERATIONS))
        if ended is not None:
            module.velocity.data.copy_(model.velocity(ended.free))

    def _outline_cost(self, module: PhysicsIDModule) -> "OutlineCost":
        if self._kept is None:
            self._kept = OutlineCost(module, self.particles, self.coarse_particles)
        return self._kept

    def end_iteration(self, module: PhysicsIDModule) -> None:
        """Back into the bounds."""
        outline_cost = self._outline_cost(module)
        self._set(module, outline_cost.model, np.clip(outline_cost.free(module), *outline_cost.model.bounds))

    def trial_loss(self, module: PhysicsIDModule) -> float:
        outline_cost = self._outline_cost(module)
        return finite_loss(lambda: float(np.mean(outline_cost.residual(outline_cost.free(module)) ** 2)))

    def normal_equations(self, module: PhysicsIDModule) -> NormalEquations:
        outline_cost = self._outline_cost(module)
        free, model = outline_cost.free(module), outline_cost.model
        now = outline_cost.residual(free)
        with processes(self.jobs):
            jacobian = sensitivities(outline_cost.residual, free, now, model.scales, model.bounds)
        gradient, hessian = jacobian.T @ now / len(now), jacobian.T @ jacobian / len(now)
        return NormalEquations(float(np.mean(now**2)), torch.as_tensor(gradient), torch.as_tensor(hessian))

    @staticmethod
    @torch.no_grad()
    def _set(module: PhysicsIDModule, model: Model, free: np.ndarray) -> None:
        """Give the module the free coordinates of the model [(K,)]."""
        for unknown, value in zip(module.free.values(), free.tolist(), strict=False):
            unknown.fill_(value)
        module.velocity.copy_(model.velocity(free))


class PixelsAfterOutlines(GaussNewton):
    """Gauss-Newton on the pixels of a corrected body, for which the prior counts as much as one image: an image is
    known by as much as it differs from the model at the start. So a Poisson's ratio of which the images say little is
    not left to errors of the correction.
    """

    def prior_terms(self, module: PhysicsIDModule) -> tuple[float, Tensor, Tensor]:
        """Mean square, gradient and Gauss-Newton Hessian of how far unknowns are from their prior means."""
        weight = self.group["image_error"] / sum(map(len, self._views))
        size = sum(unknown.numel() for unknown in module.unknowns)
        residuals, slopes = torch.zeros(2, size, dtype=torch.float64)
        for index, (name, free) in enumerate(module.free.items()):
            parameter = module.physics.parameters[name]
            if parameter.prior_value is None:
                continue
            mean, deviation = parameter.prior_value
            with torch.enable_grad():
                moved = free.detach().double().requires_grad_()
                residual = (parameter.transform.to_physical(moved) - mean) / deviation
                (slopes[index],) = torch.autograd.grad(residual, moved)
            residuals[index] = residual.detach()
        loss = sum(weight * residual**2 for residual in residuals.tolist())
        return loss, weight * slopes * residuals, torch.diag(weight * slopes**2)


def _bar(items: Iterable, count: int) -> Iterable:
    return tqdm(items, "physics: search", count, leave=False)


class OutlineCost:
    """Weighted residual of the outlines in the training views.

    With a coarser body in addition, it is extrapolated to vanishing node spacing h as an error in h^2 would be
    (Richardson 1911): in plastic flow, 1500 and 4000 particles extrapolated are nearer to 40,000 than 14,000 are. What
    an elastic body does as it rebounds does not converge so regularly, and gains less.

    Behind the outlines' numbers comes one for each unknown with a prior: how far it is from the prior mean, counted as
    much as one outline. So a Poisson's ratio about which a plastic impact says nothing does not run to its bound.

    Args:
        module: supplies video, state, model, how often its time step is halved, and the values to start from.
        particles, coarser: number of particles of the body, and of the coarser one, if there is one.
        frames: only the first so many are compared; None: all.
        sunk: the ground lies so much lower [m]
    """

    def __init__(
        self,
        module: PhysicsIDModule,
        particles: int,
        coarser: int | None = None,
        frames: int | None = None,
        sunk: float = 0.0,
    ):
        data, physics = module.data, copy(module.physics)
        physics.ground_height -= sunk
        physics.substep_rate *= 2**physics.halvings
        views = np.isin(np.arange(len(data.video.images)), data.train)
        held = Split(views, np.arange(module.frame_count) < (frames or module.frame_count))
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
        self.model.frames = frames
        self._weighted = problem.weighted_residual_of(self.model)
        self._frames = np.nonzero(problem.fitted)[1]
        self._coarser = None if coarser is None else OutlineCost(module, coarser, None, frames, sunk)

    def residual(self, free: np.ndarray) -> np.ndarray:
        """At free coordinates [(K,)], in units of its error [(D,)]. Raises SimulationError."""
        free = np.clip(free, *self.model.bounds)
        self.model.physics.halvings = 0
        found = np.append(self._weighted(free), self.prior_terms(free))
        if self._coarser is None:
            return found
        coarse, ratio = self._coarser.model, self._coarser.model.body.spacing / self.model.body.spacing
        coarse.physics.halvings = self.model.physics.halvings
        coarse.physics.most_halvings = self.model.physics.most_halvings
        return found + (found - self._coarser.residual(free)) / (ratio**2 - 1)

    def rows(self, frames: int) -> np.ndarray:
        """Which rows of the residual are of the first frames, or of no frame [(D,), bool]."""
        return np.append(self._frames < frames, np.ones(len(self.prior_terms(self.model.start)), bool))

    def stage(
        self, rows: Sequence[np.ndarray | None] = (None,), keep: int = 2, iterations: int = SEARCH_ITERATIONS, **more
    ) -> Stage:
        """Short fits of the cost, as a stage of a search; arguments as of :class:`Stage`."""
        return Stage(self.residual, self.model.scales, self.model.bounds, rows, keep, iterations, **more)

    def needs_shorter_step(self, free: np.ndarray) -> bool:
        """Whether the time step that fits start with is too long at free coordinates [(K,)]. Raises SimulationError."""
        bodies = [found.model for found in (self, self._coarser) if found is not None]
        self.residual(free)
        return any(model.physics.halvings > 0 for model in bodies)

    def prior_terms(self, free: np.ndarray) -> list[float]:
        """How far unknowns are from their prior means, at free coordinates [(K,)]."""
        values = self.model.physical(free)
        return [
            len(KINDS) ** 0.5 * (values[parameter.name] - parameter.prior_value[0]) / parameter.prior_value[1]
            for parameter in self.model.unknowns
            if parameter.prior_value is not None
        ]

    def free(self, module: PhysicsIDModule) -> np.ndarray:
        """The module's unknowns, which are those of the model [(K,)]."""
        return np.array([*(unknown.item() for unknown in module.free.values()), *module.velocity.tolist()])
