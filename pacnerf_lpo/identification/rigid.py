"""A rigid body in flight whose positions were measured: one problem for each recording, several are a study.

Its unknowns are where the flight begins, and its velocity there, or, of a body that is held at first and let go, the
time of its release: no velocity jumps as a hand opens. Coordinates that were not measured are taken as if the body did
not move along them.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.data.shapes import Shape, fill
from pacnerf_lpo.data.trajectories.noise import Noise
from pacnerf_lpo.data.trajectories.trajectory import AXES
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.forward_model import VELOCITY, Model, with_effects
from pacnerf_lpo.identification.points import COLUMNS, TRACK_KINDS, Points
from pacnerf_lpo.identification.problem import Problem, independent
from pacnerf_lpo.identification.silhouette_moments import KINDS
from pacnerf_lpo.identification.split import HELD_FRAMES, Split
from pacnerf_lpo.mpm.effects.base import BodyForce, Effect
from pacnerf_lpo.mpm.materials.rigid import Rigid
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.mpm.rigid_body import fly
from pacnerf_lpo.types import Video

UNIT = 1e-3
"""Residuals are counted in millimetres [m]."""
PLACE = tuple(Parameter(f"{axis}_0", "m", Identity(), (-1e3, 1e3), f"start along {axis}", spread=1.0) for axis in AXES)
SPEED = tuple(replace(parameter, spread=1.0) for parameter in VELOCITY)
"""As of a body before cameras, whose outlines are less precise."""
RELEASE = Parameter("release", "s", Identity(), (-1.0, 1e3), "time of the release", spread=0.5)
"""It may lie before the first sample: a recording can begin as the body has just been let go."""
ACROSS = 6.0
"""Particles of the body along its reach: it is drawn and compared with others, its motion does not depend on them."""
CALIBRATED = 0.01
"""Of the distance that is covered: standard deviation of what a scale that was placed by hand, a perspective and a lens
leave in positions from images."""
SHORT_DROP = (1.0, 0.5)
"""Length [m] and time [s] of the motions for which effects state the sizes at which they are tried."""
POWERS: dict[str, Callable[[float, float], float]] = {
    "1/m": lambda length, time: 1 / length,
    "1/s": lambda length, time: 1 / time,
    "1/s^2": lambda length, time: 1 / time**2,
}
"""By the unit of a coefficient, how it changes with length and time of a motion under the same gravity."""
KEPT = 4
"""Flights that a model remembers: those of a study change one recording at a time."""


@dataclass(frozen=True)
class Flight:
    """A measured flight of a known body.

    name: of the recording.
    times: since the first sample [s, (F,)]
    positions: of its centre, y up [m, (F, 3)]; NaN where a coordinate was not measured
    noise: of every coordinate that was measured, None for the others.
    shape, mass: of the body; kg
    held: whether it is held at first, and let go from rest some time later.
    guess: start, velocity and release [SI], by the names of the unknowns.
    spin: angular velocity that was measured [rad/s, (3,)]; None: it was not.
    source: where it was read from, for messages.
    """

    name: str
    times: np.ndarray
    positions: np.ndarray
    noise: tuple[Noise | None, ...]
    shape: Shape
    mass: float
    held: bool
    guess: dict[str, float]
    spin: tuple[float, float, float] | None = None
    source: str = ""

    @property
    def unknowns(self) -> tuple[Parameter, ...]:
        """Of the motion, those along coordinates that were measured. A change is noticeable that moves the body by as
        much as its position is uncertain, at the start or at the end.
        """
        sizes = {axis: noise.size for axis, noise in enumerate(self.noise) if noise is not None}
        duration = float(self.times[-1] - self.times[0])
        places = [replace(PLACE[axis], scale=size) for axis, size in sizes.items()]
        if not self.held:
            return (*places, *(replace(SPEED[axis], scale=size / duration) for axis, size in sizes.items()))
        fastest = float(np.nanmax(np.ptp(self.positions[:, list(sizes)], axis=0))) / duration
        return (*places, replace(RELEASE, scale=max(sizes.values()) / fastest))


@dataclass(frozen=True)
class Centre:
    """Measured positions of a body's centre as one row of a problem, in :data:`UNIT` from what was measured."""

    flight: Flight
    pixel: float = UNIT
    from_first_sight: bool = False

    @property
    def names(self) -> list[str]:
        """Of the row [1]."""
        return ["point centre"]

    @property
    def kinds(self) -> np.ndarray:
        """Names of the entries [(1, 11), str]."""
        found = np.full((1, COLUMNS), "", dtype=object)
        found[0, : len(TRACK_KINDS)] = TRACK_KINDS
        return found

    @property
    def measured(self) -> np.ndarray:
        """0 where something was measured, else NaN [(1, F, 11)]."""
        return _row(0.0 * self.flight.positions)

    @property
    def sensor(self) -> np.ndarray:
        """Standard deviation of the white noise [mm, (1, F, 11)]; NaN where nothing was measured."""
        sigma = np.array([np.nan if noise is None else noise.white for noise in self.flight.noise])
        return _row(0.0 * self.flight.positions + sigma) / UNIT

    def predict(self, path: Tensor) -> np.ndarray:
        """How far a motion [m, (F, N, 3)] is from what was measured [mm, (1, F, 11)]; NaN where nothing was."""
        return self.difference(path.mean(1).numpy())

    def difference(self, centre: np.ndarray) -> np.ndarray:
        """The same by the centre [m, (F, 3)]."""
        return _row(centre - self.flight.positions) / UNIT


class RigidModel(Model):
    """The flight of a rigid body.

    Args:
        flight: what was measured of it.
        body: its particles around its centre.
        physics: the forces on it.
        video: without cameras.
        known: values to start from [SI].
    """

    def __init__(self, flight: Flight, body: Body, physics: Physics, video: Video, known: dict[str, float]):
        self.flight, self.motion, self._centre_of = flight, flight.unknowns, Centre(flight)
        super().__init__(body, physics, video, known, self._centre_of)  # type: ignore[arg-type]

    def __getstate__(self) -> dict:
        """What was flown is computed again in another process."""
        return {name: value for name, value in vars(self).items() if name != "_flown"}

    def contact(self, free: np.ndarray, within: float) -> int:
        """It touches nothing."""
        return self.shape[1]

    def path(self, free: np.ndarray) -> Tensor:
        """Particles at every sample [m, (F, N, 3)]. Raises SimulationError."""
        return torch.from_numpy(self.centre(free))[:, None] + self.body.positions

    def predict(self, free: np.ndarray) -> np.ndarray:
        """By the motion of the centre alone."""
        return self._centre_of.difference(self.centre(free))

    def observe(self, path: Tensor, free: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
        """By the centre of the particles."""
        return self._centre_of.predict(path) if before is None else before.copy()

    def centre(self, free: np.ndarray) -> np.ndarray:
        """Of the body at every sample [m, (F, 3)]. Raises SimulationError."""
        return self._flown(free.tobytes())

    @cached_property
    def _flown(self) -> Callable[[bytes], np.ndarray]:
        """The last flights, by the bytes of their free coordinates."""
        return lru_cache(KEPT)(lambda free: self._fly(np.frombuffer(free)))

    def _fly(self, free: np.ndarray) -> np.ndarray:
        values, times = self.physical(free), self.flight.times
        own = {parameter.name for parameter in self.motion}
        place, velocity = (
            np.array([values[p.name] if p.name in own else 0.0 for p in parameters]) for parameters in (PLACE, SPEED)
        )
        release = values[RELEASE.name] if self.flight.held else float(times[0])
        flying = times > release
        moments = np.concatenate(([release], times[flying]))
        effects = [effect for effect in self.physics.effects if isinstance(effect, BodyForce)]
        found = np.tile(place, (len(times), 1))
        if flying.any():
            spin = self.flight.spin or (0.0, 0.0, 0.0)
            found[flying] = fly(effects, values, self.physics.gravity, (place, velocity), spin, moments)[1:]
        return found


class RigidProblem(Problem):
    """One recording of a rigid body in flight. Its last samples are held out.

    Args:
        flight: what was measured.
        gravity: [m/s^2, (3,)]
        effects: of the model.
    """

    deforms = False

    def __init__(
        self, flight: Flight, gravity: tuple[float, float, float] = (0.0, -9.81, 0.0), effects: Sequence[Effect] = ()
    ):
        self.flight, count = flight, len(flight.times)
        rate = (count - 1) / float(flight.times[-1] - flight.times[0])
        none = np.zeros((0, count, len(KINDS) + 1))
        split = Split(np.zeros(0, bool), np.arange(count) < count - HELD_FRAMES)
        physics = Physics(Rigid(), effects=effects, substep_rate=rate, frame_rate=rate, gravity=gravity)
        video = without_cameras(flight.times, flight.source)
        points: Points = Centre(flight)  # type: ignore[assignment]
        super().__init__(flight.name, video, split, physics, self.spacing, none, independent(none), points)

    @property
    def spacing(self) -> float:
        return self.flight.shape.reach / ACROSS

    @property
    def least_shape_error(self) -> float:
        """The shape is known, and its flight does not depend on it."""
        return 0.0

    @cached_property
    def first_guess(self) -> dict[str, float]:
        """What the samples themselves say of the motion [SI]."""
        return {**self.physics.guess, **self.flight.guess}

    def sample(self, spacing: float, seed: int) -> Body:
        """Particles around the centre; the same for every spacing and seed."""
        particles = fill(self.flight.shape, 2 * self.spacing, torch.Generator().manual_seed(0)).double()
        return Body.full(particles - particles.mean(0), self.spacing)

    @cached_property
    def coarse_body(self) -> Body:
        return self.body

    def adopt(self, effect: Effect) -> Effect:
        """An effect whose coefficients are tried at sizes that do as much in this flight as theirs do in a video of a
        short drop, for which they are stated: a drag per metre a tenth as large in a flight ten times as long.
        """
        kind, found = type(effect), copy(effect)
        path = np.diff(np.nan_to_num(self.flight.positions), axis=0)
        ratios = np.linalg.norm(path, axis=1).sum() / SHORT_DROP[0], self.flight.times[-1] / SHORT_DROP[1]
        factors = {name: POWERS.get(p.unit, lambda *_: 1.0)(*ratios) for name, p in kind.parameters.items()}
        found.parameters = {n: replace(p, scale=p.scale * factors[n]) for n, p in kind.parameters.items()}
        found.probes = tuple({n: factors[n] * value for n, value in probe.items()} for probe in kind.probes)
        return found

    def model(self, effects: Sequence[Effect], known: dict[str, float], body: Body | None = None) -> Model:
        adopted = [self.adopt(effect) for effect in effects if effect.probes]
        others = [effect for effect in effects if not effect.probes]
        physics = with_effects(self.physics, [*adopted, *others], self.spacing, self.spacing)
        return RigidModel(self.flight, self.body, physics, self.without_pictures, known)

    @property
    def measuring_errors(self) -> np.ndarray:
        """Errors of the calibration, see :data:`CALIBRATED` [mm, (1, F, 11, M)]: along each coordinate that was
        measured, one that grows with the path that is covered, as a wrong scale makes it, and one that bends it, as a
        lens does.
        """
        positions = np.nan_to_num(self.flight.positions)
        path = np.append(0.0, np.linalg.norm(np.diff(positions, axis=0), axis=1).cumsum())
        share, size = path / max(path[-1], 1e-9), CALIBRATED * float(np.ptp(positions, axis=0).max()) / UNIT
        found = [
            size * shape[:, None] * np.eye(3)[axis]
            for axis in np.flatnonzero([noise is not None for noise in self.flight.noise])
            for shape in (share, 2 * share * (1 - share))
        ]
        return np.nan_to_num(np.stack([_row(column) for column in found], axis=-1))

    def lasting_noise(self, random: np.random.Generator) -> np.ndarray:
        """As the noise of the flight says [mm, (1, F, 11)]."""
        found = super().lasting_noise(random)
        for axis, noise in enumerate(self.flight.noise):
            if noise is not None:
                found[0, :, axis] = self._slow_roots[axis] @ random.standard_normal(len(self.flight.times))
        return found

    def noise_parts(self, sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of white noise [mm, (1, F, 11, 11)], and of what lasts, with a part of the columns for each coordinate [mm,
        (1, F, 11, 3 F)]: both are known, so that replicates need not show them.
        """
        frames = sensor.shape[1]
        lasting = np.zeros((*sensor.shape, len(AXES) * frames))
        for axis, root in enumerate(self._slow_roots):
            lasting[0, :, axis, axis * frames : (axis + 1) * frames] = root
        return independent(sensor), lasting

    @cached_property
    def _slow_roots(self) -> np.ndarray:
        """Of the covariance of what lasts, by coordinate [mm, (3, F, F)]; zero where nothing was measured."""
        times, none = self.flight.times, np.zeros((len(self.flight.times),) * 2)
        return np.stack([none if noise is None else noise.slow_root(times) / UNIT for noise in self.flight.noise])

    @property
    def fingerprint(self) -> bytes:
        """Differs where the diagnosis may differ."""
        flight = self.flight
        said = [flight.noise, flight.mass, flight.shape.reach, flight.held, flight.guess, flight.spin]
        effects = [(type(effect).__name__, effect.guess) for effect in self.physics.effects]
        text = repr([*said, self.physics.gravity, effects])
        return flight.times.tobytes() + flight.positions.tobytes() + text.encode()


def without_cameras(times: np.ndarray, source: str) -> Video:
    """Time stamps [s, (F,)] as a video of no views."""
    return Video(
        **Video.no_pictures(0, len(times), 1, 1),
        camera_to_world=torch.zeros(0, 3, 4),
        intrinsics=torch.zeros(0, 3, 3),
        times=torch.as_tensor(times),
        view_ids=(),
        frame_ids=tuple(range(len(times))),
        source=source,
    )


def _row(positions: np.ndarray) -> np.ndarray:
    """Numbers for three coordinates [(F, 3)] as a row of 11 entries [(1, F, 11)]."""
    return np.pad(positions, ((0, 0), (0, COLUMNS - 3)), constant_values=np.nan)[None]
