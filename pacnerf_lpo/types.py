"""The values that flow through the program: shape and SI unit of every field.

``V`` views, ``F`` frames, ``H`` x ``W`` pixels, ``R`` rays, ``N`` particles, ``X, Y, Z`` grid nodes. World axes: y up,
the ground is the plane y = 0. Cameras: OpenGL axes (x right, y up, looking along -z), pixel centres at +0.5.
"""

import io
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

FEATURES = 12


@dataclass(frozen=True)
class Box:
    """An axis-aligned box, corners in metres."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


@dataclass(frozen=True)
class Rays:
    """Rays in world space: ``origins`` [m, (R, 3)] and unit ``directions`` [(R, 3)]."""

    origins: Tensor
    directions: Tensor

    def to(self, device: torch.device) -> "Rays":
        """The same rays on a device."""
        return Rays(self.origins.to(device), self.directions.to(device))


@dataclass(frozen=True)
class Video:
    """A multi-view video already matted onto white, every camera fixed.

    images: [linear file values in 0..1, (V, F, H, W, 3)]
    silhouettes: opacity of the object [0..1, (V, F, H, W)]
    valid: False where an occluder hides the scene [(V, H, W), bool]
    camera_to_world: [rotation and metres, (V, 3, 4)]
    intrinsics: focal lengths and principal point [pixels of ``images``, (V, 3, 3)]
    times: [s, (F,)]
    offsets: how much later than stamped each view's frames were taken [s, V of them]; none: all are in step
    view_ids, frame_ids: the numbers the files carry, in the order of the first two axes.
    source: where it was read from, for messages.
    """

    images: Tensor
    silhouettes: Tensor
    valid: Tensor
    camera_to_world: Tensor
    intrinsics: Tensor
    times: Tensor
    view_ids: tuple[int, ...]
    frame_ids: tuple[int, ...]
    source: str = ""
    offsets: tuple[float, ...] = ()

    @staticmethod
    def no_pictures(views: int, frames: int, height: int, width: int) -> dict[str, Any]:
        """Images, silhouettes and valid of a video that shows nothing; they need no memory."""
        one = torch.zeros(())
        return {
            "images": one.expand(views, frames, height, width, 3),
            "silhouettes": one.expand(views, frames, height, width),
            "valid": one.bool().expand(views, height, width),
        }


@dataclass(frozen=True)
class FieldGrid:
    """Raw density and features on the nodes of a regular grid.

    density: raw density sigma, before activation [(X, Y, Z)]; -100 where empty
    features: [(X, Y, Z, 12)]
    lower: position of node (0, 0, 0) [m, (3,)]
    dx: node spacing [m]
    """

    density: Tensor
    features: Tensor
    lower: Tensor
    dx: float

    @property
    def shape(self) -> tuple[int, int, int]:
        """X, Y, Z."""
        x, y, z = self.density.shape
        return x, y, z


@dataclass(frozen=True)
class ParticleState:
    """All that crosses from one phase to the next. Plain tensors on the CPU; saved and loaded as such.

    Attributes:
        positions: at frame 0 [m, (N, 3)]
        velocity: at frame 0 [m/s, (N, 3)]
        density: raw volume density sigma [(N,)]
        features: appearance [(N, 12)]
        physics: physical parameters by name [SI units, scalars], e.g. ``{"E": 1e6, "nu": 0.3}``
        spacing: node spacing of the grids the particles belong to; there are 8 particles per cell [m]
        base_spacing: the coarsest spacing dx0, which sets the optical length of a sample [m]
        colour_network: weights of the colour MLP, frozen after the static phase
        surface_offset: raw density above that of the visible surface at which the body begins, with
            ``physics.mass_from: outline``; None otherwise
        corrected: the particles were changed until their own motion fits the video; another sampling would not move so
    """

    positions: Tensor
    velocity: Tensor
    density: Tensor
    features: Tensor
    physics: dict[str, float]
    spacing: float
    base_spacing: float
    colour_network: dict[str, Tensor] = field(default_factory=dict)
    surface_offset: float | None = None
    corrected: bool = False

    @property
    def spacings(self) -> tuple[float, float]:
        """Node spacing and base spacing [m]."""
        return self.spacing, self.base_spacing

    def massive(self, density: Tensor) -> Tensor:
        """Raw densities of the particles [(N,)] as far as they make mass and stiffness."""
        return density if self.surface_offset is None else density - self.surface_offset

    def with_(self, **changes) -> "ParticleState":
        """A copy with the named fields replaced."""
        return replace(self, **changes)

    def as_bytes(self) -> bytes:
        """The state as a file of a dictionary of plain tensors, readable with ``weights_only=True``."""
        content = io.BytesIO()
        torch.save(dict(self.__dict__), content)
        return content.getvalue()

    def save(self, path: str | Path) -> None:
        """Write :meth:`as_bytes`."""
        Path(path).write_bytes(self.as_bytes())

    @staticmethod
    def load(path: str | Path) -> "ParticleState":
        """Read what :meth:`save` wrote."""
        return ParticleState(**torch.load(path, weights_only=True))
