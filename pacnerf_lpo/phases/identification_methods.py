"""Two ways to identify the physical parameters on the same residuals: the paper's Adam, and damped Gauss-Newton."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from tqdm import tqdm

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.identification.levenberg_marquardt import LevenbergMarquardt, NormalEquations
from pacnerf_lpo.phases.work import Work, compared
from pacnerf_lpo.render.camera_faults.base import faults_of

if TYPE_CHECKING:
    from pacnerf_lpo.phases.physics_id import PhysicsIDModule
    from pacnerf_lpo.render.observation import Observer
    from pacnerf_lpo.types import ParticleState

PROBE = 0.5  # of a parameter's scale: change for a forward sensitivity, well above the sampling noise of images
LEAST_GAIN = 1e-3  # of the cost, by a step that is worth another
LONGEST_STEP = 5.0  # of a parameter's scale, in one Gauss-Newton step
VELOCITY_SCALE = 0.1  # m/s
TRIALS = 2.5
"""Simulations of an iteration that are no sensitivity: where it stands, and the steps that it tries."""
UNSEEN = 1e-5
"""Smallest visible displacement [m]: a fall before contact with another stiffness changes less, and is not rendered."""


class IdentificationMethod(ABC):
    """How PhysicsIDModule lowers the cost: by iterations on the frames around contact, then by others on all frames."""

    fits_velocity: bool = False
    draws_views: bool = False  # at random, so that the costs of two iterations differ by chance, too

    def __init__(self, warm_up_iterations: int, main_iterations: int):
        if warm_up_iterations < 0 or main_iterations < 1:
            raise UserInputError(
                f"{type(self).__name__}: warm_up_iterations = {warm_up_iterations} and main_iterations = "
                f"{main_iterations}; give at least 0 and 1"
            )
        self.warm_up_iterations, self.main_iterations = warm_up_iterations, main_iterations

    @property
    def iterations(self) -> int:
        """Iterations in all."""
        return self.warm_up_iterations + self.main_iterations

    def suited_to(self, state: ParticleState) -> IdentificationMethod:
        """The method to use for this state: itself, unless a method knows better."""
        return self

    def check(self, names: Sequence[str]) -> None:
        """Raise UserInputError when the settings do not fit the parameters that are identified."""
        return

    @abstractmethod
    def work(self, module: PhysicsIDModule, particles: int) -> Work:
        """How much it will compute for a body of so many particles, about."""

    @abstractmethod
    def optimiser(self, module: PhysicsIDModule) -> torch.optim.Optimizer:
        """The optimiser over ``module.free`` (and ``module.velocity``)."""

    @abstractmethod
    def iterate(self, module: PhysicsIDModule, optimiser, step: int) -> float:
        """One iteration; returns the cost before it."""

    def prepare(self, module: PhysicsIDModule) -> None:
        """Called once before the first iteration of a fresh run."""
        return

    def span(self, module: PhysicsIDModule) -> dict[str, tuple[float, float]]:
        """Between which free coordinates :meth:`prepare` searches each parameter; empty where it does not."""
        return {}

    def converged(self, module: PhysicsIDModule, optimiser) -> bool:
        """Whether the current stage has nothing left to gain; False where the number of iterations is fixed."""
        return False


class PaperAdam(IdentificationMethod):
    """Adam on one random training view per frame, gradients through the whole rollout (PAC-NeRF).

    Args:
        learning_rates: rate of each parameter's free coordinate by name; the papers' where not named.
        warm_up_iterations, main_iterations: 50 and 100 in the paper.
    """

    draws_views = True

    def __init__(
        self,
        learning_rates: Mapping[str, float] | None = None,
        warm_up_iterations: int = 50,
        main_iterations: int = 100,
    ):
        super().__init__(warm_up_iterations, main_iterations)
        self.learning_rates = dict(learning_rates or {})

    def check(self, names: Sequence[str]) -> None:
        unknown = [name for name in self.learning_rates if name not in names]
        if unknown:
            raise UserInputError(
                f"phases.physics.method: learning_rates names {', '.join(unknown)}, which is not identified here; name "
                f"only {', '.join(names)}"
            )

    def work(self, module: PhysicsIDModule, particles: int) -> Work:
        early = compared(module.warm_up_length, 1, gradients=True) * self.warm_up_iterations
        return early + compared(module.frame_count, 1, gradients=True) * self.main_iterations

    def optimiser(self, module: PhysicsIDModule) -> torch.optim.Optimizer:
        rates = {name: self.learning_rates.get(name, module.physics.parameters[name].rate) for name in module.free}
        groups = [{"params": [free], "lr": rates[name]} for name, free in module.free.items()]
        return torch.optim.Adam(groups)

    def iterate(self, module: PhysicsIDModule, optimiser, step: int) -> float:
        frames = module.frames_at(step)
        optimiser.zero_grad()
        loss = module.loss(frames, module.one_view_per_frame(step, frames))
        module.manual_backward(loss)
        optimiser.step()
        for free, low, high in zip(module.free.values(), *module.bounds, strict=False):
            free.data.clamp_(low, high)
        return loss.item()


class DampedLeastSquares(IdentificationMethod):
    """Levenberg-Marquardt with forward sensitivities, for material and initial velocity together: the parameters are
    few, so one more rollout for each gives the Jacobian of every residual. Either stage ends when its steps have become
    small. Before the first step log10 parameters may be searched, ``scan_decades`` to either side.
    """

    searches: bool
    """Whether :meth:`prepare` looks at the whole parameter space."""

    def __init__(self, warm_up_iterations: int, main_iterations: int, scan_decades: float, fits_velocity: bool = True):
        super().__init__(warm_up_iterations, main_iterations)
        self.scan_decades, self.fits_velocity = scan_decades, fits_velocity
        self.group: dict[str, Any] = {}  # state of the optimiser, which a checkpoint keeps

    @abstractmethod
    def trial_loss(self, module: PhysicsIDModule) -> float:
        """The cost at the current parameters; infinite where the motion is unstable."""

    @abstractmethod
    def normal_equations(self, module: PhysicsIDModule) -> NormalEquations:
        """Of the cost at the current parameters, in the order of ``module.unknowns``."""

    def begin_iteration(self, module: PhysicsIDModule, step: int) -> None:
        """Called before each iteration."""
        return

    def end_iteration(self, module: PhysicsIDModule) -> None:
        """Called after each iteration."""
        return

    def optimiser(self, module: PhysicsIDModule) -> torch.optim.Optimizer:
        limits = torch.tensor(module.scales, dtype=torch.float64) * LONGEST_STEP
        return LevenbergMarquardt(module.unknowns, limits, lambda: self.trial_loss(module), module.bounds)

    def span(self, module: PhysicsIDModule) -> dict[str, tuple[float, float]]:
        lattices = {name: self._lattice(module, name) for name in module.free} if self.searches else {}
        return {name: (min(points), max(points)) for name, points in lattices.items() if len(points) > 1}

    def iterate(self, module: PhysicsIDModule, optimiser, step: int) -> float:
        self.group = optimiser.param_groups[0]
        self.begin_iteration(module, step)
        if step == module.warm_up_end:  # steps that failed on other frames say nothing of these
            self.group["damping"] = optimiser.defaults["damping"]
        model = optimiser.step(lambda: self.normal_equations(module))
        self.end_iteration(module)
        return model.loss

    def converged(self, module: PhysicsIDModule, optimiser) -> bool:
        """The last step was short, or took away hardly anything: along a flat direction steps stay long."""
        last = optimiser.param_groups[0]
        return last["last_step"] < 0.01 or last["last_gain"] < LEAST_GAIN

    def _lattice(self, module: PhysicsIDModule, name: str) -> list[float]:
        parameter = module.physics.parameters[name]
        points = parameter.transform.lattice(module.free[name].item(), self.scan_decades)
        low, high = parameter.bounds
        return [point for point in points if low < float(parameter.transform.to_physical(torch.tensor(point))) < high]


class GaussNewton(DampedLeastSquares):
    """Levenberg-Marquardt with forward sensitivities, for material and initial velocity together.

    The parameters are few, so one more rollout for each gives the Jacobian of every pixel. A scan over decades finds
    the local minimum before the first step, because moduli can be wrong by a factor of a thousand.

    Args:
        coarse_iterations: at most, on the warm-up frames and on images averaged over ``coarse_pool`` pixels: soon after
            contact the minimum is wide, later it splits into several.
        iterations: at most, on all frames; either stage ends when its steps have become small.
        scan_decades: parameters are first tried on a lattice, log10 ones so many decades to either side; 0: not.
        coarse_pool, pool: block size [pixels] over which images are averaged before comparison.
        views_per_frame: how many training views each frame is compared in, spread evenly; None: all.
        fits_velocity: refine the initial velocity too.
    """

    def __init__(
        self,
        coarse_iterations: int = 4,
        iterations: int = 8,
        scan_decades: float = 3.0,
        coarse_pool: int = 4,
        pool: int = 2,
        views_per_frame: int | None = None,
        fits_velocity: bool = True,
    ):
        super().__init__(coarse_iterations, iterations, scan_decades, fits_velocity)
        self.searches = scan_decades > 0
        if min(coarse_pool, pool) < 1:
            raise UserInputError(
                f"GaussNewton: coarse_pool = {coarse_pool}, pool = {pool}; give blocks of at least 1 pixel"
            )
        self.coarse_pool, self.pool, self.views_per_frame = coarse_pool, pool, views_per_frame

    def work(self, module: PhysicsIDModule, particles: int) -> Work:
        """Every iteration simulates each unknown and some trials; every scan its lattice, and those left again."""
        names, views = module.physics.free_names, len(module.fixed_views(1, self.views_per_frame)[0])
        early, late = (compared(count, views, gradients=False) for count in (module.warm_up_length, module.frame_count))
        once = len(names) + (3 if self.fits_velocity else 0) + TRIALS
        searches = self.searches and module.searches
        scans = (2 * self.scan_decades + 1) * len(names) * (len(names) + 1) / 2 if searches else 0
        return early * (scans + once * self.warm_up_iterations) + late * (once * self.main_iterations)

    def prepare(self, module: PhysicsIDModule) -> None:
        """Scan the parameters on the frames around contact: again and again, fix the one that gains most by itself."""
        if not self.searches:
            return
        module.image_cost.pool = self.coarse_pool
        open_names = [name for name in module.free if len(self._lattice(module, name)) > 1]
        while open_names:
            found = {name: self._scan(module, name) for name in open_names}
            best = min(found, key=lambda name: found[name][0])
            module.free[best].data.fill_(found[best][1])
            open_names.remove(best)

    def begin_iteration(self, module: PhysicsIDModule, step: int) -> None:
        """Choose the frames, the views and the blocks of pixels of this stage."""
        module.image_cost.pool = self.coarse_pool if step < module.warm_up_end else self.pool
        self._frames = module.frames_at(step)
        self._views = module.fixed_views(self._frames, self.views_per_frame)

    def prior_terms(self, module: PhysicsIDModule) -> tuple[float, Tensor, Tensor]:
        """What is added to the mean squared error of the pixels, its gradient and its Hessian."""
        return 0.0, torch.zeros(()), torch.zeros(())

    def trial_loss(self, module: PhysicsIDModule) -> float:
        return finite_loss(lambda: module.loss(self._frames, self._views).item()) + self.prior_terms(module)[0]

    def _scan(self, module: PhysicsIDModule, name: str) -> tuple[float, float]:
        """Least cost over the lattice of one parameter, and the free coordinate where it is; changes nothing."""
        frames, first = module.warm_up_length, module.hit_frame - 1
        views = module.fixed_views(frames, self.views_per_frame)
        start, halvings, losses = module.free[name].item(), module.physics.halvings, {}
        for point in tqdm(self._lattice(module, name), desc=f"physics: scan of {name}", leave=False):
            module.free[name].data.fill_(point)
            with torch.no_grad():
                losses[point] = finite_loss(lambda: module.loss(frames, views, first).item())
            module.physics.halvings = halvings  # a point that needs a short step must not slow the others down
        module.free[name].data.fill_(start)
        best = min(losses, key=losses.__getitem__)
        return losses[best], best

    @torch.no_grad()
    def normal_equations(self, module: PhysicsIDModule) -> NormalEquations:
        watched, probes = self._watched(module)
        size = len(probes)
        loss, gradient = 0.0, torch.zeros(size, dtype=torch.float64)
        hessian = torch.zeros(size, size, dtype=torch.float64)
        for frame, views in enumerate(self._views):
            for view in views:
                seen = [module.residual(watched[0], view, frame)]
                for motion in watched[1:]:
                    same = _looks_alike(motion, watched[0], frame)
                    seen.append(seen[0] if same else module.residual(motion, view, frame))
                pixels = seen[0].shape[0] * seen[0].shape[1]
                flat = torch.stack(seen).reshape(size + 1, -1).double()
                jacobian = (flat[1:] - flat[0]) / probes[:, None]
                weight = 1 / (pixels * self._frames * len(views))
                loss += weight * flat[0].square().sum().item()
                gradient += weight * (jacobian @ flat[0])
                hessian += weight * (jacobian @ jacobian.T)
        self.group.setdefault("image_error", loss)
        more = self.prior_terms(module)
        return NormalEquations(loss + more[0], gradient + more[1], hessian + more[2])

    def _watched(self, module: PhysicsIDModule) -> tuple[list[tuple[Tensor, Observer]], Tensor]:
        """The motion as seen at the current parameters, then one for each unknown moved by its probe."""
        path = module.trajectory(self._frames)
        watched = [module.watch(path, module.velocity, module.values())]
        probes = torch.tensor(module.scales, dtype=torch.float64) * PROBE
        entries = [(unknown, index) for unknown in module.unknowns for index in range(unknown.numel())]
        cameras = {id(module.free[name]) for effect in faults_of(module.physics.effects) for name in effect.parameters}
        for (unknown, index), probe in zip(entries, probes, strict=True):
            before = unknown.detach().clone()
            unknown.view(-1)[index] += float(probe)
            moved = path if id(unknown) in cameras else module.trajectory(self._frames)
            watched.append(module.watch(moved, module.velocity, module.values()))
            unknown.copy_(before)
        return watched, probes


def _looks_alike(one: tuple[Tensor, Observer], other: tuple[Tensor, Observer], frame: int) -> bool:
    """Whether two motions (as :meth:`DynamicPhase.watch` gives them) look the same to all cameras in a frame."""
    (path, observer), (reference, believed) = one, other
    as_before = observer is believed or not (observer.names or believed.names)
    return as_before and bool((path[:, frame] - reference[:, frame]).abs().max() < UNSEEN)


def finite_loss(loss) -> float:
    """The value of ``loss()``, infinite where the rollout is unstable."""
    try:
        return loss()
    except SimulationError:
        return float("inf")
