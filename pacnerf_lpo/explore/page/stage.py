"""The 3-D part of the page: bodies, what was measured of them, the ground, and the cameras to step into."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from pacnerf_lpo.explore.records import Camera, Motion

THUMBNAIL = 96
"""Pixels of the longer side of a picture in a frustum: it is sent again for every frame that is shown."""
KINDS = {"hull": (150, 156, 166), "tracks": (206, 32, 90), "clouds": (0, 121, 92)}
"""What can be measured in space, and its colour."""
GROUND = (150, 156, 166)
"""Colour of the lines on the ground: seen on white and on black."""
SQUARES = 4
"""Of the ground, along the size of what lies on it."""
Colour = tuple[int, int, int]
EDGE, HELD_EDGE, CHOSEN_EDGE = (90, 96, 104), (232, 113, 10), (42, 125, 225)
"""Colours of frusta: of a camera that is fitted, of one that is held out, of the one that is looked through."""


@dataclass
class Moving:
    """A body or a measurement that is shown at one frame at a time.

    frames: positions [m, (F, N, 3)], or a list of (N, 3), of another N at each frame.
    colours: [0..255, (F, N, 3), (N, 3) or (3,), uint8]
    """

    frames: list[np.ndarray]
    colours: np.ndarray
    size: float
    offset: np.ndarray


class Stage:
    """What stands in the scene of a server; ``choose`` is called with the number of a camera that was clicked."""

    def __init__(self, server: viser.ViserServer, choose: Callable[[int], None]):
        self.server, self.choose = server, choose
        self._moving: dict[str, Moving] = {}
        self._clouds: dict[str, viser.PointCloudHandle] = {}
        self._frusta: list[tuple[viser.CameraFrustumHandle, Colour]] = []
        self.frame = 0
        server.scene.set_up_direction("+y")

    def ground(self, height: float, centre: np.ndarray, size: float) -> None:
        """A grid at a height [m] around a place, a few times as wide as what lies on it [m]."""
        cells = 2 * SQUARES
        along = size / SQUARES * np.arange(-cells, cells + 1)
        x, z = np.meshgrid(along, along, indexing="ij")
        knots = np.stack((x, np.zeros_like(x), z), axis=-1)
        # one piece a square: a piece that ends behind the eye is drawn over the body
        lines = [np.stack((one[:-1], one[1:]), axis=2).reshape(-1, 2, 3) for one in (knots, knots.swapaxes(0, 1))]
        self.server.scene.add_line_segments(
            "/ground", np.concatenate(lines).astype(np.float32), GROUND, thickness=1.0, thickness_units="screen",
            position=(float(centre[0]), height, float(centre[2])),
        )  # fmt: skip

    def look(self, centre: np.ndarray, distance: float) -> None:
        """Where a page that is opened looks from [m]."""
        camera = self.server.initial_camera
        camera.look_at = tuple(centre)
        camera.position = tuple(centre + distance * np.array([0.75, 0.4, 0.9]))
        camera.up = (0.0, 1.0, 0.0)

    def put(self, name: str, moving: Moving) -> None:
        """Show something under a name in place of what was there; nothing where it has no points at any frame."""
        if not any(len(points) for points in moving.frames):
            self._moving.pop(name, None)
            if (cloud := self._clouds.pop(name, None)) is not None:
                cloud.remove()
            return
        self._moving[name] = moving
        self._draw(name)

    def show(self, frame: int) -> None:
        """Show a frame of all that moves."""
        self.frame = frame
        for name in list(self._moving):
            self._draw(name)

    def _draw(self, name: str) -> None:
        moving = self._moving[name]
        frame = min(self.frame, len(moving.frames) - 1)
        points, colours = moving.frames[frame], moving.colours
        colours = np.broadcast_to(colours[frame] if colours.ndim == 3 else colours, points.shape)
        finite = np.isfinite(points).all(-1)
        points, colours = points[finite].astype(np.float32), np.ascontiguousarray(colours[finite])
        cloud = self._clouds.get(name)
        if cloud is None or len(cloud.points) != len(points):  # a cloud of another size is a new one
            self._clouds[name] = self.server.scene.add_point_cloud(
                f"/{name}", points, colours, point_size=moving.size, point_shape="circle", precision="float32",
                position=tuple(moving.offset),
            )  # fmt: skip
            return
        cloud.points, cloud.point_size, cloud.position = points, moving.size, moving.offset
        if moving.colours.ndim != 1 and not np.array_equal(cloud.colors, colours):
            cloud.colors = colours

    def cameras(self, cameras: Sequence[Camera], offset: np.ndarray, scale: float) -> None:
        """A frustum of a length, ``scale`` [m], for every camera of the recording that is looked at, and whose body is
        drawn at an ``offset`` from where it is [m, (3,)]; a click looks through it.
        """
        for frustum, _ in self._frusta:
            frustum.remove()
        self._frusta = []
        for number, camera in enumerate(cameras):
            pose = camera.camera_to_world
            turn, place = pose[:3, :3] @ np.diag([1.0, -1.0, -1.0]), pose[:3, 3] + offset
            wxyz = Rotation.from_matrix(turn).as_quat(scalar_first=True)
            fov = 2 * float(np.arctan(camera.height / 2 / camera.intrinsics[1, 1]))
            edge = HELD_EDGE if camera.held_out else EDGE
            frustum = self.server.scene.add_camera_frustum(
                f"/cameras/{number}", fov, camera.width / camera.height, scale=scale, thickness=0.02 * scale,
                color=edge, wxyz=tuple(wxyz), position=tuple(place),
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            frustum.on_click(partial(self._chosen, number))
            self._frusta.append((frustum, edge))

    def _chosen(self, number: int, event: viser.SceneNodePointerEvent) -> None:
        self.choose(number)
        self.step_into(number, event.client)

    def step_into(self, number: int, client: viser.ClientHandle | None) -> None:
        """Look through a camera, in one page or in all."""
        frustum, _ = self._frusta[number]
        for page in [client] if client is not None else list(self.server.get_clients().values()):
            with page.atomic():
                camera = page.camera
                camera.wxyz, camera.position, camera.fov = frustum.wxyz, frustum.position, frustum.fov

    def mark(self, number: int, picture: np.ndarray) -> None:
        """Mark the chosen camera, and show a picture with opacity [0..1, (H, W, 4)] in its frustum, small."""
        for index, (frustum, edge) in enumerate(self._frusta):
            colour = CHOSEN_EDGE if index == number else edge
            if tuple(frustum.color) != colour:
                frustum.color, frustum.image = colour, None
        step = max(1, max(picture.shape[:2]) // THUMBNAIL)
        small = np.clip(np.nan_to_num(picture[::step, ::step]), 0, 1)
        self._frusta[number][0].image = np.rint(255 * small).astype(np.uint8)


def centre_and_size(motions: dict[str, Motion]) -> tuple[np.ndarray, float]:
    """Middle of all that moves [m, (3,)], and how large that is [m]."""
    points = np.concatenate([motion.positions.reshape(-1, 3) for motion in motions.values()])
    points = points[np.isfinite(points).all(-1)]
    low, high = points.min(0), points.max(0)
    return (low + high) / 2, max(float((high - low).max()), 1e-6)
