"""Particles to grid."""

import pytest
import torch

from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.scene.activation import EMPTY_DENSITY

F64 = torch.float64


def cloud(count: int = 300) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    positions = torch.rand(count, 3, dtype=F64, generator=generator) * torch.tensor([0.5, 0.3, 0.4]) - 0.2
    return (
        positions,
        torch.randn(count, dtype=F64, generator=generator),
        torch.randn(count, 12, dtype=F64, generator=generator),
    )


def test_constant_fields_stay_constant():
    positions, _, _ = cloud()
    grid = particles_to_grid(positions, torch.full((300,), 7.0, dtype=F64), torch.full((300, 12), -2.0, dtype=F64), 0.1)
    occupied = grid.density > EMPTY_DENSITY
    assert 0.3 < occupied.double().mean() < 1
    torch.testing.assert_close(grid.density[occupied], torch.full_like(grid.density[occupied], 7.0), rtol=1e-12, atol=0)
    torch.testing.assert_close(
        grid.features[occupied], torch.full_like(grid.features[occupied], -2.0), rtol=1e-12, atol=0
    )


def test_empty_nodes():
    """Nodes no particle touches have raw density -100 and no features; a layer of them surrounds the particles."""
    positions, density, features = cloud()
    grid = particles_to_grid(positions, density, features, 0.1)
    empty = grid.density == EMPTY_DENSITY
    assert bool(empty[0].all() and empty[-1].all() and empty[:, 0].all() and empty[:, :, -1].all())
    assert grid.features[empty].abs().max() == 0


def test_weighted_mean_written_out():
    """Against the definition, node by node."""
    positions, density, features = cloud(40)
    grid = particles_to_grid(positions, density, features, 0.1)
    for node in torch.nonzero(grid.density > EMPTY_DENSITY):
        weight = (1 - ((positions - grid.lower) / 0.1 - node).abs()).clamp_min(0).prod(dim=1)
        expected = (weight @ density) / weight.sum()
        torch.testing.assert_close(grid.density[tuple(node)], expected, rtol=1e-9, atol=1e-9)
        torch.testing.assert_close(grid.features[tuple(node)], weight @ features / weight.sum(), rtol=1e-9, atol=1e-9)


def test_moving_by_whole_cells_moves_the_grid():
    """The nodes are multiples of dx, so a shift by whole cells changes only where the grid starts."""
    positions, density, features = cloud()
    first = particles_to_grid(positions, density, features, 0.125)
    second = particles_to_grid(positions + 0.25, density, features, 0.125)
    torch.testing.assert_close(second.density, first.density, rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(second.lower, first.lower + 0.25, rtol=0, atol=1e-15)


def test_gradients_against_finite_differences():
    positions, density, features = (tensor.requires_grad_() for tensor in cloud(6))

    def function(p: torch.Tensor, d: torch.Tensor, f: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        grid = particles_to_grid(p, d, f, 0.1)
        return grid.density.clamp_min(-99), grid.features

    assert torch.autograd.gradcheck(function, (positions, density, features), fast_mode=True)


def test_nan_positions_are_named():
    positions, density, features = cloud()
    positions[3, 1] = float("nan")
    with pytest.raises(FloatingPointError, match="positions"):
        particles_to_grid(positions, density, features, 0.1)
