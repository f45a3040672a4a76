"""How the cameras see the world when something about them is wrong: observation effects applied to views and motions.

Effects act in the order in which the model lists them. Without any, nothing is computed anew: motions, rays and colours
are handed on as they are. The static phase looks at frame 0 before any value is known, through the believed cameras.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from pacnerf_lpo.data import cameras
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.render.camera_faults.base import Observation
from pacnerf_lpo.types import Rays, Video

NEWTON_STEPS = 8
NEWTON_TOLERANCE = 1e-9  # in image coordinates
LONGEST_NEWTON_STEP = 0.2  # in image coordinates, keeps pixels beyond a fold of the lens finite


@dataclass(frozen=True)
class Observer:
    """Observation effects with values of their coefficients; by default, cameras that are as they are believed to be.

    observations: the effects, see :func:`~pacnerf_lpo.render.camera_faults.base.faults_of`
    values: every parameter of theirs by name [SI, scalars]; others are not looked at
    """

    observations: Sequence[Observation] = ()
    values: Mapping[str, Tensor] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the parameters of all effects."""
        return [name for effect in self.observations for name in effect.parameters]

    @property
    def clocks(self) -> list[int | None]:
        """The views (file ids) whose time differs, after None, which stands for all other views."""
        views = {effect.view for effect in self.changing("time") if effect.view is not None}
        return [None, *sorted(views)]

    def clock(self, view_id: int) -> int:
        """Index of a view's clock in :attr:`clocks`."""
        clocks = self.clocks
        return clocks.index(view_id) if view_id in clocks else 0

    def seen(self, trajectory: Tensor, velocity: Tensor, times: Tensor) -> Tensor:
        """The positions that each clock sees in each frame [m, (clocks, F, N, 3)].

        Args:
            trajectory: positions at the frames' stamps, from frame 0 on [m, (F, N, 3)].
            velocity: at frame 0 [m/s, (N, 3) or (3,)].
            times: stamps of these frames [s, (F,)].
        """
        paths = [self.seen_by(clock, trajectory, velocity, times) for clock in self.clocks]
        return torch.stack(paths) if len(paths) > 1 else paths[0][None]

    def seen_by(self, view_id: int | None, trajectory: Tensor, velocity: Tensor, times: Tensor) -> Tensor:
        """The positions that one view (file id; None: one that no effect names) sees in each frame [m, (F, N, 3)],
        differentiable; arguments as of :meth:`seen`, of which the times are evenly spaced.
        """
        acting = [effect for effect in self.changing("time") if effect.view in (None, view_id)]
        if not acting:
            return trajectory
        wanted = (times - times[0]).to(trajectory)
        step = wanted[-1] / (len(wanted) - 1)
        for effect in acting:
            wanted = effect.time(wanted, effect.coefficients(self.values))
        return between_frames(trajectory, velocity, wanted / step, step)

    def rays(self, data: VideoData, view: int, frame: int) -> Rays:
        """The rays of all pixels of a view at a frame (video indices), row by row; differentiable in the values."""
        video = data.video
        view_id = video.view_ids[view]
        moved, bent = self.changing("camera", view_id), self.changing("image_plane", view_id)
        if not (moved or bent):
            return data.rays(view)
        height, width = video.images.shape[2:4]
        observed = cameras.pixel_centres(video.intrinsics[view], height, width)
        ideal = self.undistorted(observed, view_id) if bent else observed
        pose = self.pose(video.camera_to_world[view].double(), view_id, _since_start(video, frame))
        return cameras.rays_through(ideal, pose)

    def pose(self, camera_to_world: Tensor, view_id: int, t: float) -> Tensor:
        """Where a camera truly is [(3, 4), m] at time t since frame 0 [s], given where it is believed to be."""
        for effect in self.changing("camera", view_id):
            camera_to_world = effect.camera(view_id, camera_to_world, t, effect.coefficients(self.values))
        return camera_to_world

    def distorted(self, ideal: Tensor, view_id: int) -> Tensor:
        """Observed image coordinates of ideal ones [x / z and y / z, (R, 2)]."""
        for effect in self.changing("image_plane", view_id):
            ideal = effect.image_plane(view_id, ideal, effect.coefficients(self.values))
        return ideal

    def undistorted(self, observed: Tensor, view_id: int) -> Tensor:
        """Ideal image coordinates of observed ones [x / z and y / z, (R, 2)], by Newton's method.

        The last step is differentiable in the values and in ``observed``.
        """
        ideal = observed.detach()
        for _ in range(NEWTON_STEPS):
            step = self._newton_step(ideal, observed.detach(), view_id).detach()
            ideal = ideal + step.clamp(-LONGEST_NEWTON_STEP, LONGEST_NEWTON_STEP)
            if step.abs().max() < NEWTON_TOLERANCE:
                break
        return ideal + self._newton_step(ideal, observed, view_id)

    def colour(self, colour: Tensor, transmittance: Tensor, video: Video, view: int, frame: int) -> Tensor:
        """Observed colour of pixels on white [0..1, (..., 3)].

        A matted image shows the object as the camera sees it, before a white that no camera sees; so only the part of
        the colour that comes from the object is changed, not the ``transmittance`` [(...)] times white.
        """
        view_id = video.view_ids[view]
        for effect in self.changing("colour", view_id):
            white = transmittance.unsqueeze(-1)
            t, coefficients = _since_start(video, frame), effect.coefficients(self.values)
            colour = effect.colour(view_id, colour - white, t, coefficients) + white
        return colour

    def project(self, points: Tensor, video: Video, view: int, frame: int) -> tuple[Tensor, Tensor]:
        """Pixels [(N, 2), x right, y down] and depth [m, (N,)] of world points [m, (N, 3)] in a view at a frame
        (indices), differentiable in the points and in the values. The points are where the view sees them: time offsets
        are left to :meth:`seen`.
        """
        view_id, intrinsic = video.view_ids[view], video.intrinsics[view].to(points)
        pose = self.pose(video.camera_to_world[view].to(points), view_id, _since_start(video, frame))
        pixels, depth = cameras.project(points, intrinsic, pose)
        if not self.changing("image_plane", view_id):
            return pixels, depth
        focal = torch.stack((intrinsic[0, 0], -intrinsic[1, 1]))
        uv = (pixels - intrinsic[:2, 2]) / focal
        return intrinsic[:2, 2] + focal * self.distorted(uv, view_id), depth

    def changing(self, aspect: str, view_id: int | None = None) -> list[Observation]:
        """The effects that override a method and, if a view is given, concern it."""
        acting = [effect for effect in self.observations if view_id is None or effect.concerns(view_id)]
        return [effect for effect in acting if getattr(type(effect), aspect) is not getattr(Observation, aspect)]

    def _newton_step(self, ideal: Tensor, observed: Tensor, view_id: int) -> Tensor:
        """J^-1 (observed - distorted(ideal)), with a constant J: the derivative by the coefficients is exact."""
        with torch.enable_grad():
            variable = ideal.detach().requires_grad_()
            image = self.distorted(variable, view_id)
            rows = [torch.autograd.grad(image[:, k].sum(), variable, retain_graph=True)[0] for k in (0, 1)]
        return torch.linalg.solve(torch.stack(rows, dim=1), observed - self.distorted(ideal, view_id))


AS_BELIEVED = Observer()


def between_frames(trajectory: Tensor, velocity: Tensor, wanted: Tensor, step: Tensor) -> Tensor:
    """Positions [m, (K, N, 3)] at fractional frame numbers ``wanted`` (K,), by cubic Hermite interpolation.

    The slopes are central differences, at frame 0 the initial velocity, and at the last frame that of the parabola
    through the last slope and positions. Outside the frames the motion goes on along the parabola of the interval at
    the end (before frame 0, through x0, v0 and x1): exact in free fall.

    Args:
        trajectory: [m, (F, N, 3)], F at least 2.
        velocity: at frame 0 [m/s, (N, 3) or (3,)].
        step: time between frames [s, scalar].
    """
    change = trajectory[1:] - trajectory[:-1]
    first = (velocity * step).expand_as(trajectory[0])[None]
    slopes = torch.cat((first, 0.5 * (change[1:] + change[:-1])))
    slopes = torch.cat((slopes, 2 * change[-1:] - slopes[-1:]))
    begin = wanted.detach().floor().long().clamp(0, len(trajectory) - 2)
    s = (wanted - begin).view(-1, 1, 1)
    before, after = slopes[begin], slopes[begin + 1]
    moved = change[begin]
    cubic = (before + after - 2 * moved) * torch.where(s < 0, torch.zeros_like(s), s - 1)
    return trajectory[begin] + s * (before + s * (moved - before + cubic))


def _since_start(video: Video, frame: int) -> float:
    return float(video.times[frame] - video.times[0])
