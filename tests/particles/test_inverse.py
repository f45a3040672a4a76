"""A field that became particles comes back as a field."""

from __future__ import annotations

import torch

from pacnerf_lpo.particles.inverse import grid_of_particles
from pacnerf_lpo.particles.sampling import interpolate, sample_particles
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.types import FieldGrid

DX = 0.04


def ball() -> FieldGrid:
    """Raw density that crosses zero at 0.2 m from the origin, steeply; features vary over the ball."""
    axis = torch.arange(-8, 9) * DX
    nodes = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), dim=-1)
    features = torch.sin(nodes @ torch.randn(3, 12, generator=torch.Generator().manual_seed(0)) * 8)
    return FieldGrid(30 * (0.2 - nodes.norm(dim=-1)) / DX, features, nodes[0, 0, 0], DX)


def matter(grid: FieldGrid, seed: int) -> float:
    """Sum of alpha over particles sampled from the field."""
    positions = sample_particles(grid, torch.Generator().manual_seed(seed))
    return alpha(interpolate(grid, positions)[0], 1.0).sum().item()


def test_resampling_keeps_the_body():
    """As much matter as in other samples of the original field, where the average over particles adds a third."""
    original = ball()
    samples = torch.tensor([matter(original, seed) for seed in range(8)])
    positions = sample_particles(original, torch.Generator().manual_seed(0))
    values = interpolate(original, positions)
    again = matter(grid_of_particles(positions, *values, DX), seed=8)
    assert abs(again - samples.mean()) < 0.01 * samples.mean()
    assert samples.std() < 0.005 * samples.mean(), "sampling itself must not blur the comparison"
    assert matter(particles_to_grid(positions, *values, DX), seed=8) > 1.2 * samples.mean()


def test_a_block_with_a_sharp_rim_does_not_grow():
    """Extrapolated from the faint layer along an edge, nodes outside would be dense."""
    lattice = torch.cartesian_prod(*[torch.arange(10) + 0.5] * 3)
    depth = torch.minimum(lattice, 10 - lattice).amin(1)
    positions, density = (lattice - 5) * DX / 2, 60 * (depth - 1.5).clamp(-1, 1)
    grid = grid_of_particles(positions, density, torch.zeros(1000, 12), DX)
    found = sample_particles(grid, torch.Generator().manual_seed(0))
    assert found.abs().max() <= positions.abs().max()
    matter = alpha(interpolate(grid, found)[0], 1.0).sum()
    # alpha saturates 3.35 particle distances from the centre; faces may move by half a distance, a quarter cell
    assert 5.7**3 < matter < 7.7**3


def test_values_at_the_particles_come_back():
    """Inside, where eight particles a cell determine the nodes; smooth features need few iterations."""
    original = ball()
    positions = sample_particles(original, torch.Generator().manual_seed(0))
    density, features = interpolate(original, positions)
    inner = positions.norm(dim=1) < 0.14
    found = interpolate(grid_of_particles(positions, density, features, DX), positions)
    assert (found[0] - density)[inner].abs().max() < 0.01 * density.abs().max()
    assert (found[1] - features)[inner].abs().max() < 0.01 * features.abs().max()
