"""Solid shapes to drop, filled with particles."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.data.recordings.media import library
from pacnerf_lpo.errors import UserInputError

VOXELS = 40
"""Along the longest extent of a mesh."""


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
        from_ring = points[:, :2].norm(dim=-1) - self.ring
        return torch.hypot(from_ring, points[:, 2]) <= self.tube


class Mesh(Shape):
    """A solid with a closed surface, around its centre of volume. Raises UserInputError where there is no such file or
    no closed surface, or the library that reads it is missing.

    Args:
        path: of a mesh in metres: OBJ, STL, PLY, glTF ...
        longest: its longest extent, instead of what the file has [m]; None: as in the file.
    """

    def __init__(self, path: str, longest: float | None = None):
        trimesh = library("trimesh", "a mesh", "export")
        if not Path(path).is_file():
            raise UserInputError(f"{path}: there is no such mesh; give a file, or Ball, Block or Torus")
        try:
            surface: Any = trimesh.load(path, force="mesh")
        except (ValueError, NotImplementedError, KeyError, IndexError, TypeError) as error:
            raise UserInputError(f"{path}: cannot be read as a mesh ({' '.join(str(error).split())})") from None
        if not len(surface.faces) or not surface.is_watertight:
            raise UserInputError(f"{path}: has no closed surface, so it has no volume; repair the mesh and export it")
        surface.apply_translation(-surface.center_mass)
        if longest is not None:
            surface.apply_scale(_positive("Mesh.longest", longest) / float(surface.extents.max()))
        self.reach = float(abs(surface.bounds).max())
        self._filled = surface.voxelized(2 * self.reach / VOXELS).fill()

    def contains(self, points: Tensor) -> Tensor:
        """See :meth:`Shape.contains`; to a voxel of a fortieth of its size."""
        return torch.from_numpy(self._filled.is_filled(points.double().numpy()))


def named_shape(name: str, size: Sequence[float]) -> Shape:
    """A shape by its name and its outer extents [m]: the diameter of a Ball, the edges of a Block, the outer diameter
    and the thickness of a Torus; a mesh file, with its longest extent where that is not as in the file. Raises
    UserInputError where there is no such shape, or for another number of extents.
    """
    wanted = {"Ball": "its diameter", "Block": "its three edges", "Torus": "its outer diameter and its thickness"}
    if name not in wanted:
        return Mesh(name, *size[:1])
    if len(size) != {"Ball": 1, "Block": 3, "Torus": 2}[name]:
        raise UserInputError(f"--shape {name} needs --size with {wanted[name]} in metres, not {len(size)} numbers")
    if name == "Ball":
        return Ball(size[0] / 2)
    if name == "Block":
        return Block((size[0], size[1], size[2]))
    return Torus((size[0] - size[1]) / 2, size[1] / 2)


def fill(shape: Shape, spacing: float, generator: torch.Generator) -> Tensor:
    """Particles inside a shape [m, (N, 3)], one jittered in each cell of a lattice, of edge ``spacing`` [m]."""
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
