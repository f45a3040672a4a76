"""What of a rollout a person looks at: the body in space, outlines in a camera, and where on the body they disagree."""

from functools import cache, lru_cache

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from pacnerf_lpo.data.recordings.tangents import Planes, bounds, outline_planes
from pacnerf_lpo.data.recordings.voxel_hull import visual_hull
from pacnerf_lpo.data.recordings.written_scene import View
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.prediction import StateRenderer
from pacnerf_lpo.explore.records import Camera, Measured, Motion, Outlines
from pacnerf_lpo.explore.simulate import Simulated
from pacnerf_lpo.explore.stepping import Stepper
from pacnerf_lpo.identification.forward_model import MARGIN
from pacnerf_lpo.identification.problem import Problem, StateProblem
from pacnerf_lpo.identification.rigid import RigidProblem
from pacnerf_lpo.render.observation import Observer
from pacnerf_lpo.types import Video

NEIGHBOURS = 12
"""Of a particle, by which its stretch is measured: those that share a face or an edge with its cell, about."""
SIDES = ("left", "right", "bottom", "top", "back", "front")
"""Of the body: where x, y and z are small and where they are large."""


class Views:
    """The part of a session that looks at rollouts. Several threads may call it."""

    stepper: Stepper

    def __init__(self, problem: Problem):
        self._parts = problem.parts(problem.physics.effects, problem.first_guess)
        self._opacity = lru_cache(problem.views)(self._find_opacity)  # as many as one rollout has
        self._appearance = cache(appearance_of)
        self._hull = cache(lambda at, frame: hull_at(self._video(at), frame))

    @property
    def recordings(self) -> tuple[str, ...]:
        """Their names; one for a run."""
        return tuple(part.name for part in self._parts)

    def cameras(self, recording: str | int = 0) -> list[Camera]:
        """Cameras of a recording; none where only points were measured."""
        at = self._number(recording)
        video, fitted = self._video(at), self._parts[at].recording.split.views.tolist()
        poses, intrinsics = video.camera_to_world.numpy(), video.intrinsics.numpy()
        height, width = video.images.shape[2:4]
        return [
            Camera(view, f"view {view}", self.recordings[at], not fitted[v], poses[v], intrinsics[v], width, height)
            for v, view in enumerate(video.view_ids)
        ]

    def times(self, recording: str | int = 0) -> np.ndarray:
        """Of the frames of a recording [s, (F,)]"""
        return self._video(self._number(recording)).times.numpy().astype(float)

    def held_frames(self, recording: str | int = 0) -> np.ndarray:
        """Frames of a recording that are held out in every view [(F,), bool]"""
        split = self._parts[self._number(recording)].recording.split
        return np.logical_not(np.atleast_2d(split.frames).any(0))

    def motion(self, number: int | None = None, recording: str | int = 0) -> Motion:
        """The body at every frame, see :class:`Motion`. Raises as :meth:`error`."""
        found, at = self._rolled(number, recording)
        times, path = self.times(at), found.paths[at].numpy()
        speed = np.linalg.norm(np.gradient(path, times, axis=0), axis=-1)
        spacing = found.models[at].body.spacing / 2
        colours = self._colours(at, found.models[at].body.positions)
        return Motion(times, path.astype(np.float32), speed.astype(np.float32), colours, spacing, found.resolution)

    def stretch(self, number: int | None = None, recording: str | int = 0) -> np.ndarray:
        """Largest principal stretch of the body at every particle and frame, relative to frame 0 [(F, N), float32]: of
        the affine map that fits the motion of its nearest neighbours best. Raises as :meth:`error`.
        """
        found, at = self._rolled(number, recording)
        path = found.paths[at].double()
        if not self._parts[at].recording.deforms or path.shape[1] <= NEIGHBOURS:
            return np.ones(path.shape[:2], np.float32)
        body = found.models[at].body.positions.numpy()
        near = torch.from_numpy(cKDTree(body).query(body, NEIGHBOURS + 1)[1][:, 1:])
        before = path[0][near] - path[0][:, None]
        inverse = torch.linalg.pinv(before.transpose(1, 2) @ before)
        gradients = [((frame[near] - frame[:, None]).transpose(1, 2) @ before) @ inverse for frame in path]
        squares = torch.stack([gradient.transpose(1, 2) @ gradient for gradient in gradients])
        return torch.linalg.eigvalsh(squares)[..., -1].clamp_min(0).sqrt().float().numpy()

    def outlines(self, camera: int, frame: int, number: int | None = None, recording: str | int = 0) -> Outlines:
        """Image, matte and model of a camera at a frame.

        Args:
            camera: its ``view``, see :meth:`cameras`.
            frame: number of the frame, from 0.
            number: of the step; None: the current one.
            recording: name or number of a recording.

        Raises:
            UserInputError: no such camera, frame, recording or step, or its motion is unstable.
        """
        self._check(recording, camera, frame)
        found, at = self._rolled(number, recording)
        video = self._video(at)
        view = video.view_ids.index(camera)
        image, matte = (values[view, frame].numpy() for values in (video.images, video.silhouettes))
        return Outlines(image, matte, self._opacity(found, at, view)[frame])

    def measured(self, frame: int, recording: str | int = 0) -> Measured:
        """What was measured in space at a frame, see :class:`Measured`. Raises UserInputError."""
        at = self._check(recording, None, frame)
        seen, none = self._parts[at].recording, np.zeros((0, 3))
        points, cloud, centre = none, none, None
        if isinstance(seen, RigidProblem):
            centre = seen.flight.positions[frame]
        elif seen.points is not None:
            times, tracks, clouds = seen.points.times, seen.points.tracks, seen.points.clouds
            nearest = lambda when: np.abs(when[:, None] - times).argmin(1) == frame  # noqa: E731
            if tracks is not None:
                points = tracks.positions[nearest(tracks.times)]
            if clouds is not None and nearest(clouds.times).any():
                cloud = clouds.points[int(np.abs(clouds.times - times[frame]).argmin())]
        return Measured(*self._hull(at, frame), points, cloud, centre)

    def particle_errors(self, number: int | None = None, recording: str | int = 0) -> np.ndarray:
        """Where on the body the outlines disagree [pixels, (F, N), float32]: the area on which matte and model differ,
        each pixel counted for the particle that is nearest to it, a mean over the cameras. Raises as :meth:`error`.
        """
        return self._disagreement(*self._rolled(number, recording))

    def regions(self, number: int | None = None, recording: str | int = 0) -> dict[str, np.ndarray]:
        """:meth:`particle_errors` summed over each side of the body: left (-x), right, bottom (-y), top, back (-z) and
        front, as it lies at frame 0 [pixels, (F,) each]. Raises as :meth:`error`.
        """
        found, at = self._rolled(number, recording)
        error, body = self._disagreement(found, at), found.models[at].body.positions.numpy()
        away = (body - body.mean(0)) / np.maximum(np.ptp(body, axis=0), 1e-9)
        side = np.stack((-away, away), axis=2).reshape(len(away), -1).argmax(1)
        return {name: error[:, side == number].sum(1) for number, name in enumerate(SIDES)}

    def _number(self, recording: str | int) -> int:
        """Of a recording by its name or number. Raises UserInputError."""
        if isinstance(recording, str) and recording in self.recordings:
            return self.recordings.index(recording)
        if isinstance(recording, str) or not 0 <= recording < len(self.recordings):
            raise UserInputError(f"explore: there is no recording {recording}; there are {', '.join(self.recordings)}")
        return int(recording)

    def _video(self, at: int) -> Video:
        return self._parts[at].recording.video

    def _check(self, recording: str | int, camera: int | None, frame: int) -> int:
        """The number of a recording. Raises UserInputError where it has no such camera or frame."""
        at = self._number(recording)
        video, name, last = self._video(at), self.recordings[at], len(self._video(at).times) - 1
        if camera is not None and camera not in video.view_ids:
            known = ", ".join(map(str, video.view_ids)) or "none"
            raise UserInputError(f"explore: {name} has no camera {camera}; it has {known}")
        if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)) or not 0 <= frame <= last:
            raise UserInputError(f"explore: {name} has no frame {frame}; give a number from 0 to {last}")
        return at

    def _rolled(self, number: int | None, recording: str | int) -> tuple[Simulated, int]:
        """The rollout of a step, and the number of a recording. Raises UserInputError."""
        at = self._number(recording)
        return self.stepper.simulated(self.stepper.history.step(number)), at

    def _disagreement(self, found: Simulated, at: int) -> np.ndarray:
        """See :meth:`particle_errors`."""
        path, model = found.paths[at], found.models[at]
        total = np.zeros(path.shape[:2])
        for view in range(model.shape[0]):
            matte = self._video(at).silhouettes[view].numpy() > 0.5
            wrong = matte != (self._opacity(found, at, view) > 0.5)
            pixels = _pixels(found, at, view)
            for frame in range(len(path)):
                rows, columns = np.nonzero(wrong[frame])
                if len(rows):
                    nearest = cKDTree(pixels[frame]).query(np.stack((columns, rows), 1) + 0.5)[1]
                    np.add.at(total[frame], nearest, 1.0)
        return (total / max(model.shape[0], 1)).astype(np.float32)

    def _find_opacity(self, found: Simulated, at: int, view: int) -> np.ndarray:
        """Of the model in a view at all frames [0..1, (F, H, W)]"""
        model = found.models[at]
        seen = model.outlines(found.paths[at], model.start, [view])[0]
        return seen[:, MARGIN:-MARGIN, MARGIN:-MARGIN].numpy()

    def _colours(self, at: int, positions: Tensor) -> np.ndarray:
        """Appearance of particles at frame 0 [0..1, (N, 3)]: that of the nearest one of the reconstruction."""
        recording = self._parts[at].recording
        if not isinstance(recording, StateProblem):
            return np.full((len(positions), 3), 0.6)
        tree, colours = self._appearance(recording)
        return colours[tree.query(positions.numpy())[1]]


def appearance_of(recording: StateProblem) -> tuple[cKDTree, np.ndarray]:
    """The denser half of the particles of a reconstruction, and their colours [0..1, (N, 3)]"""
    state = recording.state
    dense = state.density >= state.density.median()
    return cKDTree(state.positions[dense].numpy()), StateRenderer(state).particle_colours()[dense].numpy()


def hull_at(video: Video, frame: int) -> tuple[np.ndarray, float]:
    """Points of the visual hull of all mattes at a frame [m, (M, 3)], and how far they are apart [m]; none where fewer
    than two cameras see the body, or their outlines leave it open or contradict each other.
    """
    poses, intrinsics = video.camera_to_world.double().numpy(), video.intrinsics.double().numpy()
    seen = [(v, matte) for v, matte in enumerate(video.silhouettes[:, frame].double().numpy()) if (matte > 0.5).any()]
    if len(seen) < 2:
        return np.zeros((0, 3)), 0.0
    lower, upper = bounds(Planes.of([outline_planes(matte, intrinsics[v], poses[v]) for v, matte in seen]))
    if not np.isfinite((lower, upper)).all():
        return np.zeros((0, 3)), 0.0
    views = [View(v, "", intrinsics[v], poses[v], video.valid[v].numpy(), None) for v, _ in seen]
    return visual_hull(views, [matte > 0.5 for _, matte in seen], lower, upper)


@torch.no_grad()
def _pixels(found: Simulated, at: int, view: int) -> np.ndarray:
    """Where a camera sees the particles [pixels, (F, N, 2)]"""
    model = found.models[at]
    observer: Observer = model.observer(model.start)
    moving = observer.seen(found.paths[at], model.velocity(model.start), model.video.times)
    points = moving[observer.clock(model.video.view_ids[view])]
    return model.project(points, view, observer)[0].numpy()
