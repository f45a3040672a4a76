"""The data section of the config: one scene, its training and test views, its box, and rays kept in memory."""

from collections.abc import Sequence
from dataclasses import replace

from pacnerf_lpo.data import checks
from pacnerf_lpo.data.assets import resolve_root
from pacnerf_lpo.data.cameras import pixel_rays
from pacnerf_lpo.data.hull import hull_box
from pacnerf_lpo.data.index import read_index
from pacnerf_lpo.data.measurements import PointClouds, TrackedPoints, read_point_clouds, read_tracked_points
from pacnerf_lpo.data.pac_nerf import Background, data_digest, read_pac_nerf
from pacnerf_lpo.types import Box, Rays, Video


class VideoData:
    """A multi-view video for training.

    Args:
        root: folder in PAC-NeRF's layout, or ``asset:bird`` for the shipped scene.
        box_lower, box_upper: corners of the box the object fills at frame 0 [m].
        train_views: file ids of the views trained on, e.g. ``[0, 4, 8]``; None for all.
        test_views: file ids of the views held out; None for the rest.
        fit_box: shrink the box to the visual hull of the training views' silhouettes at frame 0.
        frames: how many frames, from the first; None for all.
        image_scale: 0 < scale <= 1; images are area averaged.
        background: ``matted`` images, ``raw`` ones matted by their background plates, or ``auto``: matted if any.
        tracks: CSV of points followed over time (time_s, id, x_m, y_m, z_m and, if known, sigma_m), for diagnose and
            OutlineGaussNewton.
        clouds: folder of point clouds, cloud_<frame>.ply, for the same.
        velocity: of the body at frame 0 [m/s]; where views are out of step, they see it at different places, and its
            shape is learnt from them all.

    Attributes (after :meth:`prepare`):
        video: all used views. train, test: indices into its view axis. box: the corners.
        tracked_points, point_clouds: the measurements in addition to it; None where there are none.
    """

    video: Video
    train: list[int]
    test: list[int]
    box: Box
    tracked_points: TrackedPoints | None
    point_clouds: PointClouds | None

    def __init__(
        self,
        root: str,
        box_lower: list[float],
        box_upper: list[float],
        train_views: list[int] | None = None,
        test_views: list[int] | None = None,
        frames: int | None = None,
        image_scale: float = 1.0,
        background: Background = "auto",
        fit_box: bool = False,
        tracks: str | None = None,
        clouds: str | None = None,
        velocity: list[float] | None = None,
    ):
        super().__init__()  # that of Lightning, in a VideoModule
        self.root, self.frames, self.image_scale, self.background = root, frames, image_scale, background
        self.box_lower, self.box_upper, self.fit_box = box_lower, box_upper, fit_box
        self.train_views, self.test_views = train_views, test_views
        self.tracks, self.clouds = tracks, clouds
        self.velocity = checks.check_velocity(velocity)
        self._rays: dict[int, Rays] = {}

    def prepare(self) -> "VideoData":
        """Read and check the scene; a second call does nothing. Raises UserInputError. Returns itself."""
        if hasattr(self, "video"):
            return self
        box = checks.check_box(self.box_lower, self.box_upper)
        root = resolve_root(self.root)
        available = read_index(root).views()
        train = checks.check_views(
            "train_views", available if self.train_views is None else self.train_views, available
        )
        rest = [view for view in available if view not in train]
        test = checks.check_views("test_views", rest if self.test_views is None else self.test_views, available)
        checks.check_overlap(train, test)
        views = sorted({*train, *test})
        video = read_pac_nerf(root, views, self.frames, self.image_scale, self.background)
        self.train, self.test = [views.index(view) for view in train], [views.index(view) for view in test]
        checks.check_visible(video, self.train)
        first = at_start(video, self.velocity)
        checks.check_box_seen(first, box, self.train)
        self.box = hull_box(first, box, self.train) if self.fit_box else box
        self.measure(video, self.tracks, self.clouds)
        self.video = video
        return self

    @property
    def fingerprint(self) -> str:
        """Hash of the contents of all files of the video that are used. Raises UserInputError."""
        names = ("root", "train_views", "test_views", "frames", "background")
        return data_digest({name: getattr(self, name) for name in names})

    def measure(self, video: Video, tracks: str | None, clouds: str | None) -> None:
        """Read what else was measured: a CSV of tracked points, a folder of clouds. Raises UserInputError."""
        times = video.times.tolist()
        self.tracked_points = None if tracks is None else read_tracked_points(tracks, times)
        self.point_clouds = None if clouds is None else read_point_clouds(clouds, times)
        if self.tracked_points is not None:
            checks.check_points_in_box(self.tracked_points, video, self.box)

    def rays(self, view: int) -> Rays:
        """All ``H * W`` rays of a view (index into ``video``), row by row; computed once and kept."""
        if view not in self._rays:
            video = self.video
            height, width = video.images.shape[2:4]
            self._rays[view] = pixel_rays(video.intrinsics[view], video.camera_to_world[view], height, width)
        return self._rays[view]

    def first_rays(self, view: int) -> Rays:
        """The rays of a view at frame 0, from where it would see the body at time 0, see :func:`at_start`."""
        directions = self.rays(view).directions
        place = at_start(self.video, self.velocity).camera_to_world[view, :, 3].float()
        return Rays(place.expand_as(directions), directions)


def at_start(video: Video, velocity: Sequence[float]) -> Video:
    """The same video with cameras from which frame 0 looks as if all of it had been taken at time 0.

    A view that took its frame 0 later by its offset saw the body farther along; a camera that stands back by as much
    along the velocity [m/s, (3,)] would have seen the same at time 0.
    """
    if not video.offsets:
        return video
    poses = video.camera_to_world.clone()
    poses[..., 3] -= poses.new_tensor(video.offsets)[:, None] * poses.new_tensor(velocity)
    return replace(video, camera_to_world=poses)
