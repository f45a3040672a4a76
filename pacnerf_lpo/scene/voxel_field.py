"""The Eulerian voxel radiance field of the static phase, refined from coarse to fine."""

import math

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.types import FEATURES, Box, FieldGrid

OBJECT_ALPHA = 1e-2
RELATIVE_ALPHA = 1e-3


class VoxelField(nn.Module):
    """Raw density and features on the nodes of a regular grid, both trainable.

    Attributes:
        density: raw density [(X, Y, Z)]
        features: [(X, Y, Z, 12)]
        lower: position of node (0, 0, 0) [m, (3,)]
        dx: current node spacing [m]
    """

    lower: Tensor

    def __init__(self, density: Tensor, features: Tensor, lower: Tensor, dx: float):
        super().__init__()
        self.density, self.features = nn.Parameter(density), nn.Parameter(features)
        self.register_buffer("lower", lower)
        self.dx = dx

    @staticmethod
    def create(box: Box, dx: float) -> "VoxelField":
        """A field of raw density 0 that covers ``box`` [m] with spacing ``dx`` [m]."""
        sides = [upper - lower for lower, upper in zip(box.lower, box.upper, strict=True)]
        shape = [max(2, math.ceil(side / dx - 1e-6) + 1) for side in sides]
        return VoxelField(torch.zeros(shape), torch.zeros(*shape, FEATURES), torch.tensor(box.lower), dx)

    def grid(self) -> FieldGrid:
        """The field as a differentiable grid."""
        return FieldGrid(self.density, self.features, self.lower, self.dx)

    @torch.no_grad()
    def refine(self) -> None:
        """Shrink the box to the occupied nodes with one node of margin and halve ``dx``; the field there is unchanged.

        The parameters are new objects afterwards. Raises UserInputError where nothing is left to refine.
        """
        self.check_object()
        opacity = alpha(self.density, 1.0)
        nodes = (opacity >= RELATIVE_ALPHA * opacity.max()).nonzero()
        ends = zip((nodes.amin(0) - 1).clamp_min(0).tolist(), (nodes.amax(0) + 1).tolist(), strict=True)
        region = tuple(slice(low, max(high, low + 1) + 1) for low, high in ends)
        first = torch.tensor([part.start for part in region], device=self.lower.device)
        self.lower = self.lower + first * self.dx
        self.density = nn.Parameter(_upsample(self.density[region][..., None]).squeeze(3))
        self.features = nn.Parameter(_upsample(self.features[region]))
        self.dx = self.dx / 2

    def check_object(self) -> None:
        """Raise UserInputError when the field has become empty."""
        largest = float(alpha(self.density.detach().max(), 1.0))
        if not largest >= OBJECT_ALPHA:
            raise UserInputError(
                f"static phase: the object has vanished (largest alpha {largest:.1e} at spacing {self.dx:g} m); "
                "lower phases.static.surface_weight, or check that data.box_lower and data.box_upper enclose the "
                "object in frame 0"
            )


def _upsample(values: Tensor) -> Tensor:
    """Node values (X, Y, Z, C) to the nodes of half the spacing (2X - 1, 2Y - 1, 2Z - 1, C), exactly trilinear."""
    size = [2 * n - 1 for n in values.shape[:3]]
    fine = interpolate(values.permute(3, 0, 1, 2)[None], size=size, mode="trilinear", align_corners=True)
    return fine[0].permute(1, 2, 3, 0).contiguous()
