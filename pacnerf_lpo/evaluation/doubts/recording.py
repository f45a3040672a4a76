"""Doubts about a video as a measurement of the fit: too few views or pixels, no contact, another ground."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from pacnerf_lpo.data.cameras import project
from pacnerf_lpo.data.recordings.fall import fit_ballistic, lowest_point
from pacnerf_lpo.data.recordings.findings import GROUND_ERROR, find_contact, find_ground, free_flight
from pacnerf_lpo.data.recordings.tangents import Planes, bounds, outline_planes
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.evaluation.doubts.doubt import Doubt
from pacnerf_lpo.types import ParticleState

FEWEST_VIEWS = 3
"""Where two lines of sight meet at a small angle, they leave the depth open, and no third contradicts a wrong shape."""
LARGEST_RIM = 0.1
"""An outline is known to half a pixel. Where that is more than this part of the area, the volume is uncertain by more
than a seventh, and with it the mass that a stiffness is measured against."""
FEWEST_CELLS = 6.0
"""Two widths of the quadratic kernel of the grid: a body of fewer cells has no inside that its surface does not blur,
and is too stiff."""
FEWEST_CONTACT_FRAMES = 3
"""One compressed, one largest compression, one after it: with fewer, stiffness and loss cannot be distinguished."""
CONTACT_ERROR = 1
"""Frames by which the first contact may be wrong: it lies between two of them."""
FEW_VIEWS_ERROR = 2.0
"""Times the error of the measured ground with :data:`FEWEST_VIEWS` views or fewer, see :data:`GROUND_ERROR`."""
ALONG = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class Fall:
    """What the outlines of the training views say about the motion, without any model: the height at which the lowest
    point comes to rest [m], None where the body never leaves its free fall, and its error; the first frame at the
    ground, None where it is not reached; and the number of frames.
    """

    ground: float | None
    error: float
    contact: int | None
    frames: int


def measure_fall(data: VideoData) -> Fall | None:
    """The fall of the body by its outlines in the training views; None where too little of them is seen."""
    video = data.video
    times = video.times.double().numpy()

    def planes_of(view: int, frame: int) -> Planes:
        parts = video.silhouettes[view, frame], video.intrinsics[view], video.camera_to_world[view]
        return outline_planes(*(part.double().numpy() for part in parts))

    frames = [Planes.of([planes_of(view, frame) for view in data.train]) for frame in range(len(times))]
    heights = np.array([lowest_point(planes, ALONG) for planes in frames])
    if len(times) <= FEWEST_CONTACT_FRAMES or not np.isfinite(heights).all():
        return None
    lower, upper = bounds(frames[0])
    size = float((upper - lower).max())
    flight = free_flight(frames, times, size)
    if flight == len(times):
        return Fall(None, 0.0, None, len(times))
    ground, *_ = find_ground(heights, flight, size)
    motion = fit_ballistic(frames[:flight], times[:flight])
    error = GROUND_ERROR * size * (FEW_VIEWS_ERROR if len(data.train) <= FEWEST_VIEWS else 1.0)
    return Fall(ground, error, find_contact(heights, ground, motion.at(times) @ ALONG, flight), len(times))


def doubts_about_views(data: VideoData) -> Iterator[Doubt]:
    """Too few training views."""
    count = len(data.train)
    if count < FEWEST_VIEWS:
        yield Doubt(
            "few_views",
            "data.train_views",
            f"{count} view{'s' * (count > 1)} for the shape",
            "the body may be deeper than it is wide where no camera looks, and its mass wrong by as much",
            f"train with {FEWEST_VIEWS} views or more, from different sides",
        )


def doubts_about_pixels(data: VideoData, state: ParticleState) -> Iterator[Doubt]:
    """Too few pixels on the object, or too fine or too coarse voxels for it, by the particles of the static phase."""
    areas = data.video.silhouettes[data.train, 0].sum((-1, -2))
    across = 2.0 * float(areas.median() / np.pi) ** 0.5
    pixel = pixel_size(data, state)
    cells = (len(state.positions) / 8) ** (1 / 3)  # along an edge of a cube of as many: there are 8 particles in a cell
    if 2.0 / max(across, 1e-9) > LARGEST_RIM:
        yield Doubt(
            "few_pixels",
            "data",
            f"the object is {across:.0f} pixels across at frame 0; half a pixel at its outline is "
            f"{min(200 / max(across, 2), 100):.0f} % of its area",
            "the images are small, or made smaller by data.image_scale",
            f"use at least {2 / LARGEST_RIM:.0f} pixels: a larger data.image_scale, or cameras nearer to the object",
        )
    if state.spacing < pixel:
        yield Doubt(
            "fine_voxels",
            "phases.static",
            f"voxels of {1000 * state.spacing:.3g} mm are smaller than a pixel at the object, {1000 * pixel:.3g} mm",
            "base_spacing is halved more often than the images can show",
            "fewer scaling steps or a larger base_spacing, or larger images",
        )
    if cells < FEWEST_CELLS:
        yield Doubt(
            "coarse_voxels",
            "phases.static",
            f"the body is {cells:.1f} voxels across, of {1000 * state.spacing:.3g} mm",
            "base_spacing is too large for it; a coarse grid makes a body too stiff",
            f"a base_spacing smaller by a factor of {FEWEST_CELLS / cells:.1f} or more",
        )


def doubts_about_contact(fall: Fall, hit_frame: int) -> Iterator[Doubt]:
    """The contact is missing, too short, or elsewhere than in the frame that the configuration says."""
    if fall.contact is None:
        yield Doubt(
            "no_contact",
            "video",
            f"the outlines do not show that the body reaches the ground within {fall.frames} frames",
            "the video ends before the impact",
            "use a longer video; free fall shows forces, not the material",
        )
        return
    left = fall.frames - fall.contact
    if left < FEWEST_CONTACT_FRAMES:
        yield Doubt(
            "short_contact",
            "video",
            f"it shows {left} frame{'s' * (left > 1)} from the contact on",
            "the video, or data.frames, ends during the impact",
            f"use at least {FEWEST_CONTACT_FRAMES} frames from the contact on; fewer do not show a stiffness",
        )
    if abs(fall.contact - hit_frame) > CONTACT_ERROR:
        yield Doubt(
            "contact_frame",
            "phases.velocity.init_args.hit_frame",
            f"hit_frame is {hit_frame}, but the outlines reach the ground in frame {fall.contact}",
            "frames were counted from another start, or the ground lies elsewhere",
            f"set hit_frame to {fall.contact}, or check the ground",
        )


def doubts_about_ground(fall: Fall, ground: float, spacing: float) -> Iterator[Doubt]:
    """The outlines come to rest at another height than that of the ground in the configuration [m]; a grid itself
    shifts the contact by half of its node spacing [m].
    """
    error = fall.error + spacing / 2
    if fall.ground is not None and abs(fall.ground - ground) > error:
        yield Doubt(
            "ground",
            "physics.ground_height",
            f"the ground is at {ground:.3f} m, but the lowest points of the outlines come to rest at "
            f"{fall.ground:.3f} m (uncertain by {error:.3f} m)",
            "the world's origin is not on the ground, or cameras are wrong",
            f"set physics.ground_height to {fall.ground:.3f}, or check the calibration",
        )


def pixel_size(data: VideoData, state: ParticleState) -> float:
    """Size of a pixel at the body, median over the training views [m]."""
    video, centre = data.video, state.positions.mean(0, keepdim=True)
    depths = [project(centre, video.intrinsics[view], video.camera_to_world[view])[1][0] for view in data.train]
    return float((torch.stack(depths) / video.intrinsics[data.train, 0, 0]).median())
