"""Surfaces that pull themselves together."""

from types import SimpleNamespace

import torch
from torch import Tensor

from pacnerf_lpo.mpm.differentiation import sqrt, where
from pacnerf_lpo.mpm.effects.base import LawEffect
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Law, Point
from pacnerf_lpo.mpm.tensors import AXES, add_isotropic, added, cofactor, determinant, dot, scaled
from pacnerf_lpo.scene.trilinear import gather, scatter, stencil

WIDTH = 1.5
"""Node spacing of the indicator, in grid spacings."""
FULL = 0.95
"""Volume fraction from which on a place is inside; below 1, so that the noise of the sampling makes no surface."""


class SurfaceTension(LawEffect):
    """Interfacial energy gamma |grad phi| per volume, phi the body's indicator: tau += gamma J (|g| I - g gᵀ / |g|),
    the continuum surface stress (Lafaurie et al. 1994) in a form that needs one particle only.

    Each particle keeps g = grad phi, which the motion transports: g <- (I + dt C)^-T g, the gradient of a field that
    moves with the body. So neither the deformation gradient nor the grid is asked, and fluids can have it; but two
    surfaces that meet do not merge.

    Args:
        surface_tension: gamma [N/m].
    """

    history = 3
    parameters = named(Parameter("surface_tension", "N/m", Identity(), (-1e4, 1e4), "surface tension", scale=1.0))
    signature = "corners round off, and what was spread out draws back"
    confused_with = ("Cohesion", "KelvinVoigt")
    separating_experiment = "a smaller body of the same shape, which surface tension rounds faster"
    one_sided = True
    probes = ({"surface_tension": 2.0}, {"surface_tension": 20.0})

    @classmethod
    def initial_history(cls, positions: Tensor, mass: Tensor, dx: float) -> Tensor:
        """grad phi at frame 0 [1/m, (N, 3)], phi from the volume fraction on a grid of 1.5 dx, read at the particles.

        No particle lies outside the body, where half of the smooth surface is; so the sum over the particles of volume
        times |grad phi| is brought to the area of the surface, which is the sum over the nodes.
        """
        opacity = (mass / mass.median()).clamp_max(1.0)
        spacing, volume = WIDTH * dx, (dx / 2) ** 3 * opacity
        first = torch.floor(positions.detach().amin(0) / spacing).long() - 2
        x, y, z = (torch.floor(positions.detach().amax(0) / spacing).long() + 4 - first).tolist()
        points = stencil(positions, first.to(positions) * spacing, spacing, (x, y, z))
        fraction = scatter((volume / spacing**3)[:, None], points).view(x, y, z)
        level = (fraction / FULL).clamp_max(1.0)
        phi = level * level * (3.0 - 2.0 * level)
        gradient = torch.stack([(phi.roll(-1, a) - phi.roll(1, a)) / (2 * spacing) for a in AXES], -1)
        seen = gather(gradient.reshape(-1, 3), points) * opacity[:, None]
        return seen * (spacing**3 * gradient.norm(dim=-1).sum() / (volume * seen.norm(dim=-1)).sum())

    @staticmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        F, tau = inner(point, c)
        step = add_isotropic(scaled(point.C, point.dt), 1.0)
        turned, grown = cofactor(step), determinant(step)
        g = [sum((turned[i][j] * point.history[j] for j in AXES), 0.0) / grown for i in AXES]
        length = sqrt(dot(g, g))
        strength = c.surface_tension * determinant(point.F)
        scale = strength / where(length > 0.0, length, 1.0)
        pull = [[(strength * length if i == j else 0.0) - scale * g[i] * g[j] for j in AXES] for i in AXES]
        return F, added(tau, pull), g
