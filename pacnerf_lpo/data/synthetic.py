"""A scene in PAC-NeRF's layout from particle trajectories: shaded discs, seen by a hemisphere of cameras.

Good enough to test and to try things on: one directional light and an ambient term on smooth normals, so that all
cameras see the same colours, antialiased rims, camera noise. There is no shadow, no highlight and no ground.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from scipy.spatial import cKDTree
from tqdm import tqdm

from pacnerf_lpo.data.cameras import poses_around, project
from pacnerf_lpo.data.index import NAME, check_unused, entry_of
from pacnerf_lpo.data.recordings.conventions import centred_intrinsic

SUPERSAMPLING = 2
NEIGHBOURS = 32
AMBIENT = 0.45
LIGHT = np.array([0.35, 0.9, 0.25]) / np.linalg.norm([0.35, 0.9, 0.25])
BRIGHTEST = 250.0 / 255.0
"""The object stays below pure white, which means background."""


@dataclass(frozen=True)
class Rig:
    """Fixed cameras: ``camera_to_world`` [rotation and metres, (V, 3, 4)] and ``intrinsics`` [pixels, (V, 3, 3)]."""

    camera_to_world: np.ndarray
    intrinsics: np.ndarray


def hemisphere_rig(
    views: int = 11,
    image_size: int = 128,
    target: tuple[float, float, float] = (0.0, 0.42, 0.0),
    distance: float = 2.5,
    field_of_view: float = 30.0,
) -> Rig:
    """Cameras about ``target`` [m] at ``distance`` [m], 12 to 72 degrees above it; ``field_of_view`` [degrees]."""
    turn = np.arange(views)
    azimuth = 2.0 * np.pi * turn / views
    elevation = np.radians(12.0 + 60.0 * (turn * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0))
    poses = poses_around(np.array(target), distance, azimuth, elevation)
    intrinsic = centred_intrinsic(np.radians(field_of_view), image_size, image_size)
    return Rig(poses, np.repeat(intrinsic[None], views, axis=0))


@dataclass(frozen=True)
class Drawing:
    """How particles are drawn.

    image_size: width and height of the images [pixels]
    radius: of the discs, about the particle spacing [m]
    outline: as :func:`draw_discs` takes it [m]
    noise: standard deviation of the camera's noise on the object, in 0..1
    seed: of the noise
    """

    image_size: int
    radius: float
    outline: float | None = None
    noise: float = 0.0
    seed: int = 0


def write_scene(
    root: str | Path,
    trajectories: np.ndarray,
    colours: np.ndarray,
    rig: Rig,
    drawing: Drawing,
    frame_rate: float = 24.0,
    truth: dict[str, Any] | None = None,
) -> Path:
    """Render and write a scene of particles on trajectories [m, (F, N, 3)], of colours [0..1, (N, 3)], seen at a frame
    rate [1/s] by cameras for images of the size of the drawing; ``truth`` becomes ``truth.json``, for an evaluation.
    The same arguments give the same files. Raises UserInputError where ``root`` holds something already.
    """
    root = Path(root)
    check_unused(root)
    (root / "data").mkdir(parents=True)
    generator = np.random.default_rng(drawing.seed)
    entries = []
    for frame, positions in enumerate(tqdm(trajectories, desc=f"drawing {root}", delay=2.0, leave=False)):
        shaded = shade(positions, colours)
        for view, (pose, intrinsic) in enumerate(zip(rig.camera_to_world, rig.intrinsics, strict=True)):
            image = draw_discs(positions, shaded, pose, intrinsic, drawing.image_size, drawing.radius, drawing.outline)
            noisy = np.clip(image + drawing.noise * generator.standard_normal(image.shape), 0.0, BRIGHTEST)
            image = np.where((image < 1.0).any(axis=-1, keepdims=True), noisy, 1.0)  # the white around it stays pure
            Image.fromarray(np.round(image * 255.0).astype(np.uint8)).save(root / "data" / f"m_{view}_{frame}.png")
            entries.append(entry_of(view, frame, frame / frame_rate, pose, intrinsic))
    (root / NAME).write_text(json.dumps(entries))
    if truth is not None:
        (root / "truth.json").write_text(json.dumps(truth, indent=1))
    return root


def shade(positions: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Diffuse colours of particles [0..1, (N, 3)]; the normal points away from the neighbours' mean position."""
    _, neighbours = cKDTree(positions).query(positions, k=min(NEIGHBOURS, len(positions)))
    away = positions - positions[neighbours.reshape(len(positions), -1)].mean(axis=1)
    normals = away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-12)
    light = AMBIENT + (1.0 - AMBIENT) * np.maximum(normals @ LIGHT, 0.0)
    return np.clip(colours * light[:, None], 0.0, BRIGHTEST)


def draw_discs(
    positions: np.ndarray,
    colours: np.ndarray,
    pose: np.ndarray,
    intrinsic: np.ndarray,
    image_size: int,
    radius: float,
    outline: float | None = None,
) -> np.ndarray:
    """Opaque discs on white [0..1, (image_size, image_size, 3)], painted from the farthest to the nearest.

    Large discs leave no gaps through which the inside is seen, but reach over the surface: what lies outside of all
    discs of the smaller radius ``outline`` [m] stays white.
    """
    size = SUPERSAMPLING * image_size
    scale = np.diag([SUPERSAMPLING, SUPERSAMPLING, 1.0])
    pixels, depth = project(torch.from_numpy(positions), torch.from_numpy(scale @ intrinsic), torch.from_numpy(pose))
    order = torch.argsort(depth, descending=True)
    order = order[depth[order] > radius]
    centres = pixels[order].numpy().T[..., None]
    reach = SUPERSAMPLING * intrinsic[0, 0] * radius / depth[order].numpy()

    half = int(np.ceil(reach.max(initial=1.0)))
    span = np.arange(-half, half + 1)
    places = np.floor(centres).astype(int) + span
    away = (places + 0.5 - centres) ** 2 / reach[:, None] ** 2
    away[(places < 0) | (places >= size)] = np.inf
    (columns, rows), (across, down) = places, away
    apart = down[:, :, None] + across[:, None, :]
    particle, row, column = np.nonzero(apart < 1.0)

    image = np.ones((size, size, 3))
    image[rows[particle, row], columns[particle, column]] = colours[order.numpy()[particle]]
    if outline is not None:
        particle, row, column = np.nonzero(apart < (outline / radius) ** 2)
        outside = np.ones((size, size), bool)
        outside[rows[particle, row], columns[particle, column]] = False
        image[outside] = 1.0
    return image.reshape(image_size, SUPERSAMPLING, image_size, SUPERSAMPLING, 3).mean(axis=(1, 3))
