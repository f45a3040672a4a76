"""The voxel field and its refinement."""

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.scene.voxel_field import VoxelField
from pacnerf_lpo.types import Box

BOX = Box((-0.4, 0.1, -0.4), (0.4, 0.9, 0.4))


def blob_field() -> VoxelField:
    """A ball of radius 0.2 m about (0, 0.5, 0) in an otherwise empty box of 0.1 m cells."""
    field = VoxelField.create(BOX, 0.1)
    nodes = torch.stack(torch.meshgrid(*[torch.arange(9) * 0.1] * 3, indexing="ij"), dim=-1) + field.lower
    distance = (nodes - torch.tensor([0.0, 0.5, 0.0])).norm(dim=-1)
    field.density.data = 200 * (0.2 - distance)
    field.features.data = torch.randn(9, 9, 9, 12, generator=torch.Generator().manual_seed(0))
    return field


def test_field_covers_its_box():
    field = VoxelField.create(BOX, 0.16)
    assert field.density.shape == (6, 6, 6)
    assert field.features.shape == (6, 6, 6, 12)
    assert bool((field.lower + 0.16 * 5 >= torch.tensor(BOX.upper)).all())


def test_refinement_keeps_the_field_and_shrinks_the_box():
    field = blob_field()
    points = torch.tensor([0.0, 0.5, 0.0]) + 0.2 * (
        torch.rand(200, 3, generator=torch.Generator().manual_seed(1)) - 0.5
    )
    before = interpolate(field.grid(), points)
    field.refine()
    after = interpolate(field.grid(), points)
    for old, new in zip(before, after, strict=True):
        # Positions of about 0.5 m have float32 spacing 6e-8; the density slope is 200 / m.
        torch.testing.assert_close(new, old, rtol=1e-5, atol=1e-4)
    assert field.dx == pytest.approx(0.05)
    assert field.density.numel() < 17**3
    assert bool((field.lower > torch.tensor(BOX.lower) + 0.05).all())


def test_refined_box_holds_every_occupied_node():
    field = blob_field()
    field.refine()
    edge = torch.tensor(field.density.shape) - 1
    upper = field.lower + field.dx * edge
    # alpha falls to 1e-3 at raw density ln(10) = 2.3, so the ball is occupied out to 0.2 - 2.3/200 m.
    assert bool((field.lower <= torch.tensor([-0.18, 0.32, -0.18])).all())
    assert bool((upper >= torch.tensor([0.18, 0.68, 0.18])).all())


@pytest.mark.parametrize("density", [-5.0, float("nan")])
def test_vanished_object_says_what_to_change(density):
    field = VoxelField.create(BOX, 0.1)
    field.density.data.fill_(density)
    with pytest.raises(UserInputError, match=r"vanished.*surface_weight.*box_lower"):
        field.refine()
