"""The physical model of a run, as configured in YAML: material, ground, effects, and how finely time is resolved."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from types import SimpleNamespace
from typing import Any, Literal, cast

import torch
from torch import Tensor

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.mpm.effects.base import Effect, InitialState
from pacnerf_lpo.mpm.ground import Ground, Sticky
from pacnerf_lpo.mpm.materials.auto import Auto
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.neo_hookean import NeoHookean
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.simulator import Simulator, check_model
from pacnerf_lpo.scene.activation import alpha, solid_fraction
from pacnerf_lpo.types import ParticleState

MAX_HALVINGS = 3
LEAST_OPACITY = 1e-4  # keeps the mass of a faint particle positive in float32
GROUND_HEIGHT = Parameter("ground_height", "m", Identity(), (-10.0, 10.0), "height of the ground", scale=0.01)


class Physics:
    """A material on a ground under gravity, with the physical effects in addition to them.

    Args:
        material: constitutive law with the initial guess of its parameters; ``auto``: the recording decides, see
            :class:`~pacnerf_lpo.mpm.materials.auto.Auto`.
        ground: boundary condition at y = 0; sticky when not given.
        effects: additional physical effects.
        rho: mass density of the full material [kg/m^3].
        substep_rate: integration steps per second [1/s].
        frame_rate: video frames per second [1/s].
        gravity: acceleration by gravity [m/s^2].
        ground_height: height of the ground plane [m].
        fit_ground_height: identify the height with the other parameters. A body in contact floats above an MPM boundary
            by about half a grid spacing, so a model coarser than what it is compared with needs a lower ground.
        mass_from: what the mass and the stiffness of a particle follow. ``alpha``: its alpha over unit length
            (PAC-NeRF); ``opacity``: the part of it that is inside the surface that is seen, so that the body weighs
            what it shows, which counts on coarse grids, and half the volume is half the force; ``outline``: the same
            with the surface moved until the body is as large as the mattes of the training views at frame 0 are, for
            images so coarse that a visible surface is uncertain by a good part of a voxel.
        ground_error: how far the ground may be from ``ground_height`` [m], as that was measured; 0: it is known.
    """

    def __init__(
        self,
        material: Material | Literal["auto"],
        ground: Ground | None = None,
        effects: Sequence[Effect] = (),
        rho: float = 1000.0,
        substep_rate: float = 4800.0,
        frame_rate: float = 24.0,
        gravity: tuple[float, float, float] = (0.0, -9.8, 0.0),
        ground_height: float = 0.0,
        fit_ground_height: bool = False,
        mass_from: Literal["alpha", "opacity", "outline"] = "alpha",
        ground_error: float = 0.0,
    ):
        for name, value in (("rho", rho), ("substep_rate", substep_rate), ("frame_rate", frame_rate)):
            if not (value > 0 and math.isfinite(value)):
                raise UserInputError(f"physics.{name} = {value:g}: give a positive number")
        if substep_rate < frame_rate:
            raise UserInputError(
                f"physics.substep_rate = {substep_rate:g} 1/s is below frame_rate = {frame_rate:g} 1/s; "
                "give at least one substep per frame"
            )
        self.material: Material = Auto() if material == "auto" else cast(Material, material)
        self.ground, self.effects = ground or Sticky(), tuple(effects)
        self.rho, self.substep_rate, self.frame_rate, self.gravity = rho, substep_rate, frame_rate, gravity
        self.ground_height = GROUND_HEIGHT.check(ground_height, "physics.ground_height")
        if not 0 <= ground_error < math.inf:
            raise UserInputError(f"physics.ground_error = {ground_error:g} m: give 0 or a positive number")
        self.ground_error, self.fit_ground_height, self.mass_from = ground_error, fit_ground_height, mass_from
        try:
            check_model("physics", self.material if self.decided else NeoHookean(), self.ground, self.effects)
        except UserInputError as error:
            if self.decided:
                raise
            raise UserInputError(f"physics.material: auto, but {error}; give the material instead of auto") from None
        self.halvings, self.most_halvings = 0, MAX_HALVINGS
        self._simulators: dict[tuple, Simulator] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Simulators belong to the process that made them."""
        return {**vars(self), "_simulators": {}}

    @property
    def decided(self) -> bool:
        """Whether the law is known; else laws compete for it."""
        return not isinstance(self.material, Auto)

    def known(self, values: Mapping[str, float]) -> dict[str, float]:
        """Of values by name [SI], those that are not of a law that only stands in."""
        return {n: v for n, v in values.items() if self.decided or n not in self.material.parameters}

    @property
    def candidates(self) -> "list[Physics]":
        """The model with every law that competes and suits ground and effects; itself, where the law is known."""
        found = []
        for law in self.material.laws if isinstance(self.material, Auto) else ():
            with suppress(UserInputError):
                found.append(self.of(law))
        return found or [self]

    def of(self, material: Material) -> "Physics":
        """The same model of another material. Raises UserInputError where ground or effects do not suit it."""
        check_model("physics", material, self.ground, self.effects)
        found = copy(self)
        found.material, found._simulators, found.halvings = material, {}, 0
        return found

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Every physical parameter of the material, the ground and the effects, by name."""
        of_effects = {name: one for effect in self.effects for name, one in effect.parameters.items()}
        return {**self.material.parameters, GROUND_HEIGHT.name: GROUND_HEIGHT, **of_effects}

    @property
    def guess(self) -> dict[str, float]:
        """Initial value of every parameter [SI]."""
        of_effects = {name: value for effect in self.effects for name, value in effect.guess.items()}
        return {**self.material.guess, GROUND_HEIGHT.name: self.ground_height, **of_effects}

    @property
    def free_names(self) -> list[str]:
        """Names of the parameters that are identified."""
        ground = [GROUND_HEIGHT.name] if self.fit_ground_height else []
        return [*self.material.free_names, *ground, *(name for effect in self.effects for name in effect.parameters)]

    @property
    def substeps(self) -> int:
        """Integration steps per frame, after the halvings of the step so far."""
        return math.ceil(self.substep_rate / self.frame_rate - 1e-9) * 2**self.halvings

    def rollout(
        self,
        positions: Tensor,
        velocity: Tensor,
        density: Tensor,
        parameters: Mapping[str, Tensor],
        spacings: tuple[float, float],
        frames: int,
    ) -> Tensor:
        """Positions at every frame, differentiable in all tensors.

        Mass is rho * alpha * V with V = (dx/2)^3, and the moduli scale with alpha^3 (PAC-NeRF), where alpha is that of
        a radiance field; with any other ``mass_from`` it is the part of V that is full, and they scale with that. A
        rollout that becomes unstable is repeated with half the time step, at most three times; the halved step is kept.

        Args:
            positions: at frame 0 [m, (N, 3)]
            velocity: at frame 0 [m/s, (N, 3)]
            density: raw volume density of the particles, less the surface offset of their state [(N,)]
            parameters: every parameter by name [SI, scalars]
            spacings: grid spacing of the particles, and the coarsest one dx0 [m]
            frames: number of frames, the first included.

        Returns:
            [m, (frames, N, 3)]

        Raises:
            SimulationError: still unstable after the last halving.
        """
        fraction = self.fraction(density, spacings)
        return self.motion(positions, velocity, fraction, self._stiffness(fraction), parameters, spacings[0], frames)

    def motion(
        self,
        positions: Tensor,
        velocity: Tensor,
        fraction: Tensor,
        stiffness: Tensor,
        parameters: Mapping[str, Tensor],
        spacing: float,
        frames: int,
    ) -> Tensor:
        """:meth:`rollout` of particles of which a ``fraction`` [0..1, (N,)] of (spacing/2)^3 is full.

        ``stiffness`` [1, (N,)] is a factor on their moduli, which act on the volume (spacing/2)^3.
        """
        mass = self.rho * (spacing / 2) ** 3 * fraction
        material = {name: parameters[name] for name in self.material.parameters}
        moving = [effect for effect in self.effects if effect.acts_on_motion]
        extra = {name: parameters[name] for effect in moving for name in effect.parameters}
        ground = parameters[GROUND_HEIGHT.name] * positions.new_tensor([0.0, 1.0, 0.0])
        above = positions - ground
        while True:
            try:
                return self._simulator(spacing)(above, velocity, mass, stiffness, material, frames, extra) + ground
            except SimulationError:
                if self.halvings >= self.most_halvings:
                    raise
                self.halvings += 1

    def initial_velocity(
        self,
        positions: Tensor,
        velocity: Tensor,
        density: Tensor,
        parameters: Mapping[str, Tensor],
        spacings: tuple[float, float],
    ) -> Tensor:
        """Velocity at frame 0 with the effects on the initial state [m/s, (N, 3)]; arguments as of :meth:`rollout`."""
        mass = self.fraction(density, spacings)
        stiffness = self._stiffness(mass)
        for effect in (e for e in self.effects if isinstance(e, InitialState)):
            values = {name: parameters[name] for name in effect.parameters}
            values |= {name: torch.tensor(value) for name, value in effect.constants.items()}
            velocity, mass, stiffness = effect.apply(positions, velocity, mass, stiffness, SimpleNamespace(**values))
        return velocity

    def velocity_of(self, state: ParticleState) -> Tensor:
        """The :meth:`initial_velocity` of a state with its :meth:`values` [m/s, (N, 3)]."""
        density, values = state.massive(state.density), self.values(state)
        return self.initial_velocity(state.positions, state.velocity, density, values, state.spacings)

    def fraction(self, density: Tensor, spacings: tuple[float, float]) -> Tensor:
        """How much of (dx/2)^3 is full [0..1, (N,)]."""
        opacity = alpha(density, 1.0) if self.mass_from == "alpha" else solid_fraction(density, *spacings)
        return opacity.clamp_min(LEAST_OPACITY)

    def _stiffness(self, fraction: Tensor) -> Tensor:
        """Factor on the moduli of particles that are full to a fraction [1, (N,)]: half the volume is half the force;
        the faint rim of a radiance field resists less than that.
        """
        return fraction**3 if self.mass_from == "alpha" else fraction

    def values(self, state: ParticleState) -> dict[str, Tensor]:
        """Every parameter by name, as the state knows it, else as guessed at first [SI, scalars]."""
        return {name: torch.tensor(value) for name, value in {**self.guess, **state.physics}.items()}

    def simulate(self, state: ParticleState, frames: int) -> Tensor:
        """Positions of a state at every frame, with its :meth:`values`, without gradients [m, (frames, N, 3)]."""
        with torch.no_grad():
            density = state.massive(state.density)
            return self.rollout(state.positions, state.velocity, density, self.values(state), state.spacings, frames)

    def _simulator(self, spacing: float) -> Simulator:
        key = (spacing, self.substeps)
        if key not in self._simulators:
            self._simulators[key] = Simulator(
                self.material,
                self.ground,
                dx=spacing,
                substeps=self.substeps,
                frame_dt=1 / self.frame_rate,
                gravity=self.gravity,
                effects=self.effects,
            )
        return self._simulators[key]
