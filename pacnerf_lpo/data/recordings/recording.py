"""A recording as a reader found it: cameras, lenses, frames and what the layout says about unit, up and ground."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pacnerf_lpo.data.recordings.conventions import check_rotation
from pacnerf_lpo.errors import UserInputError

GRAVITY, WATER = 9.81, 1000.0
"""On Earth [m/s^2]."""
LENS_COEFFICIENTS = {"opencv": (4, 5, 8, 12, 14), "fisheye": (4,)}
"""How many coefficients each lens model has: k1 k2 p1 p2 [k3 ...] and k1 ... k4, in OpenCV's order."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Metres per unit."""
AXES: dict[str, tuple[float, float, float]] = {
    "x": (1, 0, 0),
    "y": (0, 1, 0),
    "z": (0, 0, 1),
    "-x": (-1, 0, 0),
    "-y": (0, -1, 0),
    "-z": (0, 0, -1),
}
REACH = 10.0
"""Undistorted directions are tried up to so many times the corner of the image."""
OFF_CENTRE = 0.25
"""A principal point farther from the centre than this part of the image was calibrated for another size."""


@dataclass(frozen=True)
class Lens:
    """Distortion in OpenCV's models; ``coefficients`` are those of ``model``, none without distortion."""

    model: Literal["opencv", "fisheye"] = "opencv"
    coefficients: tuple[float, ...] = ()

    @property
    def distorts(self) -> bool:
        """Whether images have to be undistorted."""
        return any(self.coefficients)


@dataclass(frozen=True)
class Frame:
    """One image: a file, or a place in a video file.

    file: image or video
    time: [s]; None where the layout does not say
    place: number of the frame in the video; None for an image
    mask: image of the same size, bright on the object; None where there is none
    """

    file: Path
    time: float | None
    place: int | None = None
    mask: Path | None = None


@dataclass(frozen=True)
class Camera:
    """A camera that stands still.

    name: as the layout calls it
    intrinsic: focal lengths and principal point [pixels, (3, 3)], pixel centres at +0.5
    pose: camera to world, OpenGL axes (x right, y up, looking along -z) [rotation and the recording's unit, (3, 4)]
    frames: in the order of time
    lens: its distortion
    plate: image of the empty background; None where there is none
    size: width and height that it was calibrated for [pixels]; None where the layout does not say
    on_white: the images show the object on pure white
    """

    name: str
    intrinsic: np.ndarray
    pose: np.ndarray
    frames: tuple[Frame, ...]
    lens: Lens = Lens()
    plate: Path | None = None
    size: tuple[int, int] | None = None
    on_white: bool = False


@dataclass(frozen=True)
class Recording:
    """What a reader found; None means that the layout does not say.

    layout: name of the layout
    source: folder it was read from
    unit: metres per unit of length of the poses
    up: unit vector against gravity, in the poses' world [(3,)]
    normal: unit normal of the ground, in the poses' world [(3,)]; None: ``up``
    ground: height of the ground along its normal, in the poses' unit
    gravity: strength [m/s^2]
    metric: the unit is that of a measured calibration board, so m, cm or mm, if only the layout said which
    density: of the body [kg/m^3]; None: nobody said
    options: those of the command line that took the place of what the layout says
    """

    layout: str
    source: Path
    cameras: tuple[Camera, ...]
    unit: float | None = None
    up: tuple[float, float, float] | None = None
    ground: float | None = None
    metric: bool = False
    normal: tuple[float, float, float] | None = None
    gravity: float = GRAVITY
    density: float | None = None
    options: tuple[str, ...] = ()

    def stated(self, option: str) -> str:
        """Who stated what this option of the command line states."""
        return f"stated by {option if option in self.options else f'the layout {self.layout}'}"

    def _by(self, option: str, **changes: Any) -> "Recording":
        return replace(self, options=(*self.options, option), **changes)

    def with_unit(self, unit: str) -> "Recording":
        """The same recording with lengths in m, cm, mm, or so many metres. Raises UserInputError for anything else."""
        try:
            metres = UNITS[unit] if unit in UNITS else float(unit)
        except ValueError:
            metres = float("nan")
        if not (metres > 0 and np.isfinite(metres)):
            raise UserInputError(f"--unit {unit}: give {', '.join(UNITS)}, or how many metres one unit is")
        return self._by("--unit", unit=metres)

    def with_up(self, up: str) -> "Recording":
        """The same with an up direction: an axis, three numbers, or ``fall`` for free fall; else UserInputError."""
        if up == "fall":
            return self._by("--up", up=None)
        try:
            vector = np.array(AXES[up] if up in AXES else [float(part) for part in up.strip("[]() ").split(",")])
        except ValueError:
            vector = np.zeros(0)
        length = float(np.linalg.norm(vector))
        if vector.shape != (3,) or not (length > 0 and np.isfinite(length)):
            raise UserInputError(
                f"--up {up}: give an axis ({', '.join(AXES)}), three numbers such as [0,0.17,0.98], or fall"
            )
        x, y, z = (vector / length).tolist()
        return self._by("--up", up=(x, y, z))

    def with_ground(self, height: float | None, normal: Sequence[float] | None) -> "Recording":
        """The same recording with a ground stated. Raises UserInputError where the normal is none."""
        if normal is None:
            return self if height is None else self._by("--ground", ground=height)
        length = float(np.linalg.norm(normal))
        if len(normal) != 3 or not (length > 0 and np.isfinite(length)):
            raise UserInputError(
                f"--ground_normal {list(normal)}: give three numbers, the direction at a right angle to the ground in "
                "the calibration's axes, for instance [0,0.17,0.98] for a slope of 10 degrees"
            )
        x, y, z = (float(value) / length for value in normal)
        return self._by("--ground", normal=(x, y, z), ground=height)  # a height along another normal means nothing

    def with_gravity(self, gravity: float) -> "Recording":
        """The same recording under gravity of this strength [m/s^2]. Raises UserInputError for a negative one."""
        if not (gravity >= 0 and np.isfinite(gravity)):
            raise UserInputError(f"--gravity {gravity:g}: give its strength in m/s^2, 9.81 on Earth, 0 for none")
        return replace(self, gravity=gravity)

    def with_density(self, density: float | None) -> "Recording":
        """The same recording of a body of this density [kg/m^3]. Raises UserInputError for one that is not positive."""
        if density is not None and not (density > 0 and np.isfinite(density)):
            raise UserInputError(f"--density {density:g}: give that of the body in kg/m^3, {WATER:g} for water")
        return replace(self, density=density)

    def with_frame_rate(self, fps: float) -> "Recording":
        """The same recording with times counted at ``fps`` frames a second, whatever its files say."""
        if not (fps > 0 and np.isfinite(fps)):
            raise UserInputError(f"--fps {fps:g}: give the frames per second of the videos, a positive number")
        cameras = tuple(
            replace(camera, frames=tuple(replace(frame, time=i / fps) for i, frame in enumerate(camera.frames)))
            for camera in self.cameras
        )
        return self._by("--fps", cameras=cameras)

    def without(self, names: Sequence[str]) -> "Recording":
        """The same recording without these cameras. Raises UserInputError where there is no camera of a name."""
        own = [camera.name for camera in self.cameras]
        for name in names:
            if name not in own:
                raise UserInputError(f"--leave_out {name}: there is no such camera; there are {', '.join(own)}")
        return replace(self, cameras=tuple(camera for camera in self.cameras if camera.name not in names))


def check_recording(recording: Recording) -> None:
    """Several cameras with different names and poses, each with images, a rigid pose and possible intrinsics. Raises
    UserInputError that names the first camera that is not so.
    """
    cameras = recording.cameras
    if len(cameras) < 2:
        names = ", ".join(camera.name for camera in cameras) or "none"
        raise UserInputError(
            f"{recording.source}: {len(cameras)} camera with images ({names}); a shape needs two views or more"
        )
    seen: dict[bytes, str] = {}
    for camera in cameras:
        where = f"{recording.source}, camera {camera.name}"
        if not camera.frames:
            raise UserInputError(f"{where}: no images; add its video or images, or remove it from the calibration")
        _check_numbers(where, camera)
        check_rotation(where, camera.pose[:, :3])
        place = camera.pose.round(6).tobytes()
        if place in seen:
            raise UserInputError(f"{where}: stands exactly where camera {seen[place]} does; calibrate the two again")
        seen[place] = camera.name


def _check_numbers(where: str, camera: Camera) -> None:
    for what, array, shape in (("intrinsics", camera.intrinsic, (3, 3)), ("pose", camera.pose, (3, 4))):
        if array.shape != shape or not np.isfinite(array).all():
            raise UserInputError(f"{where}: its {what} must be {shape[0]} x {shape[1]} finite numbers; calibrate again")
    (fx, skew, _), (tilt, fy, _), last = camera.intrinsic.tolist()
    if not (fx > 0 and fy > 0) or abs(skew) > 1e-3 * fx or tilt != 0 or last != [0, 0, 1]:
        raise UserInputError(
            f"{where}: intrinsics must read [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy; they may "
            "be transposed"
        )
    allowed = LENS_COEFFICIENTS[camera.lens.model]
    if camera.lens.coefficients and len(camera.lens.coefficients) not in allowed:
        raise UserInputError(
            f"{where}: {len(camera.lens.coefficients)} distortion coefficients; the {camera.lens.model} model has "
            f"{' or '.join(map(str, allowed))}"
        )


def check_images(camera: Camera, size: tuple[int, int]) -> None:
    """Images of this width and height [pixels] are what the camera was calibrated for, and its lens maps directions to
    them one to one, up to their corners. Raises UserInputError where they have another size, the principal point is far
    from their centre, or the radial coefficients of the lens fold them.
    """
    where = camera.frames[0].file
    mend = "use images of the size that was calibrated, or scale its intrinsics to the images"
    if camera.size is not None and camera.size != size:
        raise UserInputError(
            f"{where}: {size[0]} x {size[1]} pixels, but camera {camera.name} was calibrated for "
            f"{camera.size[0]} x {camera.size[1]}; {mend}"
        )
    centre = camera.intrinsic[:2, 2]
    if np.any(np.abs(centre / size - 0.5) > OFF_CENTRE):
        raise UserInputError(
            f"{where}: {size[0]} x {size[1]} pixels do not fit the intrinsics of camera {camera.name}, whose principal "
            f"point is ({centre[0]:.4g}, {centre[1]:.4g}); {mend}"
        )

    corners = np.array([(x, y) for x in (0, size[0]) for y in (0, size[1])]) - centre
    farthest = float(np.linalg.norm(corners / camera.intrinsic[[0, 1], [0, 1]], axis=1).max())
    k = np.array([*camera.lens.coefficients, *(0.0,) * 8][:8])
    if camera.lens.model == "fisheye":
        angle = np.linspace(0.0, np.pi, 2000)
        reached = angle * (1.0 + np.polyval([*k[3::-1], 0.0], angle**2))
    else:
        r = np.linspace(0.0, REACH * farthest, 2000)
        # k3 k2 k1 over k6 k5 k4 of OpenCV's rational model
        above, below = (1.0 + np.polyval([*k[places], 0.0], r**2) for places in ([4, 1, 0], [7, 6, 5]))
        reached = r * above / below
    folds = np.flatnonzero(np.diff(reached) <= 0.0)
    if camera.lens.distorts and reached[: folds[0] + 1 if len(folds) else None].max() < farthest:
        raise UserInputError(
            f"{where}: the distortion coefficients of camera {camera.name} fold the image before its corners; their "
            "order is k1 k2 p1 p2 k3 (fisheye: k1 k2 k3 k4), their sign that of OpenCV; calibrate again"
        )
