"""The forward model of a diagnosis: physical parameters in, silhouette moments of every view and frame out."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.data import cameras
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.points import Points
from pacnerf_lpo.identification.silhouette_moments import KINDS, silhouette_moments
from pacnerf_lpo.identification.splatting import splat
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT, Physics
from pacnerf_lpo.render.camera_faults.base import faults_of
from pacnerf_lpo.render.clocks import cameras_of
from pacnerf_lpo.render.observation import Observer
from pacnerf_lpo.types import Video

VELOCITY = tuple(
    Parameter(f"v_{axis}", "m/s", Identity(), (-100.0, 100.0), f"initial velocity along {axis}", scale=0.1)
    for axis in "xyz"
)
MARGIN = 24
"""How far the model's images go beyond the camera's [pixels]: an outline may leave the picture in a bad guess."""
PARTICLES_AT_ONCE = 2**22
"""Of all views and frames that are drawn in one launch, at most, unless those of one view are more: 100 MB."""


def with_effects(
    physics: Physics, effects: Sequence[Effect], spacing: float, run_spacing: float, frame_rate: float | None = None
) -> Physics:
    """The physical model of a run with other effects, stepped as finely as another grid spacing [m] needs, and with
    frames at another rate [1/s] where that is given.
    """
    frame_rate = frame_rate or physics.frame_rate
    steps = int(np.ceil(physics.substep_rate * run_spacing / spacing / frame_rate))
    found = Physics(
        physics.material,
        physics.ground,
        effects,
        physics.rho,
        max(steps, 1) * frame_rate,
        frame_rate,
        physics.gravity,
        physics.ground_height,
        physics.fit_ground_height,
        ground_error=physics.ground_error,
    )
    found.most_halvings = physics.most_halvings
    return found


class Model(ABC):
    """A motion by given physics before the cameras of a video, with unknowns to be identified.

    Args:
        body: particles at frame 0.
        physics: material, ground and effects.
        video: cameras, image size and time stamps; its images are not used.
        known: values to start from, of physical parameters and of the velocity ``v_x``, ``v_y``, ``v_z`` [SI].
        points: measured in addition to the video; they add rows behind those of the views.

    Attributes:
        effects: of the model, those on the cameras among them.
        shape: numbers of views and frames.
        frames: only the first so many are simulated, in the rest everything stands still; None: all.
        motion: unknowns of the initial motion.
        footprint: factor on the radius of the discs that particles are drawn as.
    """

    frames: int | None = None
    footprint: float = 1.0
    motion: tuple[Parameter, ...] = VELOCITY
    _latest: tuple[bytes, dict[str, float]] = b"", {}

    def __init__(
        self, body: Body, physics: Physics, video: Video, known: dict[str, float], points: Points | None = None
    ):
        self.body, self.physics, self.video, self.points = body, physics, video, points
        self.effects, self.shape = physics.effects, (video.images.shape[0], len(video.times))
        self.known = {**physics.guess, **{name: value for name, value in known.items() if name in physics.parameters}}
        described = physics.parameters
        self.unknowns = [*(described[name] for name in physics.free_names), *self.motion]
        self.names = tuple(parameter.name for parameter in self.unknowns)
        self.scales = np.array([parameter.scale for parameter in self.unknowns])
        start = {**self.known, **{parameter.name: known[parameter.name] for parameter in self.motion}}
        self.start = np.array([parameter.transform.to_free(start[parameter.name]) for parameter in self.unknowns])
        self.bounds = self._bounds()

    def restart(self) -> None:
        """Forget which time step earlier motions needed: the next one begins with the model's own."""
        for model in self.alone():
            model.physics.halvings = 0

    def alone(self) -> "Sequence[Model]":
        """The models of single recordings that it is made of."""
        return [self]

    @abstractmethod
    def contact(self, free: np.ndarray, within: float) -> int:
        """First frame in which a particle is within so many node spacings of the ground; the number of frames where
        none is. Raises SimulationError.
        """

    @abstractmethod
    def path(self, free: np.ndarray) -> Tensor:
        """Particles at every frame [m, (F, N, 3)]. Raises SimulationError."""

    @abstractmethod
    def predict(self, free: np.ndarray) -> np.ndarray:
        """Moments of every outline [pixels], and the brightness; then the rows of points [(V + R, F, 11)].

        Raises SimulationError.
        """

    @abstractmethod
    def observe(self, path: Tensor, free: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
        """The same of a motion [m, (F, N, 3)].

        Args:
            path: as :meth:`path` gives it.
            free: where the coefficients of observation effects stand.
            before: moments of the same motion with the cameras as they are believed to be; saves looking again into
                views that no observation effect concerns.
        """

    def physical(self, free: np.ndarray) -> dict[str, float]:
        """Every parameter in SI units at these free coordinates [(K,)]."""
        at, found = self._latest  # a prediction asks several times for the same
        if at != (asked := np.asarray(free, float).tobytes()):
            found = {p.name: p.physical(value) for p, value in zip(self.unknowns, free, strict=True)}
            self._latest = asked, found
        return {**self.known, **found}

    def moved(self, free: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """Free coordinates [(K,)] with other values of some unknowns [SI]."""
        found = free.copy()
        for name, value in values.items():
            index = self.names.index(name)
            found[index] = self.unknowns[index].transform.to_free(value)
        return found

    @torch.no_grad()
    def outlines(self, path: Tensor, free: np.ndarray | None = None, views: Sequence[int] | None = None) -> Tensor:
        """Opacity in views and frames, with a margin around the image [0..1, (V, F, H + 48, W + 48)].

        Args:
            path: particles at every frame [m, (F, N, 3)]
            free: where the coefficients of observation effects stand; None: cameras as they are believed to be.
            views: indices of some views; None: all.
        """
        observer = Observer(cameras_of((), self.video)) if free is None else self.observer(free)
        if len(path) > 1:
            moving = observer.seen(path, self.velocity(free), self.video.times)
        else:
            moving = path.expand(len(observer.clocks), *path.shape)
        views = range(self.shape[0]) if views is None else views
        together = max(1, PARTICLES_AT_ONCE // (path.shape[0] * path.shape[1]))
        groups = [views[first : first + together] for first in range(0, len(views), together)]
        drawn = [self._drawn(moving, observer, group) for group in groups]
        return drawn[0] if len(drawn) == 1 else torch.cat(drawn)

    def _drawn(self, moving: Tensor, observer: Observer, views: Sequence[int]) -> Tensor:
        """Opacity [0..1, (V, F, H + 48, W + 48)] in some views of a motion as each clock sees it [m, (clocks, F, N,
        3)], in one launch.
        """
        size = self.video.images.shape[2] + 2 * MARGIN, self.video.images.shape[3] + 2 * MARGIN
        places, scales = [], []
        for view in views:
            pixels, depth = self.project(moving[observer.clock(self.video.view_ids[view])], view, observer)
            places.append(pixels + MARGIN)
            scales.append(torch.where(depth > 0, self.video.intrinsics[view, 0, 0] / depth, 0.0))  # pixels per metre
        apart = self.body.spacing / 2
        opacity = splat(torch.cat(places), torch.cat(scales), self.body.discs, apart, size, self.footprint)
        return opacity.view(len(views), -1, *size)

    def project(self, points: Tensor, view: int, observer: Observer) -> tuple[Tensor, Tensor]:
        """Pixels [(F, N, 2)] and depth [m, (F, N)] of particles [m, (F, N, 3)] in a view."""
        view_id, count = self.video.view_ids[view], len(points)
        if observer.changing("camera", view_id) or observer.changing("image_plane", view_id):
            frames = [observer.project(points[f], self.video, view, f) for f in range(count)]
            return torch.stack([pixels for pixels, _ in frames]), torch.stack([depth for _, depth in frames])
        flat = points.reshape(-1, 3)
        pixels, depth = cameras.project(flat, self.video.intrinsics[view], self.video.camera_to_world[view])
        return pixels.view(count, -1, 2), depth.view(count, -1)

    def brightness(self, free: np.ndarray) -> np.ndarray:
        """Logarithm of what the cameras make of a grey object's brightness [(V, F)]."""
        observer, grey = self.observer(free), torch.full((1, 3), 0.5)
        found = np.zeros(self.shape)
        for view, view_id in enumerate(self.video.view_ids):
            if observer.changing("colour", view_id):
                for frame in range(self.shape[1]):
                    seen = observer.colour(grey, torch.zeros(1), self.video, view, frame)
                    found[view, frame] = float((seen.mean() / grey.mean()).clamp_min(1e-3).log())
        return found

    def velocity(self, free: np.ndarray | None) -> Tensor:
        """Of the body at frame 0, without the effects on it, at free coordinates [(K,)], or at the start [m/s,
        (3,)]."""
        values = self.physical(self.start if free is None else free)
        return torch.tensor([values[parameter.name] for parameter in VELOCITY], dtype=torch.float32)

    def observer(self, free: np.ndarray) -> Observer:
        """The cameras with what free coordinates [(K,)] say is wrong about them."""
        tensors = {name: torch.tensor(value) for name, value in self.physical(free).items()}
        return Observer(cameras_of(self.physics.effects, self.video), tensors)

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest free coordinate of every unknown; a one-sided effect does not cross its null, and the
        ground stays within half a cell, and how far it may be from where it was measured: it stands for the layer in
        which a grid feels the ground, too.
        """
        ends = [
            [parameter.transform.to_free(bound * (1 - 1e-6)) for bound in parameter.bounds]
            for parameter in self.unknowns
        ]
        low, high = np.array(ends).T
        if GROUND_HEIGHT.name in self.names:
            index, reach = self.names.index(GROUND_HEIGHT.name), self.body.spacing / 2 + self.physics.ground_error
            low[index], high[index] = self.physics.ground_height - reach, self.physics.ground_height + reach
        for effect in self.physics.effects:
            for name, null in effect.null.items() if effect.one_sided else ():
                index = self.names.index(name)
                end, ends = self.unknowns[index].transform.to_free(null), low if effect.side(name)[0] == null else high
                ends[index] = np.clip(end, low[index], high[index])
        return low, high


class BodyModel(Model):
    """A deforming body that moves by given physics before the cameras of a video."""

    def contact(self, free: np.ndarray, within: float) -> int:
        low = self.path(free)[..., 1].amin(1).numpy() - self.physics.ground_height
        touching = np.nonzero(low < within * self.body.spacing)[0]
        return int(touching[0]) if len(touching) else len(low)

    @torch.no_grad()
    def path(self, free: np.ndarray) -> Tensor:
        values = self.physical(free)
        tensors = {name: torch.tensor(values[name]) for name in self.physics.parameters}
        positions = self.body.positions
        path = self.physics.motion(
            positions,
            self.velocity(free).expand_as(positions),
            self.body.fraction,
            self.body.fraction,  # half the volume is half the force
            tensors,
            self.body.spacing,
            min(self.frames or self.shape[1], self.shape[1]),
        )
        return torch.cat((path, path[-1:].expand(self.shape[1] - len(path), -1, -1)))

    def predict(self, free: np.ndarray) -> np.ndarray:
        return self.observe(self.path(free), free)

    def observe(self, path: Tensor, free: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
        count = self.shape[0]
        views = list(range(count))
        if before is not None:
            faults, ids = faults_of(self.physics.effects), self.video.view_ids
            views = [view for view in views if any(effect.concerns(ids[view]) for effect in faults)]
        found = np.zeros((*self.shape, len(KINDS) + 1)) if before is None else before.copy()
        found[:count, :, -1] = self.brightness(free)
        if views:
            found[views, :, :-1] = silhouette_moments(self.outlines(path, free, views), MARGIN)
        if before is None and self.points is not None:
            found = np.concatenate((found, self.points.predict(path)))
        return found


def outcome(model: Model) -> np.ndarray | SimulationError:
    """What a model predicts at its start [(V + R, F, 11)], or what went wrong."""
    try:
        return model.predict(model.start)
    except SimulationError as error:
        return error
