"""+GO: correct the Eulerian grid of frame 0 by the whole video, as LPO corrects particles (LPO paper, section 4)."""

from typing import Any

import torch
from torch import Tensor, nn

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.particles.inverse import grid_of_particles
from pacnerf_lpo.particles.sampling import RELATIVE_ALPHA, interpolate, sample_particles
from pacnerf_lpo.phases.dynamic import Correction
from pacnerf_lpo.phases.schedules import check_warm_up, rising_adam
from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.scene.voxel_field import OBJECT_ALPHA
from pacnerf_lpo.types import FieldGrid, ParticleState


class GridOptimizationModule(Correction):
    """Optimises density and features of a grid while physics, velocity and colour network stay frozen.

    Every step samples particles from the grid anew; the gradient reaches the grid through the interpolation of density
    and features, not through the positions. The grid comes from the imported particles, and particles sampled from it
    with the fixed seed are exported.

    Args:
        iterations: Adam steps.
        density_drives_mass: let the gradient of the density flow through alpha into mass and stiffness too.
        feature_rate: Adam rate of density and features.
        relative_alpha: particles are kept whose alpha is at least this fraction of the largest.
        silhouette_weight: see :class:`~pacnerf_lpo.phases.dynamic.DynamicPhase`.
        warm_up: part of the iterations over which the rates rise linearly to their values (0 in the paper).
        seed: seed of the exported particles and of the random choice of views.
    """

    lower: Tensor

    def __init__(
        self,
        iterations: int = 100,
        density_drives_mass: bool = True,
        feature_rate: float = 0.1,
        relative_alpha: float = RELATIVE_ALPHA,
        silhouette_weight: float = 0.0,
        warm_up: float = 0.0,
        seed: int = 0,
    ):
        super().__init__(iterations, silhouette_weight, seed)
        self.warm_up = check_warm_up(warm_up)
        self.density_drives_mass, self.feature_rate = density_drives_mass, feature_rate
        self.relative_alpha = relative_alpha

    def begin(self) -> None:
        grid = grid_of_particles(self.state.positions, self.state.density, self.state.features, self.state.spacing)
        self.density, self.features = nn.Parameter(grid.density), nn.Parameter(grid.features)
        self.register_buffer("lower", grid.lower)

    def configure_optimizers(self) -> Any:
        groups = [{"params": [self.density, self.features], "lr": self.feature_rate}]
        return rising_adam(groups, self.steps, self.warm_up)

    def training_step(self, step: int, _: int) -> Tensor:
        """Cost over all frames of freshly sampled particles, one random training view for each frame."""
        particles = self.particles(torch.Generator().manual_seed(self.seed * 1_000_003 + step))
        self.log("correction/particles", float(len(particles[0])))
        return self.loss(step, self.state.velocity.mean(0), *particles)

    def particles(self, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Positions [m, (N, 3)]; density (N,), features (N, 12), differentiable. UserInputError: the body is gone."""
        if not float(alpha(self.density.detach().max(), 1.0)) >= OBJECT_ALPHA:
            raise UserInputError("grid optimisation: the body has vanished; lower phases.correction.feature_rate")
        grid = FieldGrid(self.density, self.features, self.lower, self.state.spacing)
        positions = sample_particles(grid, generator, self.relative_alpha).detach()
        return positions, *interpolate(grid, positions)

    @torch.no_grad()
    def export_state(self) -> ParticleState:
        """The state with particles sampled from the trained grid."""
        positions, density, features = self.particles(torch.Generator().manual_seed(self.seed))
        velocity = self.state.velocity.mean(0).expand_as(positions).clone()
        found = {"positions": positions.cpu(), "density": density.cpu(), "features": features.cpu()}
        return self.state.with_(velocity=velocity, corrected=True, **found)
