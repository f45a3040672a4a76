"""Solid shapes to drop, filled with particles."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError


class Shape(ABC):
    """A solid around the origin.

    Attributes:
        reach: half the edge of a cube that holds it [m].
    """

    reach: float

    @abstractmethod
    def contains(self, points: Tensor) -> Tensor:
        """Whether each point [m, (N, 3)] is inside [(N,), bool]."""


class Ball(Shape):
    """A ball.

    Args:
        radius: [m]
    """

    def __init__(self, radius: float = 0.2):
        self.radius = self.reach = _positive("Ball.radius", radius)

    def contains(self, points: Tensor) -> Tensor:
        """See :meth:`Shape.contains`."""
        return points.norm(dim=-1) <= self.radius


class Block(Shape):
    """A box with faces along the axes.

    Args:
        edges: lengths along x, y and z [m].
    """

    def __init__(self, edges: tuple[float, float, float] = (0.4, 0.25, 0.3)):
        self.edges = torch.tensor([_positive("Block.edges", edge) for edge in edges])
        self.reach = 0.5 * max(edges)

    def contains(self, points: Tensor) -> Tensor:
        """See :meth:`Shape.contains`."""
        return (points.abs() <= 0.5 * self.edges.to(points)).all(-1)


class Torus(Shape):
    """A torus that stands upright: its axis is z.

    Args:
        ring: radius of the circle along its middle [m]
        tube: radius of the tube [m]
    """

    def __init__(self, ring: float = 0.2, tube: float = 0.08):
        self.ring, self.tube = _positive("Torus.ring", ring), _positive("Torus.tube", tube)
        self.reach = ring + tube

    def contains(self, points: Tensor) -> Tensor:
        """See :meth:`Shape.contains`."""
        from_ring = points[:, :2].norm(dim=-1) - self.ring
        return torch.hypot(from_ring, points[:, 2]) <= self.tube


def fill(shape: Shape, spacing: float, generator: torch.Generator) -> Tensor:
    """Particles inside a shape, one jittered in each cell of a lattice.

    Args:
        shape: what to fill.
        spacing: edge of a cell [m].
        generator: of the jitter.

    Returns:
        [m, (N, 3)]
    """
    axis = torch.arange(-shape.reach, shape.reach + spacing, spacing)
    points = torch.cartesian_prod(axis, axis, axis)
    points = points + spacing * (torch.rand(points.shape, generator=generator) - 0.5)
    points = points[shape.contains(points)]
    if len(points) == 0:
        raise UserInputError(
            f"no particle fits into the {type(shape).__name__} at spacing {spacing:g} m; choose a finer one"
        )
    return points


def _positive(where: str, value: float) -> float:
    if not value > 0:
        raise UserInputError(f"{where} = {value:g}: give a positive length in metres")
    return value
