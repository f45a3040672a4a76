"""What is under diagnosis: what was measured, what the model says, and where the two may be compared."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
import torch

from pacnerf_lpo.data.video_module import VideoData
from pacnerf_lpo.diagnosis import body as bodies
from pacnerf_lpo.diagnosis.body import Body
from pacnerf_lpo.diagnosis.layout import Layout
from pacnerf_lpo.diagnosis.model import MARGIN, Model, with_effects
from pacnerf_lpo.diagnosis.split import Split, split
from pacnerf_lpo.diagnosis.summaries import BRIGHTNESS, KINDS, mean_brightness, sensor_noise, summarise
from pacnerf_lpo.evaluation.prediction import StateRenderer
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.types import ParticleState, Video

PARTICLES = 4000
"""The body is sampled by about so many particles: fine enough for rebounds, and a rollout takes about a second."""
LARGEST_EROSION = 80.0
BISECTIONS = 9
LEAST_SHADING = 0.01


class Problem(ABC):
    """Measurements and the models that compete to explain them.

    Residuals are measured minus predicted summaries, made relative by :func:`relative`, so that an error of the
    reconstructed shape cancels to first order. Entries where either is missing are left out.

    Args:
        scene: its name.
        video: cameras, image size and time stamps.
        held: what is fitted and what is held out.
        physics: of the model that is questioned.
        voxel: node spacing [m] to which the time step of ``physics`` belongs; the shape is known to a part of it.
        measured: summaries of the outlines [pixels], and the brightness [(V, F, 11)]; NaN where missing.
        sensor: standard deviation of their noise [(V, F, 11)]
    """

    def __init__(
        self,
        scene: str,
        video: Video,
        held: Split,
        physics: Physics,
        voxel: float,
        measured: np.ndarray,
        sensor: np.ndarray,
    ):
        self.scene, self.video, self.split, self.physics, self.voxel = scene, video, held, physics, voxel
        self.measured, self.sensor = measured, sensor
        self.usable = np.isfinite(measured) & np.isfinite(measured[:, :1])
        self.usable[:, 0, -1] = False

    @property
    @abstractmethod
    def spacing(self) -> float:
        """Node spacing of the model [m]."""

    @property
    @abstractmethod
    def first_guess(self) -> dict[str, float]:
        """Physical parameters and velocity to start from [SI]."""

    @abstractmethod
    def sample(self, spacing: float, seed: int) -> Body:
        """The body at a node spacing [m], as another sampling for every seed."""

    @cached_property
    def body(self) -> Body:
        """The body at the resolution of the diagnosis."""
        return self.sample(self.spacing, seed=0)

    def model(self, effects: Sequence[Effect], known: dict[str, float], body: Body | None = None) -> Model:
        """A model with these effects that starts from known values, ``v_x``, ``v_y`` and ``v_z`` among them [SI]."""
        body = body or self.body
        return Model(body, with_effects(self.physics, effects, body.spacing, self.voxel), self.video, known)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Entries that are fitted [(V, F, 11), bool]."""
        return self.usable & self.split.fitted[..., None]

    def layout(self, mask: np.ndarray) -> Layout:
        """Names of the entries of a mask [(V, F, 11), bool]."""
        view, frame, kind = np.nonzero(mask)
        return Layout(view, frame, np.array([*KINDS, BRIGHTNESS])[kind])

    def residual(self, predicted: np.ndarray) -> np.ndarray:
        """Measured minus predicted [pixels; brightness 1; (V, F, 11)]; NaN where not usable."""
        return np.where(self.usable, relative(self.measured - predicted), np.nan)

    def residual_of(self, model: Model, mask: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Residual of a model at free coordinates, in the entries of a mask [(D,)]; 0 where the model loses sight."""

        def residual(free: np.ndarray) -> np.ndarray:
            return np.nan_to_num(self.residual(model.predict(free))[mask])

        return residual

    def at_rest(self, body: Body) -> np.ndarray:
        """Summaries of a body at frame 0 [pixels, (V, 10)]."""
        model = self.model((), self.first_guess, body)
        return summarise(model.outlines(body.positions[None]), MARGIN)[:, 0]


class StateProblem(Problem):
    """A particle state before the cameras of its video.

    Args:
        scene: its name.
        data: the video, prepared.
        state: supplies the body and the first guess of the motion.
        physics: of the model.
        held: what is fitted and what is held out.
        bright: compare the brightness, too.
        particles: the body is sampled by about so many.
    """

    def __init__(
        self,
        scene: str,
        data: VideoData,
        state: ParticleState,
        physics: Physics,
        held: Split,
        bright: bool = True,
        particles: int = PARTICLES,
    ):
        self.data, self.state, self.particles = data, state, particles
        outlines = summarise(data.video.silhouettes)
        brightness = self._measured_brightness() if bright else np.zeros(outlines.shape[:2])
        brightness -= np.median(brightness, axis=0)
        measured = np.concatenate((outlines, brightness[..., None]), axis=-1)
        sensor = np.concatenate((sensor_noise(outlines), shading(brightness)), axis=-1)
        super().__init__(scene, data.video, held, physics, state.spacing, measured, sensor)
        self.usable[..., -1] &= bright

    @cached_property
    def spacing(self) -> float:
        """Node spacing at which the body has the wanted number of particles [m]."""
        fine = bodies.resample(self.state, self.state.spacing, erosion=self.erosion)
        volume = float(fine.fraction.sum()) * (self.state.spacing / 2) ** 3
        return 2 * (volume / self.particles) ** (1 / 3)

    @cached_property
    def erosion(self) -> float:
        """Raw density above that of the visible surface at which matter begins: found by the areas of the outlines at
        frame 0 in the fitted views.
        """
        low, high = -4.0, LARGEST_EROSION
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            body = bodies.resample(self.state, self.state.spacing, erosion=middle)
            if len(body.positions) and self._oversize(body) > 0:
                low = middle
            else:
                high = middle
        return low

    def sample(self, spacing: float, seed: int) -> Body:
        """The body, eroded until it is as large as it looks at frame 0."""
        return bodies.resample(self.state, spacing, seed, self.erosion)

    @cached_property
    def first_guess(self) -> dict[str, float]:
        """Physical parameters and velocity of the state [SI]."""
        velocity = self.state.velocity.mean(0).tolist()
        known = {**self.physics.guess, **self.state.physics}
        return {**known, **dict(zip(("v_x", "v_y", "v_z"), velocity, strict=True))}

    def _oversize(self, body: Body) -> float:
        size = KINDS.index("size")
        differences = (self.at_rest(body)[:, size] - self.measured[:, 0, size])[self.split.views]
        seen = differences[np.isfinite(differences)]
        return float(np.median(seen)) if len(seen) else -np.inf

    def _measured_brightness(self) -> np.ndarray:
        """Logarithm of mean brightness beside that of the reconstruction at frame 0 [(V, F)]."""
        video, renderer = self.data.video, StateRenderer(self.state)
        grid = renderer.grid(self.state.positions)
        size = video.images.shape[2], video.images.shape[3]
        reference = [renderer.image(grid, self.data.rays(view), size) for view in range(len(video.images))]
        believed = torch.stack([mean_brightness(image, opacity) for image, opacity in reference])
        measured = mean_brightness(video.images, video.silhouettes)
        return (measured / believed[:, None]).clamp_min(1e-3).log().numpy().astype(float)


class RunProblem(StateProblem):
    """A run: its video and its model.

    Args:
        run: the run; its last phase supplies the body and the first guess of the motion.
        stem: another phase, such as ``01_velocity``.
        particles: the body is sampled by about so many.
    """

    def __init__(self, run: Run, stem: str | None = None, particles: int = PARTICLES):
        self.run, self.stem = run, stem
        state = run.stage(stem).state
        super().__init__(run.scene, run.data, state, run.physics, split(run.data), particles=particles)

    @property
    def fingerprint(self) -> bytes:
        """Differs for runs whose diagnosis may differ."""
        config = json.dumps([self.run.config["data"], self.run.config["physics"]], default=str)
        return self.run.stage(self.stem).state_path.read_bytes() + config.encode()


def shading(brightness: np.ndarray) -> np.ndarray:
    """How far views differ in brightness by themselves [(V, F, 1)], taken as one error for all frames of a view."""
    spread = 1.4826 * np.median(np.abs(brightness))
    return np.full((*brightness.shape, 1), max(spread, LEAST_SHADING) * np.sqrt(brightness.shape[1]))


def relative(difference: np.ndarray) -> np.ndarray:
    """Differences of summaries [(..., V, F, 11)], of outlines relative to frame 0 of their view; in frame 0 itself, and
    for the brightness in every frame, relative to the median of all views, which a common bias moves alike.
    """
    found = difference.copy()
    found[..., :-1] -= difference[..., :, :1, :-1]
    found[..., :, 0, :-1] = beside_median(difference[..., :, 0, :-1])
    found[..., -1] = beside_median(difference[..., -1])
    return found


def beside_median(values: np.ndarray) -> np.ndarray:
    """Values [(..., V, K)] less their median over views."""
    return values - np.nanmedian(values, axis=-2, keepdims=True)
