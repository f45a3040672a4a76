"""The surface of a reconstruction comes to where the mattes of frame 0 see it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnerf_lpo.data.cameras import pixel_rays, poses_around
from pacnerf_lpo.identification.surface import (
    BAND,
    Lines,
    density_at_edges,
    density_of,
    seen_by,
    signed_distance,
)
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.types import FieldGrid, ParticleState

RADIUS, VOXEL, SIZE, SLOPE = 0.2, 0.04, 96, 600.0
WRONG = torch.tensor([0.01, -0.007, 0.0])
"""Where the reconstructed ball is, relative to the true one [m]."""


def state_of(centre: Tensor, radius: float) -> ParticleState:
    """A ball whose raw density is 0 on its surface and falls off evenly."""
    axis = torch.arange(-0.3, 0.3, VOXEL / 2) + VOXEL / 4
    positions = torch.cartesian_prod(axis, axis, axis)
    density = (radius - (positions - centre).norm(dim=1)) * SLOPE
    blank = torch.zeros(len(positions), 3)
    return ParticleState(positions, blank, density, torch.zeros(len(positions), 12), {}, VOXEL, VOXEL)


def filmed(views: int) -> SimpleNamespace:
    """The true ball, at the origin, in so many views, by sharp mattes that are mixed along their edge."""
    around = 2 * np.pi * np.arange(views) / views
    poses = torch.from_numpy(poses_around(np.zeros(3), 2.0, around, 0.9 * np.cos(3 * around)))
    intrinsic = torch.tensor([[200.0, 0, SIZE / 2], [0, 200.0, SIZE / 2], [0, 0, 1]], dtype=torch.float64)
    fine = intrinsic * torch.tensor([8.0, 8.0, 1.0], dtype=torch.float64)[:, None]
    mattes = []
    for pose in poses:
        rays = pixel_rays(fine, pose, 8 * SIZE, 8 * SIZE)
        past = torch.linalg.cross(rays.origins.expand_as(rays.directions), rays.directions).norm(dim=1)
        mattes.append((past < RADIUS).float().view(SIZE, 8, SIZE, 8).mean((1, 3)))
    video = SimpleNamespace(
        silhouettes=torch.stack(mattes)[:, None],
        valid=torch.ones(views, SIZE, SIZE, dtype=torch.bool),
        intrinsics=intrinsic.expand(views, 3, 3),
    )
    return SimpleNamespace(video=video, first_rays=lambda view: pixel_rays(intrinsic, poses[view], SIZE, SIZE))


def errors(surface: FieldGrid) -> Tensor:
    """How far the surface is from that of the true ball, in many directions [m]."""
    directions = torch.nn.functional.normalize(torch.randn(300, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    return interpolate(surface, RADIUS * directions)[0]


@pytest.fixture(scope="module")
def data() -> SimpleNamespace:
    return filmed(8)


def test_a_body_in_the_wrong_place_comes_to_where_it_is_seen(data):
    first = signed_distance(density_of(state_of(WRONG, RADIUS)), 0.0)
    assert first is not None
    found = seen_by(Lines.of(data, range(8)), first)
    before, after = (errors(surface).square().mean().sqrt() for surface in (first, found))
    assert before > 0.008 and after < 0.5 * before


def test_without_lines_a_surface_stays(data):
    first = signed_distance(density_of(state_of(WRONG, RADIUS)), 0.0)
    assert first is not None and seen_by(Lines.of(data, []), first) is first


def test_what_is_missing_does_not_pull_at_what_is_there(data):
    """A matte with a limb that was not reconstructed moves the rest by less than a fifth of a voxel."""
    first = signed_distance(density_of(state_of(torch.zeros(3), RADIUS)), 0.0)
    limb = data.video.silhouettes.clone()
    limb[2, 0, 44:52, 60:90] = 1.0
    other = SimpleNamespace(
        video=SimpleNamespace(**{**vars(data.video), "silhouettes": limb}), first_rays=data.first_rays
    )
    assert first is not None
    found = seen_by(Lines.of(other, range(8)), first)
    assert float(errors(found).abs().mean()) < 0.2 * VOXEL


def test_the_density_at_the_edges_says_how_large_a_body_is(data):
    """Of a ball that is 2 cm larger than it looks, the density where it looks to end."""
    density = density_of(state_of(torch.zeros(3), RADIUS + 0.02))
    seen = density_at_edges(density, Lines.of(data, range(8)))
    assert seen == pytest.approx(float(interpolate(density, torch.tensor([[RADIUS, 0.0, 0.0]]))[0]), abs=1.5)


def test_a_level_that_is_nowhere_has_no_surface():
    assert signed_distance(density_of(state_of(torch.zeros(3), RADIUS)), 1e3) is None


def test_lines_are_near_the_edge_and_not_behind_an_occluder(data):
    lines = Lines.of(data, [1])
    past = torch.linalg.cross(lines.origins, lines.directions).norm(dim=1)
    away = (RADIUS - past) * 200.0 / 2.0
    assert float(lines.inside.abs().max()) < BAND
    assert float((lines.inside - away).abs().mean()) < 0.1
    hidden = data.video.valid.clone()
    hidden[1, : SIZE // 2] = False
    other = SimpleNamespace(video=SimpleNamespace(**{**vars(data.video), "valid": hidden}), first_rays=data.first_rays)
    assert 0.4 < len(Lines.of(other, [1]).inside) / len(lines.inside) < 0.6


def test_a_body_thinner_than_a_voxel_is_still_there():
    state = state_of(torch.zeros(3), RADIUS)
    sheet = state.with_(density=(VOXEL / 4 - state.positions[:, 1].abs()) * SLOPE)
    found = signed_distance(density_of(sheet), -5.0)
    assert found is not None and float(found.density.max()) > 0


def test_a_body_of_one_density_is_not_hollow(data):
    """Nothing rises inwards, and it reaches beyond the mattes."""
    even = state_of(torch.zeros(3), RADIUS)
    density = density_of(even.with_(density=torch.where(even.density > -0.03 * SLOPE, 80.0, -80.0)))
    level = density_at_edges(density, Lines.of(data, range(8)))
    found = signed_distance(density, level)
    assert level == pytest.approx(60.0)
    assert found is not None and float(interpolate(found, torch.zeros(1, 3))[0]) > 0.6 * RADIUS
