"""One synthetic scene, traced exactly: a ball falls, lands and flattens, seen by six cameras through any lens.

A layout's test films it in a world of its own: other axes, another origin and unit, lenses where the layout has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
from PIL import Image
from scipy import ndimage
from scipy.optimize import linprog

from pacnerf_lpo.data.recordings.recording import Lens
from pacnerf_lpo.data.synthetic import hemisphere_rig

SIZE, VIEWS, FRAMES, FPS = 96, 6, 11, 24.0
RADIUS, START, VELOCITY, GRAVITY = 0.2, np.array([0.05, 0.75, -0.1]), np.array([0.3, -0.5, 0.1]), 9.81
PINHOLE = Lens()
SOFT = Lens("opencv", (-0.12, 0.03, 0.002, -0.001, 0.0))
FISHEYE = Lens("fisheye", (0.05, -0.02, 0.01, 0.0))
NAMES = ("left", "right", "front", "back", "top", "door")
SUPERSAMPLING = 4
IN_STEP = (0.0,) * VIEWS


@dataclass(frozen=True)
class World:
    """x in metres, y up -> (turn x + origin) / unit; the lens of all cameras."""

    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unit: float = 1.0
    lens: Lens = PINHOLE

    @property
    def up(self) -> np.ndarray:
        return self.turn[:, 1]

    def point(self, position: np.ndarray) -> np.ndarray:
        return (self.turn @ position + self.origin) / self.unit

    def poses(self) -> list[np.ndarray]:
        """Camera to world, OpenGL [(3, 4)]."""
        return [np.column_stack((self.turn @ pose[:, :3], self.point(pose[:, 3]))) for pose in rig()]

    def opencv(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """OpenCV's world-to-camera rotation and translation."""
        found = []
        for pose in self.poses():
            rotation = (pose[:, :3] * [1.0, -1.0, -1.0]).T
            found.append((rotation, -rotation @ pose[:, 3]))
        return found


def turned(*columns: tuple[int, int, int]) -> np.ndarray:
    """The rotation that takes x, y, z to these vectors."""
    turn = np.array(columns, float).T
    assert np.isclose(np.linalg.det(turn), 1.0)
    return turn


Z_UP = turned((1, 0, 0), (0, 0, 1), (0, -1, 0))
Z_DOWN = turned((1, 0, 0), (0, 0, -1), (0, 1, 0))
X_DOWN = turned((0, 1, 0), (-1, 0, 0), (0, 0, 1))
TILTED = cv2.Rodrigues(np.array([0.7, -1.1, 0.4]))[0]


def rig() -> np.ndarray:
    """Camera to world, OpenGL [(VIEWS, 3, 4)]: the lower six of eleven cameras, which see the ball's whole fall."""
    return hemisphere_rig(11, SIZE).camera_to_world[[0, 2, 4, 5, 7, 10]]


def intrinsic() -> np.ndarray:
    """Pixel centres at +0.5, the principal point a little off the centre."""
    return hemisphere_rig(VIEWS, SIZE).intrinsics[0] + [[0, 0, 1.5], [0, 0, -2.0], [0, 0, 0]]


def centred() -> np.ndarray:
    return hemisphere_rig(VIEWS, SIZE).intrinsics[0]


def opencv_intrinsic() -> np.ndarray:
    """The same with the first pixel's centre at 0."""
    return intrinsic() - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]


def body(frame: float, tilt: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Centre and half axes of the ellipsoid [m]: a ball in flight, standing on the ground and flattening afterwards.

    tilt: of gravity against the ground's normal, towards +x [rad].
    """
    time = frame / FPS
    gravity = GRAVITY * np.array([np.sin(tilt), -np.cos(tilt), 0.0])
    landing = landing_time(tilt)
    centre = START + VELOCITY * time + 0.5 * gravity * time**2
    if time < landing:
        return centre, np.full(3, RADIUS)
    speed = -VELOCITY[1] - gravity[1] * landing
    flat = 0.65 + 0.35 * np.exp(-(time - landing) * speed / (0.35 * RADIUS))
    where = START + VELOCITY * landing + 0.5 * gravity * landing**2
    wide = RADIUS / np.sqrt(flat)
    return np.array([where[0], flat * RADIUS, where[2]]), np.array([wide, flat * RADIUS, wide])


def landing_time(tilt: float = 0.0) -> float:
    """Moment of contact [s]: 0.5 t + g cos(tilt) t^2 / 2 = height of the lowest point."""
    g = GRAVITY * np.cos(tilt)
    return float((-0.5 + np.sqrt(0.25 + 2.0 * g * (START[1] - RADIUS))) / g)


CONTACT = int(np.ceil(landing_time() * FPS))


@lru_cache(maxsize=8)
def films(lens: Lens = PINHOLE, off_centre: bool = True, late: tuple[float, ...] = IN_STEP) -> np.ndarray:
    """Colour and opacity [0..1, (VIEWS, FRAMES, SIZE, SIZE, 4)], in metres and y up: worlds do not change images.

    late: how much later than their stamp the frames of each camera are taken [frames].
    """
    return np.stack([film(view, np.arange(FRAMES) + late[view], lens, off_centre) for view in range(VIEWS)])


def film(
    view: int, moments: Sequence[float], lens: Lens = PINHOLE, off_centre: bool = True, tilt: float = 0.0
) -> np.ndarray:
    """What one camera sees at moments [frames], before nothing [0..1, (len(moments), SIZE, SIZE, 4)]."""
    k = intrinsic() if off_centre else centred()
    fine = (np.arange(SIZE * SUPERSAMPLING) + 0.5) / SUPERSAMPLING
    pixels = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    rays = (pixels - k[:2, 2]) / k[[0, 1], [0, 1]]
    if lens.distorts:
        undistort = cv2.fisheye.undistortPoints if lens.model == "fisheye" else cv2.undistortPoints
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12)
        rays = undistort(rays[:, None], np.eye(3), np.array(lens.coefficients), criteria=criteria)[:, 0]
    rays = np.column_stack((rays[:, 0], -rays[:, 1], -np.ones(len(rays))))
    pose = rig()[view]
    return np.stack([_trace(rays @ pose[:, :3].T, pose[:, 3], *body(moment, tilt)) for moment in moments])


def hull_bounds(centre: np.ndarray, radius: float, cameras: np.ndarray) -> np.ndarray:
    """Corners of the box around all that a ball's outlines allow [m, (2, 3)]: every camera [m, (N, 3)] sees a cone.

    Few cameras see more than the ball: six of the studio allow 14 % of its radius more along z.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    normals, offsets = [], []
    for camera in cameras:
        away = (camera - centre) / np.linalg.norm(camera - centre)
        sine = radius / np.linalg.norm(camera - centre)
        across = np.linalg.svd(away[None])[2][1:]
        around = np.column_stack((np.cos(angle), np.sin(angle))) @ across
        normals.append(sine * away + np.sqrt(1.0 - sine**2) * around)
        offsets.append(normals[-1] @ camera)
    limits = {"A_ub": np.concatenate(normals), "b_ub": np.concatenate(offsets), "bounds": (None, None)}
    return np.array([[sign * linprog(sign * axis, **limits).fun for axis in np.eye(3)] for sign in (1.0, -1.0)])


def _trace(directions: np.ndarray, origin: np.ndarray, centre: np.ndarray, axes: np.ndarray) -> np.ndarray:
    d, o = directions / axes, (origin - centre) / axes
    a, b, c = np.einsum("rk,rk->r", d, d), d @ o, o @ o - 1.0
    square = b * b - a * c
    hit = np.flatnonzero(square > 0)
    point = o + d[hit] * ((-b[hit] - np.sqrt(square[hit])) / a[hit])[:, None]
    colour = np.where(np.sin(9.0 * point[:, :1]) > 0, [0.8, 0.2, 0.15], [0.9, 0.6, 0.1]) * (0.7 + 0.3 * point[:, 1:2])
    shade = np.zeros((len(d), 4))
    shade[hit] = np.column_stack((colour, np.ones(len(colour))))
    wide = SIZE * SUPERSAMPLING
    fine = cv2.resize(shade.reshape(wide, wide, 4), (SIZE, SIZE), interpolation=cv2.INTER_AREA)  # the mean of a pixel
    fine[..., :3] /= np.maximum(fine[..., 3:], 1e-6)
    return fine


@lru_cache(maxsize=VIEWS)
def background(view: int) -> np.ndarray:
    """A smooth texture in greens and blues [0..1, (SIZE, SIZE, 3)]."""
    noise = np.random.default_rng(view).random((SIZE, SIZE, 3))
    smooth = ndimage.gaussian_filter(noise, (5, 5, 0), mode="wrap")
    smooth = (smooth - smooth.min()) / (smooth.max() - smooth.min())
    colours = np.array([0.1, 0.35, 0.45]) + np.array([0.15, 0.35, 0.35]) * smooth
    colours.flags.writeable = False
    return colours


@lru_cache(maxsize=8)
def raw(lens: Lens = PINHOLE, off_centre: bool = True, late: tuple[float, ...] = IN_STEP) -> np.ndarray:
    """The films in front of their backgrounds [0..1, (VIEWS, FRAMES, SIZE, SIZE, 3)], for all that ask: read-only."""
    found = np.stack([before_background(view, shown) for view, shown in enumerate(films(lens, off_centre, late))])
    found.flags.writeable = False
    return found


def before_background(view: int, film: np.ndarray) -> np.ndarray:
    """A film of one camera in front of its background [0..1, (F, SIZE, SIZE, 3)]."""
    return film[..., 3:] * film[..., :3] + (1.0 - film[..., 3:]) * background(view)


def save(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(255.0 * pixels).astype(np.uint8)).save(path)


def save_video(path: Path, frames: np.ndarray, fps: float = FPS) -> None:
    """Nearly lossless, so that a test of cameras is none of compression."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.round(255.0 * frames).astype(np.uint8)
    imageio.imwrite(path, pixels, fps=fps, plugin="FFMPEG", output_params=["-crf", "4"], macro_block_size=2)
