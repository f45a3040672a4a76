"""Points between particles go where the body goes, and what is drawn of them is as large as the body."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnerf_lpo.data.cameras import pixel_rays
from pacnerf_lpo.data.shapes import Ball, Torus, fill
from pacnerf_lpo.data.skin import COVER, FINER, OUTLINE, carried
from pacnerf_lpo.data.synthetic import draw_discs, hemisphere_rig


def filled(shape, spacing, seed=0):
    return fill(shape, spacing, torch.Generator().manual_seed(seed)).double().numpy()


def test_an_affine_motion_is_followed_exactly():
    particles, points = filled(Ball(0.2), 0.04), filled(Ball(0.2), 0.02, seed=1)
    random = np.random.default_rng(0)
    matrix, shift = random.standard_normal((3, 3)), random.standard_normal(3)
    path = np.stack((particles, particles @ matrix.T + shift))
    found = carried(points, path)
    np.testing.assert_allclose(found[0], points, atol=1e-5)
    np.testing.assert_allclose(found[1], points @ matrix.T + shift, atol=1e-5)


def test_a_bend_is_followed_better_than_by_the_nearest_particle():
    particles, points = filled(Ball(0.2), 0.04), filled(Ball(0.2), 0.02, seed=1)

    def bent(x):
        return x + np.stack((0 * x[:, 0], 2 * x[:, 0] ** 2, 0 * x[:, 0]), axis=1)

    found = carried(points, np.stack((particles, bent(particles))))[1]
    nearest = np.linalg.norm(points[:, None] - particles, axis=-1).argmin(1)
    rigid = points + (bent(particles) - particles)[nearest]
    error, of_rigid = (np.sqrt(((x - bent(points)) ** 2).sum(1).mean()) for x in (found, rigid))
    assert error < 0.3 * of_rigid


def test_a_few_particles_in_a_line_still_carry_points():
    line = np.linspace(0, 0.3, 4)[:, None] * np.array([1.0, 0.0, 0.0])
    found = carried(line[:2] + 0.01, np.stack((line, line + 0.5)))
    np.testing.assert_allclose(found[1] - found[0], 0.5, atol=1e-9)


def covered(shape, pose, intrinsic):
    """Pixels that a shape at the origin covers: a quarter for each of four rays that meet it, tried every 2 mm."""
    fine = torch.tensor(intrinsic) * torch.tensor([2.0, 2.0, 1.0])[:, None]
    rays = pixel_rays(fine, torch.tensor(pose), 2 * 128, 2 * 128)
    middle = -(rays.origins * rays.directions).sum(1, keepdim=True)
    near = ((rays.origins + middle * rays.directions).norm(dim=1) < shape.reach).nonzero().squeeze(1)
    along = middle[near] + torch.arange(-shape.reach, shape.reach, 0.002)
    points = rays.origins[near, None] + along[..., None] * rays.directions[near, None]
    return float(shape.contains(points.reshape(-1, 3)).view(along.shape).any(1).sum()) / 4


@pytest.mark.slow
@pytest.mark.parametrize("shape", [Ball(0.15), Torus(0.18, 0.05)])
def test_a_body_is_drawn_as_large_as_it_is(shape):
    spacing, rig, size = 0.044, hemisphere_rig(3, 128, target=(0.0, 0.0, 0.0)), 128

    def areas(points, radius, outline=None):
        black = np.zeros_like(points)
        views = zip(rig.camera_to_world, rig.intrinsics, strict=True)
        return np.array([(1 - draw_discs(points, black, *view, size, radius, outline)).sum() / 3 for view in views])

    true = np.array([covered(shape, *view) for view in zip(rig.camera_to_world, rig.intrinsics, strict=True)])
    apart = spacing / 2 / FINER
    shown = carried(filled(shape, apart, seed=1), filled(shape, spacing / 2)[None])[0]
    np.testing.assert_allclose(areas(shown, COVER * apart, OUTLINE * apart), true, rtol=0.03)
    unskinned = areas(filled(shape, spacing / 2), spacing / 2)
    assert (unskinned > 1.1 * true).all()
