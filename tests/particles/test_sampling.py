"""Sampling particles from a field, and reading the field at particles."""

import pytest
import torch

from pacnerf_lpo.particles.sampling import interpolate, particle_alpha, sample_particles
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.ray_march import render_rays
from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import FieldGrid, Rays


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def half_full_grid() -> FieldGrid:
    """Ten cells of 0.1 m along each axis; density 40 for x < 0.5 m, empty beyond."""
    density = torch.full((11, 11, 11), -100.0)
    density[:6] = 40.0
    return FieldGrid(density, torch.zeros(11, 11, 11, 12), torch.zeros(3), 0.1)


def test_every_octant_of_a_full_cell_holds_one_particle():
    positions = sample_particles(half_full_grid(), seeded())
    inside = positions[positions[:, 0] < 0.5]
    octants = torch.unique((inside / 0.05).floor().long(), dim=0)
    assert len(inside) == len(octants) == 8 * 5 * 10 * 10


def test_particles_end_where_alpha_falls_below_a_thousandth():
    grid = half_full_grid()
    positions = sample_particles(grid, seeded())
    density, _ = interpolate(grid, positions)
    assert float(alpha(density, 1.0).min()) >= 1e-3
    # From density 40 at x = 0.5 m to -100 at 0.6 m: alpha is 1e-3 at density 2.3, at x = 0.527 m.
    assert 0.52 < float(positions[:, 0].max()) < 0.5270


def test_seed_decides_the_particles():
    grid = half_full_grid()
    first, second, other = (sample_particles(grid, seeded(seed)) for seed in (1, 1, 2))
    assert torch.equal(first, second)
    assert first.shape != other.shape or not torch.equal(first, other)


@pytest.mark.slow
def test_particle_alpha_is_the_alpha_of_the_interpolated_density():
    grid = half_full_grid()
    positions, opacity = particle_alpha(grid, seeded())
    expected = alpha(interpolate(grid, positions)[0], 1.0)
    torch.testing.assert_close(opacity, expected, rtol=1e-6, atol=1e-6)


def test_particles_show_what_the_grid_shows():
    """A ball survives grid -> particles -> grid but for a rim of less than one cell (nothing empty is averaged)."""
    axis = torch.arange(15) - 7.0
    distance = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).norm(dim=0)
    grid = FieldGrid(30 * (5 - distance), torch.zeros(15, 15, 15, 12), torch.zeros(3), 0.1)
    positions = sample_particles(grid, seeded())
    again = particles_to_grid(positions, *interpolate(grid, positions), 0.1)
    across = torch.linspace(0, 1.4, 41)
    origins = torch.stack((across, torch.full_like(across, 0.7), torch.full_like(across, 3.0)), dim=1)
    rays, colour = Rays(origins, torch.tensor([0.0, 0.0, -1.0]).expand(41, 3)), ColourNetwork()
    one, two = (1 - render_rays(field, colour, rays, 0.1).transmittance for field in (grid, again))
    width = across[1] - across[0]
    diameters = [float((opacity > 0.5).sum() * width) for opacity in (one, two)]
    assert 0.8 < diameters[0] < diameters[1] < diameters[0] + 2 * 0.1
