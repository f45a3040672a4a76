"""Fog that floats apart from the body."""

from __future__ import annotations

import torch

from pacnerf_lpo.particles.parts import confirmed, inside_mattes
from pacnerf_lpo.types import Video

SPACING = 0.1


def block(centre: tuple[float, float, float], side: int) -> torch.Tensor:
    """Particles of a cube of cells [m, (8 side^3, 3)]"""
    line = (torch.arange(2 * side) + 0.5) * SPACING / 2
    return torch.cartesian_prod(line, line, line) - side * SPACING / 2 + torch.tensor(centre)


def test_what_most_views_do_not_see_inside_their_mattes_is_fog():
    body, second, fog = block((0, 0, 0), 3), block((1, 0, 0), 2), block((0, 1, 0), 1)
    inside = torch.zeros(4, len(body) + len(second) + len(fog), dtype=torch.bool)
    inside[:3, len(body) : -len(fog)] = True
    inside[:2, -len(fog) :] = True
    kept = confirmed(torch.cat((body, second, fog)), SPACING, inside)
    assert kept[: -len(fog)].all()  # the largest part stays where no matte knows it: it may be cut off in all
    assert not kept[-len(fog) :].any()


def test_parts_that_touch_are_one():
    body, rim = block((0, 0, 0), 3), block((0.2, 0.2, 0.2), 1)
    kept = confirmed(torch.cat((body, rim)), SPACING, torch.zeros(2, len(body) + len(rim), dtype=torch.bool))
    assert kept.all()


def test_a_view_sees_what_projects_into_its_matte():
    """A camera at (0, 0, 2) looks at the origin with 40 pixels of focal length; its matte is the left half."""
    pose = torch.tensor([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2]])
    intrinsics = torch.tensor([[40.0, 0, 20], [0, 40, 15], [0, 0, 1]])
    matte = torch.zeros(1, 1, 30, 40)
    matte[..., :20] = 1.0
    images, valid = torch.ones(1, 1, 30, 40, 3), torch.ones(1, 30, 40, dtype=torch.bool)
    video = Video(images, matte, valid, pose[None], intrinsics[None], torch.zeros(1), (0,), (0,))
    points = torch.tensor(
        [
            [-0.5, 0.0, 0.0],  # 10 pixels to the left
            [0.5, 0.0, 0.0],  # to the right: no matte
            [-1.1, 0.0, 0.0],  # 22 to the left: outside the image
            [-0.5, 0.8, 0.0],  # 16 upwards: outside
            [0.5, 0.0, 4.0],  # behind the camera, mirrored into the left half
        ]
    )
    assert inside_mattes(points, video, [0]).tolist() == [[True, False, False, False, False]]
