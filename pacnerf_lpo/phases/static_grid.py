"""Phase 1: a voxel radiance field of frame 0, fitted to the training views, becomes particles."""

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import mse_loss, normalize

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.prediction import StateRenderer
from pacnerf_lpo.identification.problem import StateProblem
from pacnerf_lpo.identification.silhouette_moments import silhouette_moments
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.losses.regularisers import matte_cross_entropy, surface_area, transmittance_entropy
from pacnerf_lpo.particles.parts import confirmed, inside_mattes
from pacnerf_lpo.particles.sampling import RELATIVE_ALPHA, interpolate, particle_alpha, sample_particles
from pacnerf_lpo.phases.base import AbstractPhase, psnr
from pacnerf_lpo.phases.schedules import TrainingLength, WeightSchedule
from pacnerf_lpo.phases.work import Work
from pacnerf_lpo.render.ray_march import MIN_WEIGHT, box_interval, march, shade
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.scene.voxel_field import VoxelField
from pacnerf_lpo.types import ParticleState, Rays

LOGGED_EVERY = 10
"""Steps: writing a dozen curves takes half as long as a step on a GPU, and there are thousands of them."""


class StaticGridModule(AbstractPhase):
    """Static voxel optimisation of PAC-NeRF (Li et al., ICLR 2023) with the options of the LPO supplement, appendix A.

    loss = MSE + view_invariant_weight * MSE(random view directions) + entropy + surface regulariser, over one random
    ray batch of one random training view per step. Step k draws from its own seed: a resumed run repeats itself.

    Args:
        base_spacing: coarsest voxel size dx0 [m].
        entropy_weight: default weight of the transmittance entropy.
        surface_weight: default weight of the surface regulariser [1/m^2].
        entropy_schedule: factor on ``entropy_weight`` over the steps.
        surface_schedule: factor on ``surface_weight`` over the steps.
        length: number of steps and when voxels are scaled.
        view_invariant_weight: weight of the view-invariant pixel loss; 0 leaves it out.
        silhouette_weight: weight of the cross entropy between opacity and the matte. Not in the paper, whose losses
            cannot see white fog in front of the white background; it makes short training enough. Fog that floats apart
            from the body, where most views have no matte, is left out of the particles then.
        entropy_limit: largest weight of the transmittance entropy.
        rays_per_step: rays in a batch.
        grid_rate: Adam rate of density and features.
        network_rate: Adam rate of the colour network.
        min_weight: samples that would add less to their ray are not coloured (1e-7 in PAC-NeRF).
        relative_alpha: particles are kept whose alpha is at least this fraction of the largest (1e-3 in PAC-NeRF).
            A dense field has a rim of faint particles one voxel wide that weigh but are not seen; 0.5 cuts it off.
        seed: seed of views, rays and particles.
    """

    field: VoxelField

    def __init__(
        self,
        base_spacing: float,
        entropy_weight: float,
        surface_weight: float,
        entropy_schedule: WeightSchedule,
        surface_schedule: WeightSchedule,
        length: TrainingLength,
        view_invariant_weight: float = 0.0,
        silhouette_weight: float = 0.0,
        entropy_limit: float = 0.1,
        rays_per_step: int = 1024,
        grid_rate: float = 0.1,
        network_rate: float = 1e-3,
        min_weight: float = MIN_WEIGHT,
        relative_alpha: float = RELATIVE_ALPHA,
        seed: int = 0,
    ):
        super().__init__()
        if base_spacing <= 0:
            raise UserInputError(f"phases.static.base_spacing = {base_spacing:g} m must be positive")
        if rays_per_step < 1:
            raise UserInputError(f"phases.static.rays_per_step = {rays_per_step}: give at least one ray")
        self.base_spacing, self.rays_per_step = base_spacing, rays_per_step
        self.min_weight, self.seed = min_weight, seed
        self.entropy_weight, self.entropy_schedule = entropy_weight, entropy_schedule
        self.surface_weight, self.surface_schedule = surface_weight, surface_schedule
        self.entropy_limit, self.view_invariant_weight = entropy_limit, view_invariant_weight
        self.silhouette_weight, self.relative_alpha = silhouette_weight, relative_alpha
        self.length, self.steps, self.grid_rate, self.network_rate = length, length.steps, grid_rate, network_rate
        self.last_psnr = float("nan")

    def check(self) -> None:
        """Raise UserInputError where outlines decide what the body occupies, and every training view cuts them off."""
        video = self.data.video
        outlines = silhouette_moments(video.silhouettes[self.data.train, 0])
        if self.physics.mass_from == "outline" and not np.isfinite(outlines).any():
            raise UserInputError(
                f"{video.source}: physics.mass_from = outline needs a training view that shows the whole outline at "
                "frame 0, but in all of them it touches the border of the image; set physics.mass_from to opacity"
            )

    def import_state(self, state: ParticleState | None) -> None:
        """Start from an empty field in the video's box.

        As the first phase it takes no state. Between two rounds it does: images of the state's particles in the
        training views are targets in addition to the measured ones, and its motion and physics are handed on.
        """
        self.previous = state
        self._predicted = {} if state is None else self._images_of(state)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            self.colour = ColourNetwork()
        self.field = VoxelField.create(self.data.box, self.base_spacing)
        self._rays_through_box: dict[int, Tensor] = {}

    def work(self, particles: int) -> Work:
        return Work(rays=self.steps * self.rays_per_step)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Adam with one rate for the grids and one for the colour network."""
        groups = [
            {"params": [self.field.density, self.field.features], "lr": self.grid_rate},
            {"params": list(self.colour.parameters()), "lr": self.network_rate},
        ]
        return torch.optim.Adam(groups, fused=True)

    def on_train_batch_start(self, batch: int, batch_idx: int) -> None:
        """Scale the voxels when it is time; Adam starts afresh."""
        if self.length.refines_before(batch):
            self.field.refine()
            self._rays_through_box.clear()
            optimiser = self.trainer.optimizers[0]
            optimiser.param_groups[0]["params"] = [self.field.density, self.field.features]
            optimiser.state.clear()

    def training_step(self, batch: int, batch_idx: int) -> Tensor:
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + batch)
        rays, measured, matte = self._draw_rays(generator)
        samples = march(self.field.grid(), rays, self.base_spacing, self.min_weight)
        terms = {
            "pixel": mse_loss(shade(samples, self.colour).colour, measured),
            "entropy": transmittance_entropy(samples.transmittance),
            "surface": surface_area(particle_alpha(self.field.grid(), generator)[1], self.field.dx),
        }
        if self.view_invariant_weight > 0:
            directions = normalize(torch.randn(len(measured), 3, generator=generator), dim=1).to(measured)
            seen = shade(samples, self.colour, directions=directions).colour
            terms["view_invariant"] = mse_loss(seen, measured)
        if self.silhouette_weight > 0:
            terms["silhouette"] = matte_cross_entropy(samples.transmittance, matte)
        weights = self.weights_at(batch)
        loss = torch.stack([weights[name] * term for name, term in terms.items()]).sum()
        self.last_psnr = psnr(terms["pixel"].item())
        if self.global_step % LOGGED_EVERY == 0:
            values: dict[str, Any] = {"loss": loss, "psnr": self.last_psnr, "spacing": self.field.dx, **terms}
            values.update({f"{name}_weight": weights[name] for name in terms})
            self.log_dict({f"static/{name}": value for name, value in values.items()})
        return loss

    def weights_at(self, step: int) -> dict[str, float]:
        """Weight of every term of the loss at a step."""
        scalings = self.length.scalings(step)
        entropy = self.entropy_weight * self.entropy_schedule.factor(step, scalings)
        return {
            "pixel": 1.0,
            "entropy": min(entropy, max(self.entropy_limit, self.entropy_weight)),
            "surface": self.surface_weight * self.surface_schedule.factor(step, scalings),
            "view_invariant": self.view_invariant_weight,
            "silhouette": self.silhouette_weight,
        }

    def export_state(self) -> ParticleState:
        """Particles sampled with the fixed seed, with the field's density and features.

        They are at rest and without physics, unless a state with both was imported. Raises UserInputError where the
        object has vanished.
        """
        self.field.check_object()
        grid = self.field.grid()
        with torch.no_grad():
            positions = sample_particles(grid, torch.Generator().manual_seed(self.seed), self.relative_alpha)
            if self.silhouette_weight > 0:
                inside = inside_mattes(positions.cpu(), self.data.video, self.data.train)
                positions = positions[confirmed(positions.cpu(), grid.dx, inside).to(positions.device)]
            density, features = interpolate(grid, positions)
        velocity = torch.zeros(3) if self.previous is None else self.previous.velocity.mean(0)
        weights = {name: value.detach().cpu().clone() for name, value in self.colour.state_dict().items()}
        state = ParticleState(
            positions=positions.cpu(),
            velocity=velocity.expand_as(positions).cpu().clone(),
            density=density.cpu(),
            features=features.cpu(),
            physics={} if self.previous is None else self.previous.physics,
            spacing=self.field.dx,
            base_spacing=self.base_spacing,
            colour_network=weights,
        )
        return state.with_(surface_offset=self._surface_offset(state)) if self.physics.mass_from == "outline" else state

    def _surface_offset(self, state: ParticleState) -> float:
        """Raw density above the visible surface's where the body is as large as in the training views' mattes."""
        video = self.data.video
        views = np.isin(np.arange(len(video.images)), self.data.train)
        first = Split(views, np.arange(len(video.times)) == 0)
        return StateProblem("", self.data, state, self.physics, first, bright=False).surface_offset

    def progress_metrics(self) -> dict[str, str]:
        return {"psnr": f"{self.last_psnr:.1f} dB", "dx": f"{self.field.dx:g} m"}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the voxel size, which the weights alone do not contain."""
        checkpoint["static_spacing"] = self.field.dx

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Give the field the shape it had before its weights are loaded."""
        saved = (checkpoint["state_dict"][f"field.{name}"] for name in ("density", "features", "lower"))
        density, features, lower = map(torch.empty_like, saved)
        self.field = VoxelField(density, features, lower, checkpoint["static_spacing"])
        self._rays_through_box.clear()

    def _draw_rays(self, generator: torch.Generator) -> tuple[Rays, Tensor, Tensor]:
        """A random batch of one view: rays, colours [(R, 3)] and object opacities [(R,)]."""
        train = self.data.train
        pick = int(torch.randint(len(train) + len(self._predicted), (1,), generator=generator))
        view = train[pick % len(train)]
        candidates = self.pixels_through_box(view)
        pixels = candidates[torch.randint(len(candidates), (self.rays_per_step,), generator=generator)]
        rays, video = self.data.first_rays(view), self.data.video
        measured_pair = video.images[view, 0], video.silhouettes[view, 0]
        image, silhouette = measured_pair if pick < len(train) else self._predicted[view]
        sources = rays.origins, rays.directions, image.flatten(0, 1), silhouette.flatten()
        origins, directions, measured, matte = (rows.index_select(0, pixels).to(self.device) for rows in sources)
        return Rays(origins, directions), measured, matte

    def _images_of(self, state: ParticleState) -> dict[int, tuple[Tensor, Tensor]]:
        """Image [(H, W, 3)] and opacity [(H, W)] of the state's particles at frame 0 in each training view."""
        renderer, (height, width) = StateRenderer(state), self.data.video.images.shape[2:4]
        field = renderer.grid(state.positions)
        return {view: renderer.image(field, self.data.first_rays(view), (height, width)) for view in self.data.train}

    def pixels_through_box(self, view: int) -> Tensor:
        """Pixels of a view whose rays meet the box and no occluder; all others are background whatever the field is."""
        if view not in self._rays_through_box:
            lower = self.field.lower.cpu()
            upper = lower + self.field.dx * (torch.tensor(self.field.density.shape) - 1)
            enter, leave = box_interval(self.data.first_rays(view), lower, upper)
            free = self.data.video.valid[view].flatten()
            self._rays_through_box[view] = ((enter < leave) & free).nonzero().squeeze(1)
        return self._rays_through_box[view]
