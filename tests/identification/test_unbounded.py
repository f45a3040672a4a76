"""What outlines leave open of a surface: most where none is near, nothing where one touches the body."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from pacnerf_lpo.data.cameras import pixel_rays
from pacnerf_lpo.data.synthetic import hemisphere_rig
from pacnerf_lpo.identification.surface import FINER, Lines, seen_by, signed_distance
from pacnerf_lpo.identification.unbounded import DEPTH, DEVIATION, MEAN, Unbounded
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.types import FieldGrid, Rays

EDGES, RADIUS, VOXEL, SIZE = torch.tensor([0.36, 0.22, 0.28]), 0.17, 0.03, 96
Meets = Callable[[Rays], Tensor]


def rig(views: int) -> tuple[Tensor, Tensor]:
    """Poses of cameras around, 12 to 72 degrees above, and their common intrinsics."""
    found = hemisphere_rig(views, SIZE, (0.0, 0.0, 0.0), 2.0, 27.0)
    return torch.from_numpy(found.camera_to_world), torch.from_numpy(found.intrinsics[0])


def of_block(rays: Rays, edges: Tensor = EDGES) -> Tensor:
    """Which rays meet a block around the origin [(R,), bool]."""
    near, far = ((side * edges / 2 - rays.origins) / rays.directions for side in (-1, 1))
    return torch.minimum(near, far).amax(1) < torch.maximum(near, far).amin(1)


def of_ball(rays: Rays) -> Tensor:
    """The same of a ball."""
    return torch.linalg.cross(rays.origins.expand_as(rays.directions), rays.directions).norm(dim=1) < RADIUS


def matte(meets: Meets, pose: Tensor, intrinsic: Tensor) -> Tensor:
    """Mixed along its edges [(H, W)]."""
    fine = intrinsic * torch.tensor([4.0, 4.0, 1.0], dtype=torch.float64)[:, None]
    found = meets(pixel_rays(fine, pose, 4 * SIZE, 4 * SIZE)).float()
    return found.view(SIZE, 4, SIZE, 4).mean((1, 3))


def reconstructed(views: int, meets: Meets = of_block) -> tuple[FieldGrid, Lines]:
    """The largest body that the outlines allow, without ridges, and the lines of sight past them."""
    poses, intrinsic = rig(views)
    mattes = torch.stack([matte(meets, pose, intrinsic) for pose in poses])
    video = SimpleNamespace(
        silhouettes=mattes[:, None], valid=torch.ones(views, SIZE, SIZE, dtype=torch.bool),
        intrinsics=intrinsic.expand(views, 3, 3),
    )  # fmt: skip
    rays = SimpleNamespace(video=video, first_rays=lambda view: pixel_rays(intrinsic, poses[view], SIZE, SIZE))
    dx, count = VOXEL / FINER, 20 * FINER + 1
    axis = (torch.arange(count) - count // 2) * dx
    points = torch.cartesian_prod(axis, axis, axis).double()
    inside = torch.ones(len(points), dtype=torch.bool)
    for pose, seen in zip(poses, mattes, strict=True):
        local = (points - pose[:, 3]) @ pose[:, :3]
        at = (intrinsic[0, 0] * local[:, :2] / -local[:, 2:] * torch.tensor([1, -1]) + SIZE / 2).floor().long()
        inside &= seen[at[:, 1].clamp(0, SIZE - 1), at[:, 0].clamp(0, SIZE - 1)] > 0.5
    density = inside.view(count, count, count).float()
    found = signed_distance(FieldGrid(density, density.new_zeros(*density.shape, 0), axis[0].repeat(3), dx), 0.5)
    lines = Lines.of(rays, range(views))  # type: ignore[arg-type]
    assert found is not None
    return seen_by(lines, found), lines


def volume(surface: FieldGrid) -> float:
    return float((surface.density / surface.dx + 0.5).clamp(0, 1).sum()) * surface.dx**3


@pytest.fixture(scope="module")
def six() -> tuple[FieldGrid, Lines]:
    return reconstructed(6)


@pytest.mark.parametrize(("views", "mended"), [(6, 0.2), (12, 0.3)])
def test_a_block_is_nearer_to_the_true_one(views: int, mended: float):
    """Cameras above it see no underside, and no face edge-on: it is a tenth too large, and more."""
    surface, lines = reconstructed(views)
    true, found = float(EDGES.prod()), Unbounded.of(surface, lines)
    before, after = volume(surface) - true, volume(found.surface) - true
    assert before > 0.1 * true
    assert 0 < after < (1 - mended) * before
    assert 0.03 < found.volume < 0.1


def test_a_body_that_outlines_go_around_stays():
    surface, lines = reconstructed(24, of_ball)
    found = Unbounded.of(surface, lines)
    assert volume(found.surface) == pytest.approx(volume(surface), rel=0.02)
    assert len(found.beyond(0.2 * VOXEL)) <= 2 and found.volume < 0.02


def test_where_a_line_touches_the_body_the_surface_stays_and_has_no_error(six):
    surface, lines = six
    _, touched, _ = lines.highest(surface)
    edges = touched[lines.inside.abs() < 0.3]
    found = Unbounded.of(surface, lines)
    moved = interpolate(surface, edges)[0] - interpolate(found.surface, edges)[0]
    assert float(moved.abs().median()) < 0.03 * VOXEL
    assert all(float(interpolate(error, edges)[0].abs().median()) < 0.05 * VOXEL for error in found.errors)


def test_where_no_line_is_near_little_is_measured(six):
    """Of the underside of a body that all cameras see from above; further inwards than by half of what is possible."""
    surface, _ = six
    found, heights = Unbounded.of(*six), -torch.arange(0.05, 0.25, 0.004)
    down = torch.stack((torch.zeros_like(heights), heights, torch.zeros_like(heights)), 1)
    below = down[interpolate(surface, down)[0] > 0][-1:]
    whole = float(interpolate(found.errors[0], below)[0]) / (DEPTH * VOXEL)
    moved = float(interpolate(surface, below)[0] - interpolate(found.surface, below)[0]) / (DEPTH * VOXEL)
    assert 0.5 * DEVIATION < whole < 1.05 * DEVIATION
    assert 0.5 * MEAN < moved < 1.05 * MEAN


def test_a_plate_that_nobody_sees_edge_on_does_not_vanish():
    """One and a half voxels thick: its faces are between outlines that are far away."""
    surface, lines = reconstructed(6, partial(of_block, edges=torch.tensor([0.36, 1.5 * VOXEL, 0.36])))
    found = Unbounded.of(surface, lines)
    assert 0.4 * volume(surface) < volume(found.surface) < volume(surface)
    assert found.volume < 0.6


def test_without_lines_nothing_is_known_and_nothing_is_changed(six):
    surface, lines = six
    none = Lines(*(part[:0] for part in (lines.origins, lines.directions, lines.inside, lines.focal)))
    found = Unbounded.of(surface, none)
    assert found.surface is surface and found.errors == () and found.volume == 0
