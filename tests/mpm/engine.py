"""The engine behind the signature the tests share with the twin."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from pacnerf_lpo.mpm import materials
from pacnerf_lpo.mpm.effects import BodyForce, LinearDrag, Magnus
from pacnerf_lpo.mpm.ground import Ground, Separate, Slip, Sticky
from pacnerf_lpo.mpm.simulator import Simulator
from tests.mpm.scenes import BY_NAME, DT, DX, FRAMES, SUBSTEPS, Particles


@dataclass(frozen=True)
class Setup:
    """A case of scenes.py on a ground, with the coefficients that are differentiated when given: drag [1/s], friction
    [1], magnus [1]; the latter with the spin of each particle, or a given one [rad/s].
    """

    name: str
    ground: str = "sticky"
    drag: float | None = None
    friction: float | None = None
    magnus: float | None = None
    spin: tuple[float, float, float] | None = None
    gravity: tuple[float, float, float] = (0.0, -9.8, 0.0)
    dx: float = DX
    dt: float = DT
    substeps: int = SUBSTEPS
    speed: float = 1.0

    def coefficients(self, requires_grad: bool = False) -> dict[str, Tensor]:
        """Coefficients of effects and ground as float64 scalars."""
        given = {"drag": self.drag, "friction": self.friction, "magnus": self.magnus}
        return {
            k: torch.tensor(v, dtype=torch.float64, requires_grad=requires_grad)
            for k, v in given.items()
            if v is not None
        }

    def simulator(self, dtype: str = "f64") -> Simulator:
        """The engine's simulator of this set-up, keeping no more than one frame of substeps."""
        case = BY_NAME[self.name]
        ground: Ground = (
            {"sticky": Sticky, "slip": Slip}[self.ground]() if self.friction is None else Separate(self.friction)
        )
        effects: list[BodyForce] = [] if self.drag is None else [LinearDrag()]
        effects += [] if self.magnus is None else [Magnus(spin=self.spin)]
        return Simulator(
            getattr(materials, case.law)(**case.parameters),
            ground,
            dx=self.dx,
            substeps=self.substeps,
            frame_dt=self.dt * self.substeps,
            gravity=self.gravity,
            effects=effects,
            dtype=dtype,
            memory=0,
        )


def run_engine(
    setup: Setup,
    particles: dict[str, Tensor],
    parameters: dict[str, Tensor],
    coefficients: dict[str, Tensor],
    frames: int = FRAMES,
    dtype: str = "f64",
) -> Tensor:
    """Positions at every frame [m, (frames, N, 3)]."""
    real = {"f64": torch.float64, "f32": torch.float32}[dtype]
    x, v, mass, stiffness = (particles[k].to(real) for k in ("positions", "velocity", "mass", "stiffness"))
    of_effects = {k: v for k, v in coefficients.items() if k != "friction"}
    of_ground = {k: v for k, v in coefficients.items() if k == "friction"}
    return setup.simulator(dtype)(x, v, mass, stiffness, {**parameters, **of_ground}, frames, of_effects)


def simulate(setup: Setup, particles: Particles, frames: int = FRAMES, dtype: str = "f64", **changed: float) -> Tensor:
    """Roll a set-up out without gradients; ``changed`` replaces parameter values."""
    parameters = {**BY_NAME[setup.name].parameters, **changed}
    values = {k: torch.tensor(v, dtype=torch.float64) for k, v in parameters.items()}
    return run_engine(setup, vars(particles), values, setup.coefficients(), frames, dtype).double()
