"""What a finished phase knows of its particles at every frame, ready to be written."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from pacnerf_lpo.evaluation.prediction import StateRenderer, motion_of, to_bytes
from pacnerf_lpo.evaluation.run_directory import Run, Stage

DRAW_SEED = 0


@dataclass(frozen=True)
class Motion:
    """Particles at every frame.

    times: of the frames [s, (F,)]
    positions: [m, (F, N, 3), float32]
    velocities: [m/s, (F, N, 3), float32]
    colours: as displayed, seen from one side [0..255, (N, 3), uint8]
    density: raw volume density [(N,)]
    fraction: how much of a particle's volume is full [0..1, (N,)]
    numbers: which particles of the run they are [(N,)]
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    colours: np.ndarray
    density: np.ndarray
    fraction: np.ndarray
    numbers: np.ndarray

    def thinned(self, most: int | None) -> "Motion":
        """At most so many of the particles, drawn at random with a fixed seed: their order follows the cells."""
        if most is None or most >= len(self.numbers):
            return self
        kept = np.sort(np.random.default_rng(DRAW_SEED).choice(len(self.numbers), most, replace=False))
        own = {name: getattr(self, name)[kept] for name in ("colours", "density", "fraction", "numbers")}
        return replace(self, positions=self.positions[:, kept], velocities=self.velocities[:, kept], **own)


@dataclass(frozen=True)
class Subject:
    """What is exported: a finished phase of a run, read as it is needed.

    particles: at most so many particles; all when None.
    view: index of the camera that a film is seen from.
    """

    run: Run
    stage: Stage
    particles: int | None = None
    view: int = 0

    @cached_property
    def renderer(self) -> StateRenderer:
        """Appearance of the particles."""
        return StateRenderer(self.stage.state)

    @cached_property
    def positions(self) -> np.ndarray:
        """Of all particles [m, (F, N, 3), float32]."""
        return motion_of(self.run, self.stage)

    @cached_property
    def motion(self) -> Motion:
        """The particles to write."""
        state = self.stage.state
        times = self.run.data.video.times.numpy()[: len(self.positions)]
        velocities = frame_velocities(self.positions, self.run.physics.velocity_of(self.stage.state).numpy(), times)
        return Motion(
            times=times,
            positions=self.positions,
            velocities=velocities.astype(np.float32),
            colours=to_bytes(self.renderer.particle_colours()),
            density=state.density.numpy(),
            fraction=self.run.physics.fraction(state.massive(state.density), state.spacings).numpy(),
            numbers=np.arange(len(state.density)),
        ).thinned(self.particles)


def frame_velocities(positions: np.ndarray, initial: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Velocity at every frame [m/s, (F, N, 3)]: the known one at frame 0, second-order differences in time after it.

    Args:
        positions: [m, (F, N, 3)]
        initial: at frame 0 [m/s, (N, 3)]
        times: [s, (F,)]
    """
    if len(positions) < 2:
        return np.broadcast_to(initial, positions.shape)
    order: Literal[1, 2] = 2 if len(positions) > 2 else 1
    velocities = np.gradient(positions, times, axis=0, edge_order=order)
    velocities[0] = initial
    return velocities


def linear_light(colours: np.ndarray) -> np.ndarray:
    """Displayed colours [0..255] as linear light [0..1, float32]: the inverse of the sRGB curve, IEC 61966-2-1."""
    shown = colours.astype(np.float32) / 255
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4).astype(np.float32)
