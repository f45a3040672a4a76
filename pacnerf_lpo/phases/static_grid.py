"""Phase 1: a voxel radiance field of frame 0, fitted to the training views, becomes particles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn.functional import normalize

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.losses.image import psnr, squared_error
from pacnerf_lpo.losses.regularisers import surface_area, transmittance_entropy
from pacnerf_lpo.particles.sampling import interpolate, particle_alpha, sample_particles
from pacnerf_lpo.phases.base import AbstractPhase, StepNumbers
from pacnerf_lpo.phases.schedules import TrainingLength, WeightSchedule
from pacnerf_lpo.render.ray_march import MIN_WEIGHT, box_interval, march, shade
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.scene.voxel_field import VoxelField
from pacnerf_lpo.types import ParticleState, Rays

if TYPE_CHECKING:
    from pacnerf_lpo.data.video_module import VideoData


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
        entropy_limit: largest weight of the transmittance entropy.
        rays_per_step: rays in a batch.
        grid_rate: Adam rate of density and features.
        network_rate: Adam rate of the colour network.
        min_weight: samples that would add less to their ray are not coloured (1e-7 in PAC-NeRF).
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
        entropy_limit: float = 0.1,
        rays_per_step: int = 1024,
        grid_rate: float = 0.1,
        network_rate: float = 1e-3,
        min_weight: float = MIN_WEIGHT,
        seed: int = 0,
    ):
        super().__init__()
        if base_spacing <= 0:
            raise UserInputError(f"phases.static.base_spacing = {base_spacing:g} m must be positive")
        self.base_spacing, self.rays_per_step, self.min_weight, self.seed = (
            base_spacing,
            rays_per_step,
            min_weight,
            seed,
        )
        self.entropy_weight, self.entropy_schedule = entropy_weight, entropy_schedule
        self.surface_weight, self.surface_schedule = surface_weight, surface_schedule
        self.entropy_limit, self.view_invariant_weight = entropy_limit, view_invariant_weight
        self.length, self.grid_rate, self.network_rate = length, grid_rate, network_rate
        self.last_psnr = float("nan")

    def import_state(self, state: ParticleState | None) -> None:
        """Start from an empty field in the video's box; the static phase is the first and takes no state."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.seed)
            self.colour = ColourNetwork()
        self.field = VoxelField.create(self.data.box, self.base_spacing)
        self._rays_through_box: dict[int, Tensor] = {}

    def batches(self, data: VideoData) -> Iterable:
        """The step numbers; each step draws its own view and rays."""
        return StepNumbers(self.length.steps, lambda: self.global_step)

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
        """The loss of one step."""
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + batch)
        rays, measured = self._draw_rays(generator)
        samples = march(self.field.grid(), rays, self.base_spacing, self.min_weight)
        pixel = squared_error(shade(samples, self.colour).colour, measured)
        entropy = transmittance_entropy(samples.transmittance)
        surface = self._surface(generator)
        scalings = self.length.scalings(batch)
        entropy_weight = self.entropy_weight * self.entropy_schedule.factor(batch, scalings)
        entropy_weight = max(self.entropy_weight, min(entropy_weight, self.entropy_limit))
        surface_weight = self.surface_weight * self.surface_schedule.factor(batch, scalings)
        loss = pixel + entropy_weight * entropy + surface_weight * surface
        if self.view_invariant_weight > 0:
            directions = normalize(torch.randn(len(measured), 3, generator=generator), dim=1).to(measured)
            view_invariant = squared_error(shade(samples, self.colour, directions=directions).colour, measured)
            loss = loss + self.view_invariant_weight * view_invariant
            self.log("static/view_invariant", view_invariant)
        self.last_psnr = psnr(pixel.item())
        self.log_dict(
            {
                "static/loss": loss,
                "static/pixel": pixel,
                "static/psnr": self.last_psnr,
                "static/entropy": entropy,
                "static/surface_area": surface,
                "static/entropy_weight": entropy_weight,
                "static/surface_weight": surface_weight,
                "static/spacing": self.field.dx,
            }
        )
        return loss

    def export_state(self) -> ParticleState:
        """Particles sampled with the fixed seed, at rest, with the field's density and features and no physics.

        Raises:
            UserInputError: the object has vanished.
        """
        self.field.check_object()
        grid = self.field.grid()
        with torch.no_grad():
            positions = sample_particles(grid, torch.Generator().manual_seed(self.seed))
            density, features = interpolate(grid, positions)
        weights = {name: value.detach().cpu().clone() for name, value in self.colour.state_dict().items()}
        return ParticleState(
            positions=positions.cpu(),
            velocity=torch.zeros(positions.shape),
            density=density.cpu(),
            features=features.cpu(),
            physics={},
            spacing=self.field.dx,
            base_spacing=self.base_spacing,
            colour_network=weights,
        )

    def progress_metrics(self) -> dict[str, str]:
        """Batch PSNR and voxel size."""
        return {"psnr": f"{self.last_psnr:.1f} dB", "dx": f"{self.field.dx:g} m"}

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the voxel size, which the weights alone do not tell."""
        checkpoint["static_spacing"] = self.field.dx

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Give the field the shape it had before its weights are loaded."""
        saved = checkpoint["state_dict"]
        names = ("field.density", "field.features", "field.lower")
        density, features, lower = (torch.empty_like(saved[name]) for name in names)
        self.field = VoxelField(density, features, lower, checkpoint["static_spacing"], self.base_spacing)
        self._rays_through_box.clear()

    def _draw_rays(self, generator: torch.Generator) -> tuple[Rays, Tensor]:
        view = self.data.train[int(torch.randint(len(self.data.train), (1,), generator=generator))]
        candidates = self._candidates(view)
        pixels = candidates[torch.randint(len(candidates), (self.rays_per_step,), generator=generator)]
        rays, colours = self.data.rays(view), self.data.video.images[view, 0].flatten(0, 1)
        chosen = (source.index_select(0, pixels).to(self.device) for source in (rays.origins, rays.directions, colours))
        origins, directions, measured = chosen
        return Rays(origins, directions), measured

    def _candidates(self, view: int) -> Tensor:
        """Pixels of a view whose rays meet the box and no occluder; all others are background whatever the field is."""
        if view not in self._rays_through_box:
            lower = self.field.lower.cpu()
            upper = lower + self.field.dx * (torch.tensor(self.field.density.shape) - 1)
            enter, leave = box_interval(self.data.rays(view), lower, upper)
            free = self.data.video.valid[view].flatten()
            self._rays_through_box[view] = ((enter < leave) & free).nonzero().squeeze(1)
        return self._rays_through_box[view]

    def _surface(self, generator: torch.Generator) -> Tensor:
        """The surface regulariser over freshly jittered particles."""
        opacity = particle_alpha(self.field.grid(), generator)[1]
        return surface_area(opacity, self.field.dx)
