"""Smooth errors of a reconstructed body, as many standard deviations of each as one says."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations_with_replacement

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.identification.body import Body

PLACES, BUMP = 16, 0.7
"""Errors of the shape in one place: how many places, and their width relative to the covering radius (of a particle
from its nearest place, at most). Smooth fields over the body do not show errors of a side that few cameras see."""
DENSITY_ERROR = 0.05
"""Of the density of the reconstructed body, from place to place."""
LOCAL = 2.0
"""Size of an error in one place relative to one that is everywhere."""
STRAINS, BENDS, THINNINGS, LEANS = 6, 18, 10, 4


@dataclass(frozen=True)
class ShapeModes:
    """Displacements of first and second order that are together about ``sigma``, surfaces moved inwards by together
    about as much, places moved by more, and a density that is higher here than there. How much of each is said by M
    numbers, in standard deviations: six strains, three bends along each of the axes for each field of second order, ten
    thinnings, three components for each place, four densities.

    body: whose places they are.
    sigma: how far its surface may be from the true one [m]
    """

    body: Body
    sigma: float

    @cached_property
    def count(self) -> int:
        """M."""
        return STRAINS + BENDS + THINNINGS + 3 * min(PLACES, len(self.body.positions)) + LEANS

    def depth(self, points: Tensor, numbers: np.ndarray) -> Tensor:
        """How far the surface moves inwards [m] at some points [m, (N, 3)], (N,)."""
        thinnings = self._parts(numbers)[2]
        together = thinnings[0] + thinnings[1:] @ polynomials(points, self.body.positions)
        return self.sigma / THINNINGS**0.5 * together

    def _fields(self, points: Tensor) -> tuple[Tensor, Tensor]:
        return polynomials(points, self.body.positions), bumps(self.body, points)

    def _moved(self, body: Body, numbers: np.ndarray, fields: Tensor, heights: Tensor) -> Body:
        """A sampling of the body, with these fields at its particles, displaced and with another density."""
        strains, bends, _, places, leans = self._parts(numbers)
        first, second = torch.triu_indices(3, 3)
        matrix = torch.zeros(3, 3, dtype=strains.dtype)
        matrix[first, second] = strains * torch.where(first == second, 0.5, 0.5**0.5)
        smooth = fields.T @ torch.cat((matrix + matrix.T, bends.reshape(-1, 3))) / (STRAINS + BENDS) ** 0.5
        local = LOCAL * heights.T @ places.reshape(-1, 3)
        density = 1 + DENSITY_ERROR * leans @ torch.cat((fields[:3], fields[3:6].sum(0, keepdim=True)))
        moved = body.positions + self.sigma * (smooth + local)
        return replace(body, positions=moved, fraction=body.fraction * density.clamp_min(0.1))

    def bodies(self, sampled: Callable[[Callable[[Tensor], Tensor]], Body]) -> list[Body]:
        """The body with one more error each, of one standard deviation, by a sampling whose surface was moved inwards
        by so much [m, (N,)] at places [m, (N, 3)]; itself where an error leaves nothing of it.
        """
        errors = np.eye(self.count)
        still = sampled(partial(self.depth, numbers=errors[0]))  # no strain moves the surface
        fields, found = self._fields(still.positions), []
        for one in errors:
            body, known = still, fields
            if self._parts(one)[2].any():
                body = sampled(partial(self.depth, numbers=one))
                known = self._fields(body.positions)
            found.append(self._moved(body, one, *known))
        return [body if len(body.positions) else self.body for body in found]

    def _parts(self, numbers: np.ndarray) -> tuple[Tensor, ...]:
        sizes = [STRAINS, BENDS, THINNINGS, self.count - STRAINS - BENDS - THINNINGS - LEANS, LEANS]
        return torch.as_tensor(numbers, dtype=self.body.positions.dtype).split(sizes)


def polynomials(points: Tensor, body: Tensor) -> Tensor:
    """Coordinates of some points [m, (N, 3)], then their squares, then their products, with mean 0 and mean square 1
    in a body of particles [m, (P, 3)]: [(9, N)].
    """

    def normalised(field: Tensor, inside: Tensor) -> Tensor:
        return (field - inside.mean()) / inside.std(correction=0).clamp_min(1e-9)

    linear = [normalised(points[:, axis], body[:, axis]) for axis in range(3)]
    inside = [normalised(body[:, axis], body[:, axis]) for axis in range(3)]
    pairs = sorted(combinations_with_replacement(range(3), 2), key=lambda pair: pair[0] != pair[1])
    return torch.stack([*linear, *(normalised(linear[i] * linear[j], inside[i] * inside[j]) for i, j in pairs)])


def bumps(body: Body, positions: Tensor) -> Tensor:
    """Gaussians of height 1 around places all over a body, at some positions [m, (N, 3)], (K, N); none is narrower than
    a node spacing, as no grid would resolve it.
    """
    places, reach = spread(body.positions, min(PLACES, len(body.positions)))
    width = max(BUMP * reach, body.spacing)
    return (-0.5 * torch.cdist(places, positions).square() / width**2).exp()


def spread(positions: Tensor, count: int) -> tuple[Tensor, float]:
    """K of the particles [m, (N, 3)], each as far as can be from those before it, the first as far as can be from the
    centre [m, (K, 3)], and how far a particle is at most from the nearest of them [m].
    """
    chosen = [int((positions - positions.mean(0)).norm(dim=1).argmax())]
    distance = (positions - positions[chosen[0]]).norm(dim=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = torch.minimum(distance, (positions - positions[chosen[-1]]).norm(dim=1))
    return positions[chosen], float(distance.max())
