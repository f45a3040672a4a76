"""Physical identification: warm-up on the frames around contact, then all frames (steps (b) and (c) of PAC-NeRF)."""

from typing import Any

import torch
from torch import Tensor, nn

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.phases.dynamic import DynamicPhase
from pacnerf_lpo.phases.identification_methods import VELOCITY_SCALE, IdentificationMethod
from pacnerf_lpo.phases.work import Work
from pacnerf_lpo.render.observation import Observer
from pacnerf_lpo.types import ParticleState


class PhysicsIDModule(DynamicPhase):
    """Identifies the material (and effect) parameters that are not declared known.

    Args:
        hit_frame: first frame in which the body touches the ground.
        method: PaperAdam, GaussNewton or OutlineGaussNewton.
        warm_up_frames: the warm-up uses the frames up to ``hit_frame + warm_up_frames``.
        silhouette_weight: see :class:`DynamicPhase`.
    """

    warm_up_end: Tensor  # first step of the main stage

    def __init__(
        self, hit_frame: int, method: IdentificationMethod, warm_up_frames: int = 3, silhouette_weight: float = 0.0
    ):
        super().__init__(method.iterations, silhouette_weight)
        self.automatic_optimization = False
        self.hit_frame, self.warm_up_frames = hit_frame, warm_up_frames
        self.method = self._configured = method
        self.register_buffer("warm_up_end", torch.tensor(method.warm_up_iterations))

    def check_settings(self) -> None:
        """The video must show the contact, and something must be left to identify."""
        video = self.data.video
        if not 1 <= self.hit_frame < len(video.times):
            raise UserInputError(
                f"phases.physics: hit_frame = {self.hit_frame} but {video.source} has frames 0 to "
                f"{len(video.times) - 1}; give the first frame that shows contact with the ground"
            )
        if not self.physics.free_names:
            raise UserInputError(
                "phases.physics: every parameter is declared known, so there is nothing to identify; shorten "
                "physics.material.known"
            )
        self.method.check(self.physics.free_names)

    def work(self, particles: int) -> Work:
        return self.method.work(self, particles)

    def begin(self) -> None:
        """Start from the parameters of the state, else from the material's guess."""
        self.method = self._configured.suited_to(self.state)
        known = {**self.physics.guess, **self.state.physics}
        described = self.physics.parameters
        free = {name: described[name].transform.to_free(known[name]) for name in self.physics.free_names}
        self.free = nn.ParameterDict({name: nn.Parameter(torch.tensor(value)) for name, value in free.items()})
        velocity = self.state.velocity.mean(0).clone()
        self.velocity = nn.Parameter(velocity, requires_grad=self.method.fits_velocity)
        visited: dict[str, list[float]] = {name: [] for name in self.free}
        self._course: dict[str, Any] = {"converged": False, "searched": {}, "costs": [], "visited": visited}

    @property
    def frame_count(self) -> int:
        """Frames of the video."""
        return len(self.data.video.times)

    @property
    def unknowns(self) -> list[Tensor]:
        """What Gauss-Newton changes: the free coordinates, then the velocity when it is refined."""
        return [*self.free.values(), *([self.velocity] if self.method.fits_velocity else [])]

    @property
    def scales(self) -> list[float]:
        """A noticeable change of each entry of :attr:`unknowns`."""
        material = [self.physics.parameters[name].scale for name in self.free]
        return material + ([VELOCITY_SCALE] * 3 if self.method.fits_velocity else [])

    @property
    def bounds(self) -> tuple[Tensor, Tensor]:
        """Between what each entry of :attr:`unknowns` has to stay [(K,)]; the velocity may be anything."""
        described, ends = self.physics.parameters, [[-torch.inf, torch.inf] for _ in self.scales]
        for index, name in enumerate(self.free):
            if name in self.within:
                ends[index] = [described[name].transform.to_free(end) for end in self.within[name]]
        low, high = torch.tensor(ends, dtype=torch.float64).T
        return low, high

    @property
    def warm_up_length(self) -> int:
        """Frames that the warm-up looks at."""
        return min(self.hit_frame + self.warm_up_frames, self.frame_count)

    def frames_at(self, step: int) -> int:
        """How many frames the iteration looks at."""
        return self.warm_up_length if step < self.warm_up_end else self.frame_count

    def values(self) -> dict[str, Tensor]:
        """Every physical parameter [SI, scalars], differentiable in the free coordinates."""
        described = self.physics.parameters
        known = self.physics.values(self.state)
        return {**known, **{name: described[name].transform.to_physical(free) for name, free in self.free.items()}}

    def trajectory(self, frames: int) -> Tensor:
        """Positions at the current parameters [m, (frames, N, 3)]."""
        return self.rollout(self.velocity, self.values(), frames)

    def loss(self, frames: int, views: list[list[int]], first: int = 0) -> Tensor:
        """Squared error summed over channels, averaged over pixels, the frames from ``first`` on, and their views."""
        seen, observer = self.watch(self.trajectory(frames), self.velocity, self.values())
        density, features = self.state.density, self.state.features
        return self.image_cost.loss(seen[:, first:], density, features, views[first:], first, observer)

    def residual(self, watched: tuple[Tensor, Observer], view: int, frame: int) -> Tensor:
        """Predicted minus measured image [(H, W, 3)] of what :meth:`watch` returned."""
        seen, observer = watched
        body = self.state.density, self.state.features
        return self.image_cost.residual_at(seen[:, frame], *body, view, frame, observer)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return self.method.optimiser(self)

    def on_train_start(self) -> None:
        """The method looks around first, where it may; a resumed run goes on where it stood, if it was not done."""
        if self.global_step == 0:
            if self.searches:
                self._course["searched"] = self.method.span(self)
                self.method.prepare(self)
        elif self.global_step > self.warm_up_end and self.method.converged(self, self.optimizers()):
            self._course["converged"] = self.trainer.should_stop = True

    def training_step(self, step: int, _: int) -> None:
        """One iteration of the method; a converged stage is left early."""
        optimiser = self.optimizers()
        before = {name: free.item() for name, free in self.free.items()}
        loss = self.method.iterate(self, optimiser, step)
        self.log("physics/loss", loss)
        if step >= self.warm_up_end:
            self._course["costs"].append(loss)
            for name, visited in self._course["visited"].items():
                visited += [*([] if visited else [before[name]]), self.free[name].item()]
        for name, value in self.export_values().items():
            self.log(f"physics/{name} [{self.physics.parameters[name].unit.replace('/', '|')}]", value)
        for axis, value in zip("xyz", self.velocity.detach(), strict=True):
            self.log(f"physics/v_{axis} [m|s]", value)
        if self.method.converged(self, optimiser) and step < self.warm_up_end:
            self.warm_up_end.fill_(step + 1)
        elif self.method.converged(self, optimiser):
            self._course["converged"] = self.trainer.should_stop = True

    def export_values(self) -> dict[str, float]:
        """Every physical parameter now [SI]."""
        return {name: value.item() for name, value in self.values().items()}

    def export_state(self) -> ParticleState:
        velocity = self.velocity.detach().cpu().expand_as(self.state.positions).clone()
        return self.state.with_(physics=self.export_values(), velocity=velocity)

    def course(self) -> dict[str, Any]:
        """Method, contact frame, whether the velocity is fitted, too, and what was searched; of the iterations on all
        frames the cost before each, and the free coordinates before the first and after each.
        """
        return {
            "method": type(self.method).__name__,
            "hit_frame": self.hit_frame,
            "draws_views": self.method.draws_views,
            "fits_velocity": self.method.fits_velocity,
            **self._course,
        }

    def progress(self) -> dict[str, Any]:
        return self._course

    def take_up(self, progress: dict[str, Any]) -> None:
        self._course = {name: progress[name] for name in self._course}

    def progress_metrics(self) -> dict[str, str]:
        values = self.export_values()
        return {name: self.physics.parameters[name].show(values[name]) for name in self.free}
