"""What a diagnosed scene looks like before anything is hidden in it: body, material, motion and cameras."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from pacnerf_lpo.data import shapes
from pacnerf_lpo.data.synthetic import hemisphere_rig
from pacnerf_lpo.identification.split import held_views
from pacnerf_lpo.identification.surface import edge_distance
from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.types import FieldGrid, Video

FRAME_RATE, GRAVITY = 24.0, 9.8
VOLUME_LATTICE = 40
SURFACE_NODES = 8  # of its signed distance, for each of the model's
LEAST_GAP = 0.08  # between body and ground at frame 0 [m]
GUESSED_WITHIN = 0.3  # decades, of a modulus
OTHERS = ("VonMises", "Newtonian")
SHARE_OF_OTHERS = 0.2


@dataclass(frozen=True)
class Size:
    """How large a scene is, and so how long its diagnosis takes.

    particles: of the diagnosis' model, about.
    views: cameras.
    held: how many of them are held out where the shape is known; from a video, those that the diagnosis holds out.
    trained: cameras that the shape of a video is reconstructed from; None: outlines of a known shape.
    finer: node spacing of the truth relative to that of a model with so many particles; the diagnosis of a video has
        more particles than that, and its truth must still be finer.
    """

    particles: int = 1000
    views: int = 5
    held: int = 2
    frames: int = 10
    image_size: int = 72
    trained: tuple[int, ...] | None = None
    finer: float = 0.75


FAST = Size()
FULL = {
    "three": Size(views=11, frames=14, image_size=128, trained=(0, 4, 8), finer=0.45),
    "all": Size(views=11, frames=14, image_size=128, trained=tuple(range(11)), finer=0.45),
}
"""Videos to reconstruct from three views, or from all; what is held out is what the diagnosis holds out then."""


@dataclass(frozen=True)
class Setting:
    """All that a user knows of a scene in addition to its video, as plain numbers.

    shape, arguments: a class of ``data.shapes`` and its arguments.
    rotation, centre: how the shape stands [vector of its turn, radian; m]
    material: class of the model's material.
    guess: of the material's parameters and of the velocity [SI]
    spacing: node spacing of the diagnosis' model [m];  rate: its steps per second.
    cameras: to world [m, (V, 3, 4)];  intrinsics [pixels, (V, 3, 3)]
    held_views: indices of the cameras held out.
    warp_seed, warp: the body of the model is the true one, distorted smoothly by so much [m].
    """

    shape: str
    arguments: dict
    rotation: list[float]
    centre: list[float]
    material: str
    guess: dict[str, float]
    spacing: float
    rate: float
    frames: int
    image_size: int
    cameras: list
    intrinsics: list
    held_views: list[int]
    warp_seed: int
    warp: float

    @property
    def law(self) -> Material:
        """The material at the guess."""
        return self.law_at(self.guess)

    def law_at(self, values: dict[str, float]) -> Material:
        """The material at some values of its parameters [SI]."""
        kind = getattr(materials, self.material)
        return kind(**{name: values[name] for name in kind.parameters})

    def inside(self, points: Tensor) -> Tensor:
        """Whether each point in the world [m, (N, 3)] is in the body at frame 0 [(N,), bool]."""
        return self.solid.contains((points - torch.tensor(self.centre, dtype=points.dtype)) @ self._turn.to(points))

    @cached_property
    def surface(self) -> FieldGrid:
        """Distance to the surface of the body at frame 0, positive inside [m]."""
        dx = self.spacing / SURFACE_NODES
        axis = torch.arange(-self.reach - self.spacing, self.reach + self.spacing + dx, dx)
        centre = torch.tensor(self.centre, dtype=torch.float32)
        inside = self.inside(torch.cartesian_prod(axis, axis, axis) + centre).view(3 * (len(axis),)).numpy()
        depth = torch.from_numpy(edge_distance(inside) * dx).float()
        return FieldGrid(depth, depth.new_zeros(*depth.shape, 0), centre + axis[0], dx)

    def filled(self, spacing: float, generator: torch.Generator) -> Tensor:
        """Points of the body at frame 0, one in each cell of a lattice [m, (N, 3)]; ``spacing`` in metres."""
        return shapes.fill(self.solid, spacing, generator) @ self._turn.float().T + torch.tensor(self.centre)

    @property
    def _turn(self) -> Tensor:
        return torch.from_numpy(Rotation.from_rotvec(self.rotation).as_matrix())

    @property
    def solid(self) -> shapes.Shape:
        """The shape around the origin, not turned."""
        return getattr(shapes, self.shape)(**self.arguments)

    @property
    def reach(self) -> float:
        """Half the edge of a cube around the centre that holds the body however it is turned [m]."""
        return float(np.sqrt(3) * self.solid.reach)

    def video(self, silhouettes: Tensor | None = None, factor: int = 1) -> Video:
        """Cameras and times; images of ``factor`` times as many pixels, of which only the size is used."""
        views, size = len(self.cameras), factor * self.image_size
        scale = torch.tensor([factor, factor, 1.0])[:, None]
        shape = (views, self.frames, size, size)
        return Video(
            images=torch.zeros(1).expand(*shape, 3),
            silhouettes=torch.zeros(1).expand(shape) if silhouettes is None else silhouettes,
            valid=torch.ones(1, dtype=torch.bool).expand(views, size, size),
            camera_to_world=torch.tensor(self.cameras, dtype=torch.float32),
            intrinsics=torch.tensor(self.intrinsics, dtype=torch.float32) * scale,
            times=torch.arange(self.frames, dtype=torch.float64) / FRAME_RATE,
            view_ids=tuple(range(views)),
            frame_ids=tuple(range(self.frames)),
            source="hidden effect",
        )

    def as_json(self) -> dict:
        """Plain values."""
        return asdict(self)


def draw_setting(random: np.random.Generator, size: Size, material: str | None) -> tuple[Setting, dict[str, float]]:
    """A setting, and the true values of its material's parameters and of the velocity [SI].

    Args:
        random: source of all choices.
        size: of the scene.
        material: class of the material; None: mostly elastic.
    """
    kind, arguments = _shape(random)
    if material is None:
        material = str(random.choice(OTHERS)) if random.random() < SHARE_OF_OTHERS else "NeoHookean"
    true, guess = _material(random, material)
    sideways = random.uniform(-0.4, 0.4, 2)
    velocity = {"v_x": sideways[0], "v_y": -random.uniform(0.0, 1.5), "v_z": sideways[1]}
    setting = Setting(
        shape=kind,
        arguments=arguments,
        rotation=Rotation.random(random_state=int(random.integers(1 << 31))).as_rotvec().tolist(),
        centre=[0.0, 0.0, 0.0],
        material=material,
        guess={**guess, **{name: value + 0.1 * random.standard_normal() for name, value in velocity.items()}},
        spacing=0.0,
        rate=960.0,
        frames=size.frames,
        image_size=size.image_size,
        cameras=[],
        intrinsics=[],
        held_views=_held(random, size),
        warp_seed=int(random.integers(1 << 31)),
        warp=0.0,
    )
    lattice = torch.linspace(-setting.reach, setting.reach, VOLUME_LATTICE)
    points = torch.cartesian_prod(lattice, lattice, lattice)
    points = points[setting.inside(points)]
    volume = len(points) * float(lattice[1] - lattice[0]) ** 3
    contact = random.uniform(3.0, 6.0) * size.frames / 12 / FRAME_RATE
    gap = max(-velocity["v_y"] * contact + GRAVITY * contact**2 / 2, LEAST_GAP)
    height = gap - float(points[:, 1].min())
    spacing = 2 * (volume / size.particles) ** (1 / 3)
    drift = size.frames / FRAME_RATE * float(np.abs(sideways).max())
    extent = max(height + float(points.abs().max()) + 0.1, 2 * (float(points.abs().max()) + drift))
    cameras, intrinsics = _ring(random, size, extent)
    setting = replace(
        setting,
        centre=[0.0, height, 0.0],
        spacing=spacing,
        warp=0.1 * spacing,
        cameras=cameras.tolist(),
        intrinsics=intrinsics.tolist(),
    )
    return setting, {**true, **velocity}


def another_drop(
    random: np.random.Generator, size: Size, setting: Setting, velocity: dict[str, float], higher: float
) -> tuple[Setting, dict[str, float]]:
    """The same body dropped once more, with a velocity of its own, cameras of its own and as many frames after contact.

    Args:
        random: source of all choices.
        size: of the scene.
        setting, velocity: of the first drop [SI].
        higher: factor on the height above the ground.

    Returns:
        The setting, and the true velocity [m/s].
    """
    lattice = torch.linspace(-setting.reach, setting.reach, VOLUME_LATTICE)
    points = torch.cartesian_prod(lattice, lattice, lattice) + torch.tensor(setting.centre)
    points = points[setting.inside(points)]
    gap = float(points[:, 1].min())
    sideways = random.uniform(-0.4, 0.4, 2)
    other = {"v_x": float(sideways[0]), "v_y": -random.uniform(0.0, 1.0), "v_z": float(sideways[1])}
    longer = _fall(higher * gap, other["v_y"]) - _fall(gap, velocity["v_y"])
    frames = setting.frames + max(0, round(longer * FRAME_RATE))
    centre = [0.0, setting.centre[1] + (higher - 1) * gap, 0.0]
    across = float((points - torch.tensor(setting.centre)).abs().max())
    extent = max(centre[1] + across + 0.1, 2 * (across + frames / FRAME_RATE * float(np.abs(sideways).max())))
    cameras, intrinsics = _ring(random, size, extent)
    return replace(
        setting,
        centre=centre,
        frames=frames,
        cameras=cameras.tolist(),
        intrinsics=intrinsics.tolist(),
        held_views=_held(random, size),
        guess={**setting.guess, **{name: value + 0.1 * random.standard_normal() for name, value in other.items()}},
    ), other


def _fall(height: float, velocity: float) -> float:
    """Time [s] of a fall from a height [m] with an upward velocity [m/s]."""
    return (velocity + float(np.sqrt(velocity**2 + 2 * GRAVITY * height))) / GRAVITY


def _held(random: np.random.Generator, size: Size) -> list[int]:
    if size.trained is None:
        return sorted(random.choice(size.views, size.held, replace=False).tolist())
    return held_views(size.views, [view for view in range(size.views) if view not in size.trained])


def _shape(random: np.random.Generator) -> tuple[str, dict]:
    kind = str(random.choice(["Ball", "Block", "Torus"]))
    if kind == "Ball":
        return kind, {"radius": random.uniform(0.15, 0.22)}
    if kind == "Block":
        return kind, {"edges": random.uniform(0.2, 0.42, 3).tolist()}
    return kind, {"ring": random.uniform(0.15, 0.22), "tube": random.uniform(0.07, 0.1)}


def _material(random: np.random.Generator, kind: str) -> tuple[dict[str, float], dict[str, float]]:
    """True values and a guess of the parameters of a material [SI]."""
    true = {
        "E": 10 ** random.uniform(4.3, 5.2),
        "nu": random.uniform(0.2, 0.4),
        "tau_y": 10 ** random.uniform(2.7, 3.5),
        "mu": 10 ** random.uniform(1.0, 2.3),
        "kappa": 10 ** random.uniform(4.3, 5.0),
        "theta": random.uniform(25.0, 45.0),
    }
    guess = {name: value * 10 ** random.uniform(-GUESSED_WITHIN, GUESSED_WITHIN) for name, value in true.items()}
    guess |= {"nu": 0.3, "theta": 35.0}
    names = getattr(materials, kind).parameters
    return {name: true[name] for name in names}, {name: guess[name] for name in names}


def _ring(random: np.random.Generator, size: Size, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """Cameras that see a column of so many metres: a hemisphere, turned, each nearer or farther at random."""
    distance = random.uniform(2.0, 3.0)
    view = float(np.degrees(2 * np.arctan(0.58 * extent / distance)))
    rig = hemisphere_rig(size.views, size.image_size, (0.0, 0.47 * extent, 0.0), distance, view)
    turn = Rotation.from_euler("y", random.uniform(0.0, 2 * np.pi)).as_matrix()
    cameras = np.einsum("ij,vjk->vik", turn, rig.camera_to_world)
    cameras[:, :, 3] += cameras[:, :, 2] * random.uniform(0.0, 0.3, (size.views, 1))
    return cameras, rig.intrinsics
