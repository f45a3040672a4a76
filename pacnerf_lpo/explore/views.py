"""What of a rollout a person looks at: the body in space, outlines in a camera, and where on the body they disagree."""

import threading
from collections.abc import Callable
from typing import Any

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
from pacnerf_lpo.identification.forward_model import MARGIN
from pacnerf_lpo.identification.problem import Problem, StateProblem
from pacnerf_lpo.identification.rigid import RigidProblem
from pacnerf_lpo.render.observation import Observer
from pacnerf_lpo.types import Video

NEIGHBOURS = 12
"""Of a particle, by which its stretch is measured: those that share a face or an edge with its cell, about."""
SIDES = (("left", "right"), ("bottom", "top"), ("back", "front"))
"""Of the body along x, y and z."""


class Views:
    """Looks at rollouts of a problem. Several threads may call it."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.parts = problem.parts(problem.physics.effects, problem.first_guess)
        self.names = tuple(part.name for part in self.parts)
        self._lock = threading.RLock()
        self._known: dict[tuple, Any] = {}
        self._outlines: tuple[object, dict[tuple[int, int], np.ndarray]] = (None, {})

    def number(self, recording: str | int) -> int:
        """Of a recording by its name or number. Raises UserInputError."""
        if isinstance(recording, str) and recording in self.names:
            return self.names.index(recording)
        if isinstance(recording, str) or not 0 <= recording < len(self.names):
            raise UserInputError(f"explore: there is no recording {recording}; there are {', '.join(self.names)}")
        return int(recording)

    def video(self, at: int) -> Video:
        """Of a recording."""
        return self.parts[at].recording.video

    def cameras(self, at: int) -> list[Camera]:
        """Of a recording."""
        video, split = self.video(at), self.parts[at].recording.split
        height, width = video.images.shape[2:4]
        return [
            Camera(
                view,
                f"view {view}",
                self.names[at],
                not bool(split.views[k]),
                video.camera_to_world[k].numpy(),
                video.intrinsics[k].numpy(),
                int(width),
                int(height),
            )
            for k, view in enumerate(video.view_ids)
        ]

    def check(self, at: int, camera: int | None, frame: int) -> None:
        """Raise UserInputError where a recording has no such camera or frame."""
        video = self.video(at)
        if camera is not None and camera not in video.view_ids:
            known = ", ".join(map(str, video.view_ids)) or "none"
            raise UserInputError(f"explore: {self.names[at]} has no camera {camera}; it has {known}")
        if isinstance(frame, bool) or not isinstance(frame, (int, np.integer)) or not 0 <= frame < len(video.times):
            raise UserInputError(
                f"explore: {self.names[at]} has no frame {frame}; give a number from 0 to {len(video.times) - 1}"
            )

    def motion(self, found: Simulated, at: int) -> Motion:
        """The body of a recording at every frame."""
        times, path = self.video(at).times.numpy().astype(float), found.paths[at].numpy()
        speed = np.linalg.norm(np.gradient(path, times, axis=0), axis=-1)
        spacing = found.models[at].body.spacing / 2
        colours = self._colours(at, found.models[at].body.positions)
        return Motion(times, path.astype(np.float32), speed.astype(np.float32), colours, spacing, found.resolution)

    def stretch(self, found: Simulated, at: int) -> np.ndarray:
        """Largest principal stretch [(F, N)]."""
        path = found.paths[at].double()
        if not self.parts[at].recording.deforms or path.shape[1] <= NEIGHBOURS:
            return np.ones(path.shape[:2], np.float32)
        body = found.models[at].body.positions.numpy()
        nearest = lambda: cKDTree(body).query(body, NEIGHBOURS + 1)[1][:, 1:]  # noqa: E731
        near = torch.from_numpy(self._once(("neighbours", at, len(body)), nearest))
        before = path[0][near] - path[0][:, None]
        inverse = torch.linalg.pinv(before.transpose(1, 2) @ before)
        gradients = [((frame[near] - frame[:, None]).transpose(1, 2) @ before) @ inverse for frame in path]
        squares = torch.stack([gradient.transpose(1, 2) @ gradient for gradient in gradients])
        return torch.linalg.eigvalsh(squares)[..., -1].clamp_min(0).sqrt().float().numpy()

    def outlines(self, found: Simulated, at: int, camera: int, frame: int) -> Outlines:
        """Of a camera at a frame."""
        video, view = self.video(at), self.video(at).view_ids.index(camera)
        image, matte = (values[view, frame].numpy() for values in (video.images, video.silhouettes))
        return Outlines(image, matte, self._opacity(found, at, view)[frame])

    def measured(self, at: int, frame: int) -> Measured:
        """In space, at a frame of a recording."""
        recording, none = self.parts[at].recording, np.zeros((0, 3))
        points, cloud, centre = none, none, None
        if isinstance(recording, RigidProblem):
            centre = recording.flight.positions[frame]
        elif recording.points is not None:
            time, times = recording.points.times[frame], recording.points.times
            nearest = lambda when: np.abs(when[:, None] - times).argmin(1) == frame  # noqa: E731
            tracks, clouds = recording.points.tracks, recording.points.clouds
            if tracks is not None:
                points = tracks.positions[nearest(tracks.times)]
            if clouds is not None and nearest(clouds.times).any():
                cloud = clouds.points[int(np.abs(clouds.times - time).argmin())]
        hull, cell = self._once(("hull", at, frame), lambda: hull_at(self.video(at), frame))
        return Measured(hull, cell, points, cloud, centre)

    def particle_errors(self, found: Simulated, at: int) -> np.ndarray:
        """Area of disagreement that is nearest to each particle, a mean over cameras [pixels, (F, N)]."""
        path, model = found.paths[at], found.models[at]
        total = np.zeros(path.shape[:2])
        for view in range(model.shape[0]):
            matte = self.video(at).silhouettes[view].numpy() > 0.5
            wrong = matte != (self._opacity(found, at, view) > 0.5)
            pixels = _pixels(found, at, view)
            for frame in range(len(path)):
                rows, columns = np.nonzero(wrong[frame])
                if len(rows):
                    nearest = cKDTree(pixels[frame]).query(np.stack((columns, rows), 1) + 0.5)[1]
                    np.add.at(total[frame], nearest, 1.0)
        return (total / max(model.shape[0], 1)).astype(np.float32)

    def regions(self, found: Simulated, at: int) -> dict[str, np.ndarray]:
        """The same by the side of the body."""
        error, body = self.particle_errors(found, at), found.models[at].body.positions.numpy()
        away = (body - body.mean(0)) / np.maximum(np.ptp(body, axis=0), 1e-9)
        axis = np.abs(away).argmax(1)
        positive = np.take_along_axis(away, axis[:, None], 1)[:, 0] > 0
        return {
            SIDES[k][side]: error[:, (axis == k) & (positive == bool(side))].sum(1) for k in range(3) for side in (0, 1)
        }

    def _opacity(self, found: Simulated, at: int, view: int) -> np.ndarray:
        """Of the model in a view at all frames [0..1, (F, H, W)]; remembered for the last rollout."""
        with self._lock:
            if self._outlines[0] is not found:
                self._outlines = found, {}
            kept = self._outlines[1]
            if (at, view) not in kept:
                model = found.models[at]
                seen = model.outlines(found.paths[at], model.start, [view])[0]
                kept[at, view] = seen[:, MARGIN:-MARGIN, MARGIN:-MARGIN].numpy()
            return kept[at, view]

    def _once(self, key: tuple, find: Callable[[], Any]) -> Any:
        """What is found only when it is asked for the first time."""
        with self._lock:
            if key not in self._known:
                self._known[key] = find()
            return self._known[key]

    def _colours(self, at: int, positions: Tensor) -> np.ndarray:
        """Appearance of particles at frame 0 [0..1, (N, 3)]: that of the nearest one of the reconstruction."""
        recording = self.parts[at].recording
        if not isinstance(recording, StateProblem):
            return np.full((len(positions), 3), 0.6)
        state = recording.state

        def appearance() -> tuple[cKDTree, np.ndarray]:
            dense = state.density >= state.density.median()
            colours = StateRenderer(state).particle_colours()[dense].numpy()
            return cKDTree(state.positions[dense].numpy()), colours

        tree, colours = self._once(("appearance", at), appearance)
        return colours[tree.query(positions.numpy())[1]]


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
