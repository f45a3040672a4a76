"""A whole diagnosis in seconds: a ball whose motion is computed for its centre alone, before small cameras.

The centre falls with linear drag, a uniform and a smooth force, and touches a soft ground that pushes by its stiffness;
touching, the ball is flatter. What is measured shows another, finer sampling of it than the model's, as it would of a
real one. Everything behind the motion (cameras, outlines, fits, statistics) is real.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from pacnerf_lpo.data.synthetic import hemisphere_rig
from pacnerf_lpo.diagnosis.catalogue import Candidate, name_of
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.identification.forward_model import BodyModel
from pacnerf_lpo.identification.problem import BodyProblem, independent, noise_of_video
from pacnerf_lpo.identification.smooth_force import SmoothForce
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.mpm.effects import GroundFriction, LinearDrag, UniformForce
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.render.camera_faults import CameraShift
from pacnerf_lpo.types import Video

VIEWS, FRAMES, SIZE, SPACING, RADIUS = 4, 9, 64, 0.1, 0.18
STEPS, RATE = 8, 24.0
NOISE = 0.65
"""Of outlines, relative to what is presumed: edges of the benchmark's mattes err by 0.2 pixels and not by 0.3."""
TRUTH = {"E": 6e4, "nu": 0.3, "ground_height": 0.0, "v_x": 0.4, "v_y": -1.0, "v_z": 0.2}
GUESS = {**TRUTH, "E": 9e4, "v_x": 0.3, "v_y": -1.1, "v_z": 0.3}
CENTRE = np.array([0.0, 0.75, 0.0])
CANDIDATES = "- class_path: LinearDrag\n- class_path: UniformForce\n- class_path: GroundFriction\n"
HELD = 2
"""The camera that is held out."""
MADE = LinearDrag(), UniformForce(), GroundFriction(), CameraShift(view=HELD)
EFFECTS: dict[str, Effect] = {name_of(effect): effect for effect in MADE}


def candidate(name: str) -> Candidate:
    return Candidate(name, EFFECTS[name])


class Falling(BodyProblem):
    """A ball that falls, with some effects in the recording that the model has not."""

    spacing = SPACING
    first_guess = GUESS
    least_shape_error = 0.002
    """The ball is known but for its sampling [m]."""

    def __init__(self, hidden: dict[str, float], seed: int = 0):
        rig = hemisphere_rig(VIEWS, SIZE, (0.0, 0.4, 0.0), 2.2, 40.0)
        video = Video(
            torch.zeros(1).expand(VIEWS, FRAMES, SIZE, SIZE, 3),
            torch.zeros(1).expand(VIEWS, FRAMES, SIZE, SIZE),
            torch.ones(1, dtype=torch.bool).expand(VIEWS, SIZE, SIZE),
            torch.tensor(rig.camera_to_world, dtype=torch.float32),
            torch.tensor(rig.intrinsics, dtype=torch.float32),
            torch.arange(FRAMES, dtype=torch.float64) / RATE,
            tuple(range(VIEWS)),
            tuple(range(FRAMES)),
        )
        split = Split(np.arange(VIEWS) != HELD, np.arange(FRAMES) < FRAMES - 2)
        physics = Physics(NeoHookean(E=9e4, nu=0.3), substep_rate=960.0, fit_ground_height=True)
        blank = np.ones((VIEWS, FRAMES, 11))
        super().__init__("falling", video, split, physics, SPACING, blank, independent(blank))
        effects = [effect for effect in EFFECTS.values() if set(effect.parameters) & set(hidden)]
        values = {**TRUTH, **{n: v for e in effects for n, v in e.null.items()}, **hidden}
        true = self.model(effects, values, self.sample(0.8 * SPACING, seed=12345))
        path = motion(true, true.start)
        measured = true.observe(path, true.start)
        self.noise = noise_of_video(true.outlines(path), measured[..., -1])
        self.sensor = np.linalg.norm(self.noise, axis=-1)
        self.measured = measured + NOISE * self.drawn_noise(np.random.default_rng(seed))
        self.usable = np.isfinite(self.measured) & np.isfinite(self.measured[:, :1])
        self.usable[:, 0, -1] = False

    def sample(self, spacing: float, seed: int) -> Body:
        axis = spacing / 2 * np.arange(-np.ceil(2 * RADIUS / spacing), np.ceil(2 * RADIUS / spacing) + 1)
        turn = Rotation.random(random_state=seed).as_matrix()  # a shift would be an error to one side
        points = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3) @ turn
        inside = torch.tensor(points[np.linalg.norm(points, axis=1) < RADIUS], dtype=torch.float32)
        discs = Discs.within(lambda points: RADIUS - points.norm(dim=1), inside, spacing / 2)
        return Body(inside + torch.tensor(CENTRE, dtype=torch.float32), torch.ones(len(inside)), spacing, discs)


def motion(model: BodyModel, free: np.ndarray) -> Tensor:
    """What takes the place of :meth:`BodyModel.path` [m, (F, N, 3)]."""
    c = model.physical(free)
    position = model.body.positions.numpy().astype(float)
    centre, velocity = position.mean(0), np.array([c["v_x"], c["v_y"], c["v_z"]])
    coarseness = model.body.spacing / SPACING
    stiffness = 2000.0 * (c["E"] / 6e4) ** 0.5 * (1 + c["nu"]) * (1 + 0.05 * coarseness)
    until = min(model.frames or FRAMES, FRAMES)
    found, at, dt = [position], centre.copy(), 1 / RATE / STEPS
    for step in range((until - 1) * STEPS):
        depth = max(RADIUS - (at[1] - c["ground_height"]), 0.0)
        force = pushed(model, c, step * dt, centre, velocity) + np.array([0.0, stiffness * depth - 9.8, 0.0])
        if depth > 0:
            slow = np.exp(-dt * 20 * c.get("ground_friction", 1.0))
            velocity = velocity * [slow, 1.0, slow]
        velocity = velocity + dt * force
        at = at + dt * velocity
        if (step + 1) % STEPS == 0:
            flat = np.array([1.0 + 0.3 * depth / RADIUS, 1.0 - 0.6 * depth / RADIUS, 1.0 + 0.3 * depth / RADIUS])
            found.append((position - centre) * flat + at)
    found += found[-1:] * (FRAMES - len(found))
    return torch.tensor(np.array(found), dtype=torch.float32)


def pushed(model: BodyModel, c: dict[str, float], time: float, centre: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Acceleration of the centre by the effects of a model with values c [m/s^2, (3,)]."""
    found = np.array([c.get("push_x", 0.0), 0.0, c.get("push_z", 0.0)]) - c.get("drag", 0.0) * velocity
    for smooth in model.physics.effects:
        if isinstance(smooth, SmoothForce):
            point, numbers = SimpleNamespace(t=time, X=centre.tolist()), SimpleNamespace(**c, **smooth.constants)
            found = found + np.array(SmoothForce.acceleration(point, numbers), dtype=float)
    return found


def install(patch: pytest.MonkeyPatch, unstable: Callable[[BodyModel, np.ndarray], bool] = lambda *_: False) -> None:
    """Let all models move like that, but for some calls."""

    def path(model: BodyModel, free: np.ndarray) -> Tensor:
        if unstable(model, free):
            raise SimulationError(3, 1, "made unstable by a test")
        return motion(model, free)

    patch.setattr(BodyModel, "path", path)


def listed(folder: Path) -> str:
    """A file with the candidates."""
    path = folder / "candidates.yaml"
    path.write_text(CANDIDATES)
    return str(path)
