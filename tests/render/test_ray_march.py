"""Ray marching against closed forms, a slow reference and finite differences."""

import math

import pytest
import torch
from torch.nn.functional import normalize, softplus

from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render import ray_march
from pacnerf_lpo.render.image import render_view
from pacnerf_lpo.render.ray_march import march, render_rays, shade
from pacnerf_lpo.scene.activation import DENSITY_SHIFT
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import FieldGrid, Rays
from tests.render import reference

F64 = torch.float64


def blob(seed: int = 0, nodes: int = 7, dx: float = 0.1) -> FieldGrid:
    """A noisy ball that is empty (-100) in the outer layers, in float64."""
    generator = torch.Generator().manual_seed(seed)
    axis = torch.arange(nodes, dtype=F64) - (nodes - 1) / 2
    distance = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).norm(dim=0)
    density = 30 + 10 * torch.randn(nodes, nodes, nodes, dtype=F64, generator=generator)
    features = torch.randn(nodes, nodes, nodes, 12, dtype=F64, generator=generator)
    return FieldGrid(torch.where(distance < nodes / 3, density, -100.0), features, torch.zeros(3, dtype=F64), dx)


def rays_towards(target: float, count: int, spread: float = 0.1, seed: int = 0) -> Rays:
    """Rays from about (0.9, 1.1, 1.5) m to points near (target, target, target)."""
    generator = torch.Generator().manual_seed(seed)
    origins = torch.tensor([0.9, 1.1, 1.5], dtype=F64).expand(count, 3).contiguous()
    ends = target + spread * torch.randn(count, 3, dtype=F64, generator=generator)
    return Rays(origins, normalize(ends - origins, dim=1))


@pytest.fixture
def colour() -> ColourNetwork:
    """A network with fixed weights in float64."""
    torch.manual_seed(0)
    return ColourNetwork().double()


@pytest.mark.parametrize("dx", [0.1, 0.05])
def test_transmittance_through_a_uniform_slab(dx, colour):
    """T = exp(-softplus(sigma + b) 0.05 L / (dx0 / 2)), whatever dx, up to the depth of one sample at the far face."""
    sigma, length, base_dx = 14.0, 0.4, 0.1
    nodes = round(length / dx) + 1
    grid = FieldGrid(
        torch.full((nodes,) * 3, sigma, dtype=F64),
        torch.zeros(nodes, nodes, nodes, 12, dtype=F64),
        torch.zeros(3, dtype=F64),
        dx,
    )
    rays = Rays(torch.tensor([[0.17, 0.23, 2.0]], dtype=F64), torch.tensor([[0.0, 0.0, -1.0]], dtype=F64))
    transmittance = float(render_rays(grid, colour, rays, base_dx).transmittance)
    attenuation = float(softplus(torch.tensor(sigma + DENSITY_SHIFT))) * 0.05 / (base_dx / 2)
    assert math.isclose(-math.log(transmittance), attenuation * length, abs_tol=1.001 * attenuation * dx / 2)


def test_fast_march_equals_the_slow_one(colour):
    """Occupancy skipping and thresholds drop only samples of alpha or weight below 1e-7."""
    grid, rays = blob(), rays_towards(0.3, 40, spread=0.2)
    fast = render_rays(grid, colour, rays, 0.2)
    slow_colour, slow_transmittance = reference.render(grid, colour, rays, 0.2)
    assert 0.01 < float(slow_transmittance.min()) < 0.9
    tolerance = 30 * 1e-7  # at most 30 samples lie on a ray
    torch.testing.assert_close(fast.transmittance, slow_transmittance, rtol=0, atol=tolerance)
    torch.testing.assert_close(fast.colour, slow_colour, rtol=0, atol=tolerance)


def test_skipping_leaves_few_samples(colour):
    """Empty cells are not sampled: all samples of a blob in a wide empty grid lie in its own cells."""
    grid = blob()
    padded = FieldGrid(
        torch.full((27, 27, 27), -100.0, dtype=F64), torch.zeros(27, 27, 27, 12, dtype=F64), grid.lower - 1.0, 0.1
    )
    padded.density[10:17, 10:17, 10:17], padded.features[10:17, 10:17, 10:17] = grid.density, grid.features
    rays = rays_towards(0.3, 40)
    assert len(march(padded, rays, 0.2).weights) <= 1.1 * len(march(grid, rays, 0.2).weights)


def test_gradients_of_the_march(colour):
    """Density and features against float64 central differences along random directions."""
    grid, rays = blob(nodes=3), rays_towards(0.1, 4, spread=0.03)
    density = torch.where(grid.density > 0, grid.density - 18, 1.0).requires_grad_()
    features = grid.features.clone().requires_grad_()

    def function(d: torch.Tensor, f: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        image = render_rays(FieldGrid(d, f, grid.lower, grid.dx), colour, rays, 0.2)
        return image.colour, image.transmittance

    assert torch.autograd.gradcheck(function, (density, features), fast_mode=True)


@pytest.mark.parametrize("name", ["first.weight", "first.bias", "second.weight", "last.bias"])
def test_network_gradient(colour, name):
    """One direction in the space of weights against a central difference; rounding is 1e-15 / 1e-7 of a value near 10.

    The step is small because a ReLU that changes sign within it spoils the difference.
    """
    grid, rays, weight = blob(), rays_towards(0.3, 6), colour.get_parameter(name)
    direction = torch.randn(weight.shape, dtype=F64, generator=torch.Generator().manual_seed(0))

    def brightness(shift: float) -> torch.Tensor:
        weight.data += shift * direction
        value = render_rays(grid, colour, rays, 0.2).colour.square().sum()
        weight.data -= shift * direction
        return value

    (gradient,) = torch.autograd.grad(brightness(0.0), weight)
    difference = float((brightness(1e-7) - brightness(-1e-7)).detach()) / 2e-7
    assert abs(difference) > 1e-3
    assert math.isclose(float((gradient * direction).sum()), difference, abs_tol=1e-7)


def test_gradient_through_particles(colour):
    """Image to particle positions, density and features, the whole chain of the dynamic phases."""
    generator = torch.Generator().manual_seed(3)
    positions = (0.25 * torch.rand(6, 3, dtype=F64, generator=generator)).requires_grad_()
    density = (12 + torch.randn(6, dtype=F64, generator=generator)).requires_grad_()
    features = torch.randn(6, 12, dtype=F64, generator=generator).requires_grad_()
    rays = rays_towards(0.12, 5, spread=0.05)

    def function(p: torch.Tensor, d: torch.Tensor, f: torch.Tensor) -> torch.Tensor:
        return render_rays(particles_to_grid(p, d, f, 0.1), colour, rays, 0.2).colour

    assert torch.autograd.gradcheck(function, (positions, density, features), fast_mode=True)


def test_rays_that_miss_are_white(colour):
    rays = Rays(torch.tensor([[5.0, 5.0, 5.0]], dtype=F64), torch.tensor([[0.0, 1.0, 0.0]], dtype=F64))
    image = render_rays(blob(), colour, rays, 0.2)
    assert image.colour.tolist() == [[1.0] * 3]
    assert image.transmittance.tolist() == [1.0]


def test_near_plane(colour):
    """A camera inside the object sees nothing closer than 0.1 m."""
    grid = FieldGrid(
        torch.full((3, 3, 3), 50.0, dtype=F64), torch.zeros(3, 3, 3, 12, dtype=F64), torch.zeros(3, dtype=F64), 0.1
    )
    up = torch.tensor([[0.0, 1.0, 0.0]], dtype=F64)
    inside = Rays(torch.tensor([[0.1, 0.15, 0.1]], dtype=F64), up)
    assert float(render_rays(grid, colour, inside, 0.1).transmittance) == 1.0


def test_given_directions_change_colour_but_not_transmittance(colour):
    grid, rays = blob(), rays_towards(0.3, 10)
    own, other = (
        render_rays(grid, colour, rays, 0.2),
        shade(march(grid, rays, 0.2), colour, directions=-rays.directions),
    )
    torch.testing.assert_close(own.transmittance, other.transmittance, rtol=0, atol=0)
    assert not torch.allclose(own.colour, other.colour, atol=1e-4)
    same = shade(march(grid, rays, 0.2), colour, directions=rays.directions)
    torch.testing.assert_close(own.colour, same.colour, rtol=0, atol=0)


def test_a_whole_view_agrees_with_its_rays(colour):
    generator = torch.Generator().manual_seed(0)
    positions = 0.3 * torch.rand(200, 3, dtype=F64, generator=generator)
    density, features = torch.full((200,), 30.0, dtype=F64), torch.zeros(200, 12, dtype=F64)
    grid, rays = particles_to_grid(positions, density, features, 0.1), rays_towards(0.15, 12)
    image, opacity = render_view(grid, colour, rays, (3, 4), 0.2)
    expected = render_rays(grid, colour, rays, 0.2)
    assert float(opacity.max()) > 0.5
    torch.testing.assert_close(image.flatten(0, 1), expected.colour.detach(), rtol=0, atol=0)
    torch.testing.assert_close(opacity.flatten(), 1 - expected.transmittance.detach(), rtol=0, atol=0)


def test_uncoloured_samples_still_attenuate(colour):
    grid, rays = blob(), rays_towards(0.3, 20)
    fine, coarse = render_rays(grid, colour, rays, 0.2), render_rays(grid, colour, rays, 0.2, min_weight=1e-3)
    torch.testing.assert_close(fine.transmittance, coarse.transmittance, rtol=0, atol=0)
    torch.testing.assert_close(fine.colour, coarse.colour, rtol=0, atol=30 * 1e-3)


@pytest.mark.parametrize("block", [1, 7, 50])
def test_samples_coloured_in_blocks(colour, monkeypatch, block):
    """Blocks of whole rays give the image and the gradients of all samples at once, rays that miss among them."""
    grid, rays = blob(), rays_towards(0.3, 200, spread=0.5)
    grid = FieldGrid(grid.density.requires_grad_(), grid.features.requires_grad_(), grid.lower, grid.dx)

    def image_and_gradients() -> list[torch.Tensor]:
        image = render_rays(grid, colour, rays, 0.2).colour
        return [image, *torch.autograd.grad(image.square().sum(), [grid.density, grid.features, *colour.parameters()])]

    lengths = march(grid, rays, 0.2).lengths
    assert (lengths == 0).any() and lengths.max() < 50 < lengths.sum()
    at_once = image_and_gradients()
    monkeypatch.setattr(ray_march, "BLOCK", block)
    for found, expected in zip(image_and_gradients(), at_once, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-9, atol=1e-12)
