"""What is under diagnosis: what was measured, what the model says, and where the two may be compared."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.prediction import StateRenderer
from pacnerf_lpo.identification import body as bodies
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.forward_model import MARGIN, BodyModel, Model, with_effects
from pacnerf_lpo.identification.points import Points
from pacnerf_lpo.identification.shape_modes import ShapeModes
from pacnerf_lpo.identification.silhouette_moments import (
    BRIGHTNESS,
    KINDS,
    mean_brightness,
    sensor_noise,
    silhouette_moments,
)
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.identification.surface import Lines, density_at_edges, density_of, seen_by, signed_distance
from pacnerf_lpo.identification.unbounded import Unbounded, value_at
from pacnerf_lpo.inference.layout import AT_REST, Layout
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.scene.activation import surface_density
from pacnerf_lpo.types import FieldGrid, ParticleState, Video

PARTICLES = 4000
"""The body is sampled by about so many particles: fine enough for rebounds, and a rollout takes about a second."""
COARSER = 1.4
"""Node spacing of the coarse body relative to the problem's: a rollout costs a third. Searches begin on it, small
smooth forces are tried on it, and half of the variance of errors of the shape is its own."""
LEAST_OFFSET = -4.0
"""Of the raw density at the surface from that of the visible one: below that there is only haze."""
KEPT = 4
"""Samplings of the body."""
LEAST_SHADING = 0.01
LEAST_SHAPE_ERROR = 0.15
"""Of a reconstructed surface, in voxels of the run: what lies between two voxels is interpolated."""
MODEL_ERROR = 0.1
"""Error of a moment that the model makes, before replicates measure it [pixels]."""


@dataclass(frozen=True)
class Part:
    """One recording of a problem with what a model of the problem says of it.

    name: of the recording.
    recording: itself a problem.
    effects: of the model, as the recording names them.
    known: every value that concerns it, velocity included, as the recording names them [SI].
    """

    name: str
    recording: "Problem"
    effects: tuple[Effect, ...]
    known: dict[str, float]

    @property
    def model(self) -> Model:
        """Of the recording, starting from what is known."""
        return self.recording.model(self.effects, self.known)


class Problem(ABC):
    """Measurements and the models that compete to explain them.

    Residuals are measured minus predicted moments of the outlines, made relative by :func:`relative`, so that an error
    of the reconstructed shape cancels to first order. Entries where either is missing are left out.

    Args:
        scene: its name.
        video: cameras, image size and time stamps.
        held: what is fitted and what is held out.
        physics: of the model that is questioned.
        voxel: node spacing [m] to which the time step of ``physics`` belongs; the shape is known to a part of it.
        measured: moments of the outlines [pixels], and the brightness [(V, F, 11)]; NaN where missing.
        noise: a root of the covariance of their noise in one view and frame [(V, F, 11, 11)]
        points: measured in addition to the video; ``measured``, ``noise`` and all residuals get R rows of theirs
            behind those of the views.

    Attributes:
        sensor: standard deviation of the noise [(V + R, F, 11)]
        relative: differences of moments [(..., V + R, F, 11)] as they are compared, see :func:`relative`.
    """

    def __init__(
        self,
        scene: str,
        video: Video,
        held: Split,
        physics: Physics,
        voxel: float,
        measured: np.ndarray,
        noise: np.ndarray,
        points: Points | None = None,
    ):
        self.scene, self.video, self.split, self.physics, self.voxel = scene, video, held, physics, voxel
        self.measured, self.noise, self.points = measured, noise, points
        self.usable = np.isfinite(measured) & np.isfinite(measured[:, :1])
        self.usable[:, 0, -1] = False
        anchored = points is None or points.from_first_sight
        self.relative: Callable[[np.ndarray], np.ndarray] = partial(relative, views=self.views, anchored=anchored)
        if points is not None:
            found = points.measured
            self.measured = np.concatenate((measured, found))
            self.noise = np.concatenate((noise, independent(points.sensor)))
            finite = np.isfinite(found)
            self.usable = np.concatenate((self.usable, finite & ~first_sight(found) if anchored else finite))
            if not len(held.points):
                self.split = replace(held, points=np.ones(len(found), bool))
        self.sensor = np.linalg.norm(self.noise, axis=-1)

    deforms: ClassVar[bool] = True
    """Whether the body does; else it is rigid and in flight: it touches nothing, and only a force on all of it acts."""

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

    @property
    def guess(self) -> dict[str, float]:
        """Physical parameters as the user guessed them [SI]."""
        return self.physics.guess

    def parts(self, effects: Sequence[Effect], known: dict[str, float]) -> list[Part]:
        """What a model with these effects and values [SI] says of each recording."""
        return [Part(self.scene, self, tuple(effects), known)]

    def join(self, arrays: Sequence[np.ndarray], axis: int = 0) -> np.ndarray:
        """Arrays of the recordings (..., rows, frames, ...) as one; ``axis`` is that of the rows."""
        return arrays[0]

    def part_of(self, values: np.ndarray, number: int, axis: int = 0) -> np.ndarray:
        """What concerns one recording in an array (..., rows, frames, ...); ``axis`` is that of the rows."""
        return values

    def adopt(self, effect: Effect) -> Effect:
        """An effect with its coefficients declared as this problem has them."""
        return effect

    @cached_property
    def body(self) -> Body:
        """The body at the resolution of the diagnosis."""
        return self.sample(self.spacing, seed=0)

    @cached_property
    def coarse_body(self) -> Body:
        """The body at :data:`COARSER` times the resolution of the diagnosis."""
        return self.sample(COARSER * self.spacing, seed=0)

    @cached_property
    def without_pictures(self) -> Video:
        """The video without its pictures, small enough to be copied with every model."""
        return replace(self.video, **Video.no_pictures(*self.video.silhouettes.shape))

    @abstractmethod
    def model(self, effects: Sequence[Effect], known: dict[str, float], body: Body | None = None) -> Model:
        """A model with these effects that starts from known values, ``v_x``, ``v_y`` and ``v_z`` among them [SI]; of
        the body of the problem, when none is given.
        """

    def coarse_model(self, effects: Sequence[Effect], known: dict[str, float]) -> Model:
        """The same on the coarse body."""
        return self.model(effects, known, self.coarse_body)

    @property
    def measuring_errors(self) -> np.ndarray:
        """Changes of the residual by what may be wrong with the measurement as a whole, of one standard deviation each
        [(V + R, F, 11, M)]; none where its noise is all.
        """
        return np.zeros((*self.usable.shape, 0))

    def drawn_noise(self, random: np.random.Generator) -> np.ndarray:
        """Noise of the sensor as another recording of the same would have it [pixels, (V + R, F, 11)]."""
        return np.einsum("vfkq,vfq->vfk", self.noise, random.standard_normal(self.sensor.shape))

    def lasting_noise(self, random: np.random.Generator) -> np.ndarray:
        """Errors that last from sample to sample, as another measurement would have them besides those of the sensor
        [(V + R, F, 11)]; none unless said.
        """
        return np.zeros(self.sensor.shape)

    def wrong_bodies(self, body: Body, sigma: float) -> list[Body]:
        """A sampling of the body with one more error of its shape each, of one standard deviation, where its surface
        may be so far from the true one [m]; the body itself where an error leaves nothing of it. None where the shape
        is known.
        """
        return []

    @property
    def least_shape_error(self) -> float:
        """How far the surface of the body may be from the true one even where no outline shows it [m]."""
        return LEAST_SHAPE_ERROR * self.voxel

    @property
    def point_names(self) -> list[str]:
        """Of the rows of points [R]."""
        return [] if self.points is None else self.points.names

    @property
    def point_kinds(self) -> np.ndarray:
        """Names of the entries in the rows of points [(R, 11), str]."""
        return np.zeros((0, len(KINDS) + 1), dtype=object) if self.points is None else self.points.kinds

    @property
    def pixel(self) -> float:
        """Size of a pixel at the body [m], where there are points; 0 where there are none."""
        return 0.0 if self.points is None else self.points.pixel

    @property
    def views(self) -> int:
        """V, the number of rows that cameras see."""
        return len(self.video.view_ids)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Entries that are fitted [(V, F, 11), bool]."""
        return self.usable & self.split.fitted[..., None]

    @property
    def of_all_cameras(self) -> np.ndarray:
        """Entries of the fitted frames, those of held-out cameras among them [(V, F, 11), bool]."""
        return self.usable & self.split.frames[..., None]

    def of_held_camera(self, effect: Effect) -> bool:
        """Whether an effect is a fault of one camera that is held out."""
        held = np.array(self.video.view_ids)[~self.split.views]
        return getattr(effect, "view", None) in held.tolist()

    def fitted_with(self, effects: Sequence[Effect]) -> np.ndarray:
        """Entries that a model with some effects is fitted to [(V, F, 11), bool]: a fault of a held-out camera needs
        what that saw, so all cameras are fitted then, and the last frames alone are held out.
        """
        return self.of_all_cameras if any(map(self.of_held_camera, effects)) else self.fitted

    def layout(self, mask: np.ndarray) -> Layout:
        """Names of the entries of a mask [(V, F, 11), bool]."""
        row, frame, kind = np.nonzero(mask)
        names = np.broadcast_to(np.array([*KINDS, BRIGHTNESS], dtype=object), (self.views, len(KINDS) + 1))
        names = np.concatenate((names, self.point_kinds))
        places = np.where(row < self.views, row, self.views - 1 - row)
        frame = np.where((row < self.views) & (frame == 0), AT_REST, frame)
        return Layout(places, frame + self.first_frames[row], names[row, kind].astype(str))

    @property
    def first_frames(self) -> np.ndarray:
        """What the frames of each row are counted from [V + R]: rows of two recordings have no frame in common."""
        return np.zeros(len(self.usable), int)

    @property
    def unit(self) -> tuple[str, float]:
        """Unit in which a report shows errors, and how many of it a pixel is: millimetres where only points count."""
        if not self.point_names or self.usable[: self.views].any():
            return "px", 1.0
        return "mm", 1000 * self.pixel

    @abstractmethod
    def noise_parts(self, sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Roots of the covariance of the noise of relative moments, by the standard deviation of that of moments
        [(V + R, F, 11)]: of what the entries of every frame have by themselves [(V + R, F, 11, Q)], and of what all of
        a view or row have in common: from the frame to which they are relative, or by noise that lasts
        [(V + R, F, 11, Q')].
        """

    def residual(self, predicted: np.ndarray) -> np.ndarray:
        """Measured minus predicted [pixels; brightness 1; (V + R, F, 11)]; NaN where not usable."""
        return np.where(self.usable, self.relative(self.measured - predicted), np.nan)

    def residual_of(self, model: Model, mask: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Residual of a model at free coordinates, in the entries of a mask [(D,)]; 0 where the model loses sight."""
        usable, measured, compared = self.usable, self.measured, self.relative  # not self: other processes get a copy

        def residual(free: np.ndarray) -> np.ndarray:
            return np.where(usable, np.nan_to_num(compared(measured - model.predict(free))), 0.0)[mask]

        return residual

    @property
    def presumed_error(self) -> np.ndarray:
        """Of the fitted entries, as far as it is known without replicates [pixels, (D,)]."""
        return np.hypot(self.sensor[self.fitted], MODEL_ERROR)

    def weighted_residual_of(self, model: Model) -> Callable[[np.ndarray], np.ndarray]:
        """Residual in the fitted entries in units of :attr:`presumed_error` [(D,)]."""
        raw, weight = self.residual_of(model, self.fitted), self.presumed_error
        return lambda free: raw(free) / weight

    def at_rest(self, body: Body) -> np.ndarray:
        """Moments of a body at frame 0 [pixels, (V, 10)]."""
        model = self.model((), self.first_guess, body)
        return silhouette_moments(model.outlines(body.positions[None]), MARGIN)[:, 0]


class BodyProblem(Problem):
    """One recording of a deforming body, whose entries have independent noise. Arguments as of :class:`Problem`."""

    def model(self, effects: Sequence[Effect], known: dict[str, float], body: Body | None = None) -> Model:
        body = body or self.body
        physics = with_effects(self.physics, effects, body.spacing, self.voxel)
        return BodyModel(body, physics, self.without_pictures, known, self.points)

    def noise_parts(self, sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        own = self.noise * (sensor / self.sensor)[..., None]
        shared = np.zeros_like(own)
        shared[: self.views, :, :-1] = -own[: self.views, :1, :-1]
        shared[: self.views, 0] *= -1
        own[: self.views, 0, :-1] = 0.0
        first = first_sight(self.measured[self.views :])[..., None]
        shared[self.views :] = -np.where(first, own[self.views :], 0.0).sum(1, keepdims=True)
        return own, shared


class StateProblem(BodyProblem):
    """A particle state before the cameras of its video.

    Args:
        scene: its name.
        data: the video, prepared.
        state: supplies the body and the first guess of the motion.
        physics: of the model.
        held: what is fitted and what is held out.
        bright: compare the brightness, too.
        particles: the body is sampled by about so many.
        images: False: only points are compared; images show the size of the body at frame 0.
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
        images: bool = True,
    ):
        self.data, self.state, self.particles = data, state, particles
        outlines = silhouette_moments(data.video.silhouettes)
        brightness = self._measured_brightness() if bright else np.zeros(outlines.shape[:2])
        brightness -= np.median(brightness, axis=0)
        measured = np.concatenate((outlines, brightness[..., None]), axis=-1)
        noise = noise_of_video(data.video.silhouettes, brightness)
        points = Points.of(data, state.positions)
        super().__init__(scene, data.video, held, physics, state.spacing, measured, noise, points)
        self.usable[: self.views, :, -1] &= bright
        self.usable[: self.views] &= images

    @cached_property
    def spacing(self) -> float:
        """Node spacing at which the body has the wanted number of particles [m]. Raises UserInputError where the
        reconstruction is solid nowhere.
        """
        return 2 * (self._sampling(self.state.spacing, 0).body().volume / self.particles) ** (1 / 3)

    @cached_property
    def lines(self) -> Lines:
        """Of sight near the edges of the mattes of frame 0, in the fitted views that see all of the body."""
        whole = self.split.views & np.isfinite(self.measured[: self.views, 0, 0])
        return Lines.of(self.data, np.nonzero(whole)[0].tolist())

    @cached_property
    def surface_offset(self) -> float:
        """Raw density above that of the visible surface at which the body begins: that of the state, or found by the
        outlines at frame 0.
        """
        if self.state.surface_offset is not None:
            return self.state.surface_offset
        if not len(self.lines.inside):
            return LEAST_OFFSET
        return max(density_at_edges(self._density, self.lines) - surface_density(*self.state.spacings), LEAST_OFFSET)

    @cached_property
    def _density(self) -> FieldGrid:
        return density_of(self.state)

    @cached_property
    def surface(self) -> FieldGrid:
        """Distance to the surface of the body, positive inside [m]. Raises UserInputError where it has no inside."""
        return self._unbounded.surface

    @property
    def open_volume(self) -> float:
        """What the outlines of frame 0 leave open of the body's volume, one standard deviation, relative to it."""
        return self._unbounded.volume

    @cached_property
    def _unbounded(self) -> Unbounded:
        found = signed_distance(self._density, surface_density(*self.state.spacings) + self.surface_offset)
        if found is None:
            raise UserInputError(
                f"{self.data.video.source}: the reconstruction is a haze that is solid nowhere; train the static phase "
                "longer, or see in its images what it took for the body"
            )
        return Unbounded.of(seen_by(self.lines, found), self.lines)

    def sample(self, spacing: float, seed: int) -> Body:
        """The body, as large as it looks at frame 0 on every side."""
        return self._sampling(spacing, seed).body()

    def wrong_bodies(self, body: Body, sigma: float) -> list[Body]:
        sampled = self._sampling(body.spacing, 0).body
        found = [sampled(partial(value_at, error)) for error in self._unbounded.beyond(sigma)]
        return ShapeModes(body, sigma).bodies(sampled) + [one if len(one.positions) else body for one in found]

    @cached_property
    def _sampling(self) -> Callable[[float, int], bodies.Sampling]:
        return lru_cache(KEPT)(partial(bodies.Sampling, self.surface))

    @cached_property
    def first_guess(self) -> dict[str, float]:
        """Physical parameters and velocity of the state [SI]."""
        velocity = self.state.velocity.mean(0).tolist()
        known = {**self.physics.guess, **self.state.physics}
        return {**known, **dict(zip(("v_x", "v_y", "v_z"), velocity, strict=True))}

    def _measured_brightness(self) -> np.ndarray:
        """Logarithm of mean brightness relative to that of the reconstruction at frame 0 [(V, F)]."""
        video, renderer = self.data.video, StateRenderer(self.state)
        grid = renderer.grid(self.state.positions)
        size = video.images.shape[2], video.images.shape[3]
        reference = [renderer.image(grid, self.data.rays(view), size) for view in range(len(video.images))]
        believed = torch.stack([mean_brightness(image, opacity) for image, opacity in reference])
        measured = mean_brightness(video.images, video.silhouettes)
        return (measured / believed[:, None]).clamp_min(1e-3).log().numpy().astype(float)


def noise_of_video(silhouettes: Tensor, brightness: np.ndarray) -> np.ndarray:
    """A root of the covariance of the noise of moments and brightness in one view and frame [(V, F, 11, 11)], from the
    outlines [(V, F, H, W)] and the brightness [(V, F)] themselves: how far views differ in brightness is taken as one
    error for all frames of a view.
    """
    found = np.pad(sensor_noise(silhouettes), (*[(0, 0)] * 2, (0, 1), (0, 1)))
    spread = max(1.4826 * np.median(np.abs(brightness)), LEAST_SHADING)
    found[..., -1, -1] = spread * np.sqrt(brightness.shape[1])
    return found


def independent(sensor: np.ndarray) -> np.ndarray:
    """The root of a covariance [(..., K, K)] where every entry has its own standard deviation [(..., K)]."""
    return sensor[..., None] * np.eye(sensor.shape[-1])


def relative(difference: np.ndarray, views: int | None = None, anchored: bool = True) -> np.ndarray:
    """Differences of moments [(..., V + R, F, 11)], of outlines relative to frame 0 of their view; in frame 0 itself,
    and for the brightness in every frame, relative to the median of all views, which moves with a common bias. Those of
    points are relative to their first sight.

    Args:
        difference: of moments; NaN where there is none.
        views: V; None: there are no rows of points.
        anchored: whether rows of points are relative to their first sight; else they are as they are.
    """
    found = difference.copy()
    seen, own = difference[..., :views, :, :], found[..., :views, :, :]
    if views != 0:
        own[..., :-1] -= seen[..., :, :1, :-1]
        own[..., :, 0, :-1] = beside_median(seen[..., :, 0, :-1])
        own[..., -1] = beside_median(seen[..., -1])
    if anchored and views is not None and views < difference.shape[-3]:
        rows = difference[..., views:, :, :]
        first = np.where(first_sight(rows), rows, 0.0).sum(-2, keepdims=True)
        found[..., views:, :, :] = rows - first
    return found


def first_sight(rows: np.ndarray) -> np.ndarray:
    """True at the first frame in which something was measured [(..., R, F, 11), bool]."""
    seen = np.isfinite(rows)
    return seen & (seen.cumsum(-2) == 1)


def beside_median(values: np.ndarray) -> np.ndarray:
    """Values [(..., V, K)] less their median over views."""
    return values - np.nanmedian(values, axis=-2, keepdims=True)
