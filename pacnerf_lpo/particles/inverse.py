"""Particles to grid the other way round: node values whose interpolation at the particles gives their values back."""

import torch
from torch import Tensor

from pacnerf_lpo.particles.transfer import EMPTY_WEIGHT, particles_to_grid
from pacnerf_lpo.scene.trilinear import Stencil, gather, scatter, stencil
from pacnerf_lpo.types import FieldGrid

ITERATIONS = 30
RIM_WEIGHT = 4.0  # half of the sum of weights at a node inside, where there are eight particles in each cell


@torch.no_grad()
def grid_of_particles(positions: Tensor, density: Tensor, features: Tensor, dx: float) -> FieldGrid:
    """The field from which particles with these values could have been sampled; arguments as of
    :func:`particles_to_grid`.

    Averaging particles on nodes (:func:`particles_to_grid`) spreads a field by up to a cell; sampled again it would be
    thicker. Here the nodes minimise the squared difference between their interpolation and the particles' values, by
    conjugate gradients from the average. At the rim, where a node is known by extrapolation only, its density is at
    most the average, and its features stay in the particles' range. Nodes that no particle touches are empty.
    """
    mean = particles_to_grid(positions, density, features, dx)
    points = stencil(positions, mean.lower, dx, mean.shape)
    weight = scatter(torch.ones_like(density)[:, None], points)
    average = torch.cat((mean.density[..., None], mean.features), dim=-1).flatten(0, 2)
    start = torch.where(weight > EMPTY_WEIGHT, average, 0)
    nodes = _least_squares(points, torch.cat((density[:, None], features), dim=1), start)
    raw, rim = nodes[:, 0], weight[:, 0] < RIM_WEIGHT
    raw = torch.where(rim, torch.minimum(raw, average[:, 0]), raw)
    colour = torch.where(rim[:, None], nodes[:, 1:].clamp(features.amin(0), features.amax(0)), nodes[:, 1:])
    return FieldGrid(raw.view(mean.shape), colour.view(*mean.shape, -1), mean.lower, dx)


def _least_squares(points: Stencil, values: Tensor, nodes: Tensor) -> Tensor:
    """Nodes (X*Y*Z, C) with gather(nodes) close to ``values`` (M, C): conjugate gradients on the normal equations."""
    residual = scatter(values - gather(nodes, points), points)
    direction, size = residual, residual.square().sum(0)
    for _ in range(ITERATIONS):
        image = gather(direction, points)
        step = size / image.square().sum(0).clamp_min(torch.finfo(size.dtype).tiny)
        nodes = nodes + step * direction
        residual = residual - step * scatter(image, points)
        before, size = size, residual.square().sum(0)
        direction = residual + size / before.clamp_min(torch.finfo(size.dtype).tiny) * direction
    return nodes
