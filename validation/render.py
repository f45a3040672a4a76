"""Cost of rendering a particle set, as ratios within one run: `python validation/render.py [--threads 2 --pixels 128]`.

A ball of 0.2 m radius at dx 0.04 m (about 4000 particles), seen by one camera that it fills to a fifteenth.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import torch
from torch.nn.functional import normalize

from pacnerf_lpo.particles.sampling import interpolate, sample_particles
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.ray_march import march, render_rays, shade
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.scene.voxel_field import VoxelField
from pacnerf_lpo.types import Box, Rays

DX, BASE_DX, RADIUS = 0.04, 0.16, 0.2


def best_seconds(function: Callable[[], object], repeats: int = 10) -> float:
    """Shortest of several runs [s]: the least disturbed by other processes."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def ball() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Positions [m, (N, 3)], raw density (N,) and features (N, 12) of the ball, all requiring gradients."""
    field = VoxelField.create(Box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)), DX)
    axes = [torch.arange(n) * DX + low for n, low in zip(field.density.shape, field.lower, strict=True)]
    nodes = torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)
    field.density.data = 30 * (RADIUS - nodes.norm(dim=-1)) / DX
    field.features.data = torch.randn_like(field.features)
    positions = sample_particles(field.grid(), torch.Generator().manual_seed(0))
    density, features = interpolate(field.grid(), positions)
    return positions.requires_grad_(), density.detach().requires_grad_(), features.detach().requires_grad_()


def camera(pixels: int) -> Rays:
    """``pixels`` squared rays of a camera 2.5 m in front of the ball."""
    across = ((torch.arange(pixels) + 0.5) / pixels - 0.5) * 0.5
    y, x = torch.meshgrid(-across, across, indexing="ij")
    directions = torch.stack((x, y, -torch.ones_like(x)), dim=-1).flatten(0, 1)
    return Rays(torch.tensor([[0.0, 0.0, 2.5]]).expand(pixels**2, 3).contiguous(), normalize(directions, dim=1))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--pixels", type=int, default=128)
    arguments = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(arguments.threads)
    particles, rays, colour = ball(), camera(arguments.pixels), ColourNetwork().requires_grad_(False)
    grid = particles_to_grid(*particles, DX)
    samples = march(grid, rays, BASE_DX)

    def forward() -> torch.Tensor:
        return render_rays(particles_to_grid(*particles, DX), colour, rays, BASE_DX).colour

    seconds = {"image, forward": best_seconds(forward)}
    seconds["image, forward + backward"] = best_seconds(lambda: forward().square().mean().backward())
    seconds["  particles to grid"] = best_seconds(lambda: particles_to_grid(*particles, DX))
    seconds["  march"] = best_seconds(lambda: march(grid, rays, BASE_DX))
    seconds["  shade"] = best_seconds(lambda: shade(samples, colour))
    square = torch.randn(len(samples.weights), 128)
    seconds["(one 128 x 128 layer on the samples)"] = best_seconds(lambda: square @ square[:128])
    unit = seconds["image, forward"]
    print(f"{len(particles[0])} particles, {len(rays.origins)} rays, {len(samples.weights)} coloured samples")
    for name, value in seconds.items():
        print(f"{name:40s}{1e3 * value:9.1f} ms{value / unit:8.2f} x forward")


if __name__ == "__main__":
    main()
