"""``pacnerf-lpo synthesize``: a multi-view video of a simulated scene, with its truth."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

import pacnerf_lpo.render.camera_faults  # noqa: F401  (short class names exist once their modules are imported)
from pacnerf_lpo.data import skin
from pacnerf_lpo.data.shapes import Ball, Block, Shape, Torus, fill
from pacnerf_lpo.data.synthetic import Drawing, hemisphere_rig, write_scene
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.parameter_errors import TRUTH_KEYS
from pacnerf_lpo.mpm.effects import Effect
from pacnerf_lpo.mpm.ground import Ground, Sticky
from pacnerf_lpo.mpm.materials import Material, NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.types import FEATURES, ParticleState

SOLID = 40.0
"""Raw density of a particle that is completely opaque and has its full mass."""

PALETTE = np.array([[0.85, 0.36, 0.20], [0.20, 0.48, 0.75], [0.93, 0.74, 0.28], [0.25, 0.62, 0.45]])
PATCH = 9.0
__all__ = ["Ball", "Block", "Torus", "run"]


def run(
    output: str,
    material: Material | None = None,
    shape: Shape | None = None,
    ground: Ground | None = None,
    effects: list[Effect] | None = None,
    height: float = 0.6,
    velocity: tuple[float, float, float] = (0.0, -1.0, 0.0),
    frames: int = 14,
    views: int = 11,
    image_size: int = 128,
    dx: float = 0.03,
    substep_rate: float = 4800.0,
    rho: float = 1000.0,
    noise: float = 0.01,
    seed: int = 0,
) -> None:
    """Drop a shape of some material, film it, and write the video in PAC-NeRF's layout, with truth.json.

    The grid should be finer than the one of the model that is fitted to it later.

    example: pacnerf-lpo synthesize scenes/ball --material NeoHookean --material.E 2e5 --shape Ball --views 5

    example: pacnerf-lpo synthesize scenes/drag --effects+=LinearDrag --effects.drag 1.5

    Args:
        output: folder to write, absent or empty.
        material: constitutive law and its true parameters; elastic when not given.
        shape: Ball, Block or Torus; a torus when not given.
        ground: Sticky, Slip or Separate; sticky when not given.
        effects: physical effects in addition to them.
        height: of the shape's centre at frame 0 [m].
        velocity: at frame 0 [m/s].
        frames: number of frames, 24 a second.
        views: number of cameras.
        image_size: width and height of the images [pixels].
        dx: grid spacing of the simulation [m].
        substep_rate: integration steps per second [1/s].
        rho: density [kg/m^3].
        noise: standard deviation of the cameras' noise, in 0..1.
        seed: of particles and noise.
    """
    law, solid = material or NeoHookean(), shape or Torus()
    if not dx > 0:
        raise UserInputError(f"--dx {dx:g}: give a positive spacing in metres")
    if height < solid.reach:
        raise UserInputError(f"--height {height:g}: the shape reaches {solid.reach:g} m below its centre; lift it")
    physics = Physics(law, ground, effects or (), rho=rho, substep_rate=substep_rate)
    generator = torch.Generator().manual_seed(seed)
    state = dropped(solid, height, velocity, dx, generator)
    print(f"simulating {len(state.positions)} particles over {frames} frames")
    path = physics.simulate(state, frames)
    print(f"drawing {frames * views} images")
    apart = dx / 2 / skin.FINER
    drawn = placed(solid, height, apart, generator)
    moved = skin.carried(drawn.double().numpy(), path.double().numpy())
    drawing = Drawing(image_size, skin.COVER * apart, skin.OUTLINE * apart, noise, seed)
    rig, truth = hemisphere_rig(views, image_size), truth_of(physics, velocity, dx)
    print(write_scene(output, moved, patches(drawn), rig, drawing, truth=truth))


def dropped(
    shape: Shape, height: float, velocity: tuple[float, float, float], dx: float, generator: torch.Generator
) -> ParticleState:
    """The shape in the air, 8 particles a cell, all with one velocity [m/s]."""
    positions = placed(shape, height, dx / 2, generator)
    return ParticleState(
        positions=positions,
        velocity=torch.tensor(velocity).expand_as(positions),
        density=torch.full((len(positions),), SOLID),
        features=torch.zeros(len(positions), FEATURES),
        physics={},
        spacing=dx,
        base_spacing=dx,
    )


def placed(shape: Shape, height: float, apart: float, generator: torch.Generator) -> Tensor:
    """Points inside the shape in the air, one in each cell of a lattice of spacing ``apart`` [m, (N, 3)]."""
    return fill(shape, apart, generator) + torch.tensor([0.0, height, 0.0])


def patches(positions: Tensor) -> np.ndarray:
    """A colour for every point [m, (N, 3)] that varies over the body, so that its motion can be seen [0..1, (N, 3)]."""
    centred = (positions - positions.mean(0)).double().numpy()
    directions = np.array([[1.0, 0.4, -0.3], [0.2, 1.0, 0.5], [-0.6, 0.3, 1.0], [0.7, -0.8, 0.4]])
    weights = np.exp(3.0 * np.sin(PATCH * centred @ directions.T))
    return (weights / weights.sum(1, keepdims=True)) @ PALETTE


def truth_of(physics: Physics, velocity: Sequence[float], dx: float) -> dict[str, Any]:
    keys = {name: key for key, name in TRUTH_KEYS.items()}
    material, ground = physics.material, physics.ground
    return {
        "material": _snake(type(material).__name__),
        "parameters": {keys[name]: value for name, value in material.guess.items() if name in keys},
        "density_kg_m3": physics.rho,
        "initial_velocity_m_s": list(velocity),
        "gravity_m_s2": list(physics.gravity),
        "frame_dt_s": 1 / physics.frame_rate,
        "ground": _snake(type(ground).__name__),
        "grid_dx_m": dx,
        "time_step_s": 1 / physics.substep_rate,
        "hidden_effects": {
            **{_snake(type(effect).__name__): {**effect.guess, **effect.constants} for effect in physics.effects},
            **({} if isinstance(ground, Sticky) else {_snake(type(ground).__name__): dict(ground.guess)}),
        },
    }


def _snake(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()
