"""Where the states of one frame's substeps live, and the grid they live on."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from pacnerf_lpo.mpm.lanes import LANES

FARTHEST = 1e9
"""Cells from the world's origin: a particle that is farther away is taken to be there."""


@dataclass(frozen=True)
class Grid:
    """Nodes ``origin`` to ``origin + size - 1`` of the infinite grid whose node (0, 0, 0) is at the world's origin."""

    origin: tuple[int, int, int]
    size: tuple[int, int, int]

    @property
    def nodes(self) -> int:
        return math.prod(self.size)

    @property
    def contact_nodes(self) -> int:
        """Number of nodes with y <= 0 to provide for."""
        return self.size[0] * max(0, 1 - self.origin[1]) * self.size[2]


def enclosing_grid(x: Tensor, v: Tensor, dx: float, duration: float, gravity: tuple[float, ...], margin: int) -> Grid:
    """The grid that holds the particles while they fly freely for a duration [s], and ``margin`` cells more on every
    side, from positions [m, (3, N)], velocities [m/s, (3, N)], node spacing [m] and gravity [m/s^2].
    """
    ends = torch.stack((x, x + duration * v))
    lowest, highest = ends.amin(2).flatten().tolist(), ends.amax(2).flatten().tolist()
    origin, size = [0, 0, 0], [0, 0, 0]
    for axis, pull in enumerate(gravity):  # many operations of Tensor on three numbers would take longer than the above
        fallen = 0.5 * pull * duration**2
        start = min(lowest[axis], lowest[3 + axis] + min(fallen, 0.0))
        if axis == 1:
            start = max(start, min(lowest[1], 0.0))
        end = max(highest[axis], highest[3 + axis] + max(fallen, 0.0))
        origin[axis] = _cell(start, dx) - margin
        size[axis] = _cell(end, dx) + 3 + margin - origin[axis]
    size[2] += 1  # rows of nodes along z are longer than a stencil by one
    return Grid((origin[0], origin[1], origin[2]), (size[0], size[1], size[2]))


def _cell(position: float, dx: float) -> int:
    """First node of the stencil of a position [m]; far away where that is infinite."""
    return math.floor(max(-FARTHEST, min(position / dx - 0.5, FARTHEST)))


class Tape:
    """Particle states and grid velocities of the substeps of one frame; with ``keep=False`` only the latest of each.

    states: S + 1 slots or one [(slots, B, width, LANES)], width = 24 and the history.
    grid: where they lie
    arguments: its arrays as launches take them, and how far apart the slots are in each. Of every node, in S slots or
        one: its velocity [m/s] and mass [kg]; and where y <= 0, its velocity before the ground [m/s].
    """

    grid: Grid
    arguments: dict[str, Tensor | int]

    def __init__(self, substeps: int, like: Tensor, keep: bool):
        self.keep, self._substeps = keep, substeps
        self.states = like.new_empty((substeps + 1 if keep else 1, *like.shape))
        self._buffer = like.new_empty(0)

    def fit(self, grid: Grid) -> None:
        """Make room for the nodes of a grid."""
        self.grid = grid
        slots, apart = (self._substeps, 1) if self.keep else (1, 0)
        sizes = [4 * grid.nodes, max(1, 3 * grid.contact_nodes)]
        if self._buffer.numel() < slots * sum(sizes):
            self._buffer = self._buffer.new_empty(slots * sum(sizes) * 5 // 4)
        velocity, contact = self._buffer[: slots * sum(sizes)].split([slots * size for size in sizes])
        self.arguments = {
            "states": self.states.view(-1, LANES),
            "velocity": velocity.view(-1, 4),
            "contact": contact,
            "state": apart * self.states[0].numel() // LANES,
            "nodes": apart * grid.nodes,
            "contacts": apart * sizes[1],
        }

    @staticmethod
    def bytes(substeps: int, grid: Grid, like: Tensor) -> int:
        """Memory of a kept frame."""
        per_substep = like.numel() + 4 * grid.nodes + 3 * grid.contact_nodes
        return like.element_size() * (substeps + 1) * per_substep
