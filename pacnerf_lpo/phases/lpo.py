"""Lagrangian Particle Optimization: correct frame-0 positions and features by the whole video (Algorithm 1, step 3)."""

import math
from typing import Any

import torch
from torch import Tensor, nn

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.phases.dynamic import Correction
from pacnerf_lpo.phases.identification_methods import finite_loss
from pacnerf_lpo.phases.schedules import check_warm_up, rising_adam
from pacnerf_lpo.types import ParticleState

PARTICLES = ("positions", "density", "features")


class LPOModule(Correction):
    """Optimises particles while physics, velocity and colour network stay frozen (supplement E.3).

    +LPO moves both; +LPO-F only the features (raw density and colour features), +LPO-P only the positions.

    A step can tear a thin part off the body. So the particles with the lowest loss are remembered, and at the end they
    and the last ones are compared in the same images, one for each frame; those that fit better are exported.

    Args:
        iterations: Adam steps.
        positions: optimise frame-0 positions.
        features: optimise raw density and features.
        density_drives_mass: let the gradient of the density flow through alpha into mass and stiffness too.
        position_rate: Adam rate of the positions, in units of the coarsest grid spacing dx0.
        feature_rate: Adam rate of density and features.
        silhouette_weight: see :class:`~pacnerf_lpo.phases.dynamic.DynamicPhase`.
        warm_up: part of the iterations over which the rates rise linearly to their values (0 in the paper).
    """

    best_loss: Tensor

    def __init__(
        self,
        iterations: int = 100,
        positions: bool = True,
        features: bool = True,
        density_drives_mass: bool = True,
        position_rate: float = 1 / 32,
        feature_rate: float = 0.1,
        silhouette_weight: float = 0.0,
        warm_up: float = 0.0,
    ):
        super().__init__(iterations, silhouette_weight)
        if not (positions or features):
            raise UserInputError(
                "phases.correction: positions and features are both false, so nothing would be corrected; "
                "set one of them, or set the whole phase to null (+None)"
            )
        self.corrects_positions, self.corrects_features = positions, features
        self.density_drives_mass = density_drives_mass
        self.position_rate, self.feature_rate = position_rate, feature_rate
        self.warm_up = check_warm_up(warm_up)

    def begin(self) -> None:
        self.positions = nn.Parameter(self.state.positions.clone(), requires_grad=self.corrects_positions)
        self.density = nn.Parameter(self.state.density.clone(), requires_grad=self.corrects_features)
        self.features = nn.Parameter(self.state.features.clone(), requires_grad=self.corrects_features)
        for name in PARTICLES:
            self.register_buffer(f"best_{name}", getattr(self, name).detach().clone())
        self.register_buffer("best_loss", torch.tensor(math.inf))

    def configure_optimizers(self) -> Any:
        """Adam with one group for positions and one for density and features."""
        groups = []
        if self.corrects_positions:
            groups.append({"params": [self.positions], "lr": self.position_rate * self.state.base_spacing})
        if self.corrects_features:
            groups.append({"params": [self.density, self.features], "lr": self.feature_rate})
        return rising_adam(groups, self.steps, self.warm_up)

    def training_step(self, step: int, _: int) -> Tensor:
        """Cost over all frames, one random training view for each."""
        loss = self.loss(step, self.state.velocity, self.positions, self.density, self.features)
        if loss < self.best_loss:
            self.best_loss.copy_(loss.detach())
            for name in PARTICLES:
                getattr(self, f"best_{name}").copy_(getattr(self, name).detach())
        self.log("correction/mean displacement [m]", self.moved)
        return loss

    @property
    def moved(self) -> Tensor:
        """Mean displacement of the particles so far [m, scalar]."""
        return (self.positions.detach() - self.state.positions).norm(dim=-1).mean()

    @torch.no_grad()
    def export_state(self) -> ParticleState:
        """The state with the last particles, or the remembered ones where these fit better."""
        last, best = ({name: getattr(self, prefix + name) for name in PARTICLES} for prefix in ("", "best_"))
        cost = lambda particles: self.loss(self.steps, self.state.velocity, **particles).item()  # noqa: E731
        chosen = min(last, best, key=lambda particles: finite_loss(lambda: cost(particles)))
        found = {name: values.detach().cpu().clone() for name, values in chosen.items()}
        return self.state.with_(**found, corrected=True)

    def progress_metrics(self) -> dict[str, str]:
        return {"moved": f"{1000 * self.moved.item():.2f} mm"}
