"""What a body is drawn as: balls in it that reach to its surface, around particles and half way between them."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn.functional import normalize

SHELL = 0.9
"""Balls around particles less deep than this leave gaps, if only small ones; so there are others half way between them
[particle spacings]."""
NEAR, SCATTERED = 1.5, 2.0
"""Neighbours in a lattice, also across the diagonal of a face, and among particles at random places in its cells
[particle spacings]."""
STEP = 0.1
"""By which the direction to the surface is found [particle spacings]."""


@dataclass(frozen=True)
class Discs:
    """Balls, each half way between two particles.

    ends: numbers of the particles, twice the same for a ball around a particle [(M, 2), int64]; those come first.
    depth: distance of the centre from the surface at frame 0 [m, (M,)]
    inwards: direction away from it [unit vectors, (M, 3)]
    """

    ends: Tensor
    depth: Tensor
    inwards: Tensor

    @staticmethod
    def unknown(positions: Tensor, apart: float) -> "Discs":
        """Of particles [m, (N, 3)] of which it is not known how far from the surface they are: as far as those next to
        it, half of the distance between neighbours [m].
        """
        depth = positions.new_full((len(positions),), apart / 2)
        return Discs(_twice(positions), depth, torch.zeros_like(positions))

    @staticmethod
    def within(distance: Callable[[Tensor], Tensor], positions: Tensor, apart: float) -> "Discs":
        """Of particles in a body.

        Args:
            distance: to the surface, positive inside [m, (N,)], of places [m, (N, 3)]
            positions: of the particles [m, (N, 3)]
            apart: distance between neighbours [m].
        """
        pairs = neighbours(positions, NEAR * apart)
        shell = distance(positions) < SHELL * apart
        ends = torch.cat((_twice(positions), pairs[shell[pairs].all(1)]))
        centres = positions[ends].mean(1)
        steps = STEP * apart * torch.eye(3, dtype=positions.dtype)
        rise = torch.stack([distance(centres + step) - distance(centres - step) for step in steps], -1)
        return Discs(ends, distance(centres), normalize(rise, dim=1))

    def moved(self, steps: Tensor, kept: Tensor, positions: Tensor, apart: float) -> "Discs":
        """Of the same body after particles were moved at random and others left out; there are balls half way between
        all neighbours, as deep as a cubic between the two is there.

        Args:
            steps, kept: of the particles [m, (N, 3)], and which of them are left [(N,), bool]
            positions: of those, after that [m, (N', 3)]
            apart: distance between neighbours [m].
        """
        count = len(steps)
        inwards = self.inwards[:count][kept]
        depth = self.depth[:count][kept] + (steps[kept] * inwards).sum(1)
        ends = torch.cat((_twice(positions), neighbours(positions, SCATTERED * apart)))
        along = positions[ends[:, 1]] - positions[ends[:, 0]]
        bent = ((inwards[ends[:, 0]] - inwards[ends[:, 1]]) * along).sum(1) / 8  # a cubic between the two
        return Discs(ends, depth[ends].mean(1) + bent, normalize(inwards[ends].mean(1), dim=1))


def neighbours(positions: Tensor, reach: float) -> Tensor:
    """Numbers of particles [m, (N, 3)] no farther from each other than that [m]: [(P, 2), int64]."""
    return torch.from_numpy(KDTree(positions).query_pairs(reach, output_type="ndarray"))


def _twice(positions: Tensor) -> Tensor:
    return torch.arange(len(positions))[:, None].expand(-1, 2)
