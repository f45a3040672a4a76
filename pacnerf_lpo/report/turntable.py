"""Views that no camera took: stills from any side and a camera that goes once around the object."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.data.cameras import pixel_rays, poses_around
from pacnerf_lpo.data.recordings.conventions import centred_intrinsic
from pacnerf_lpo.evaluation.prediction import StateRenderer, to_bytes
from pacnerf_lpo.types import Rays

FIELD_OF_VIEW = 35.0
MARGIN = 1.25


@dataclass(frozen=True)
class Orbit:
    """Cameras on a circle around an object, looking at its centre.

    centre: [m]
    distance: from the centre to the camera [m]
    elevation: over the horizon [deg]
    size: width and height of the square images [pixels]
    """

    centre: tuple[float, float, float]
    distance: float
    elevation: float
    size: int

    @staticmethod
    def around(positions: Tensor, elevation: float, size: int) -> "Orbit":
        """An orbit that keeps every particle of every frame in view, positions [m, (F, N, 3)]."""
        lower, upper = positions.flatten(0, 1).amin(0), positions.flatten(0, 1).amax(0)
        radius = 0.5 * (upper - lower).norm().item()
        distance = MARGIN * radius / math.sin(math.radians(FIELD_OF_VIEW / 2))
        x, y, z = (0.5 * (lower + upper)).tolist()
        return Orbit((x, y, z), distance, elevation, size)

    def camera_to_world(self, azimuth: float) -> Tensor:
        """Pose [(3, 4)] of the camera at this azimuth [deg]; 0 looks along -z, 90 along -x."""
        angles = np.radians([azimuth, self.elevation])
        return torch.from_numpy(poses_around(np.array(self.centre), self.distance, *angles))

    def rays(self, azimuth: float) -> Rays:
        """The rays of the camera at this azimuth [deg]."""
        intrinsic = torch.from_numpy(centred_intrinsic(math.radians(FIELD_OF_VIEW), self.size, self.size))
        return pixel_rays(intrinsic, self.camera_to_world(azimuth), self.size, self.size)


def turntable(
    renderer: StateRenderer, positions: Tensor, orbit: Orbit, azimuths: list[float], moments: list[int]
) -> Iterator[np.ndarray]:
    """One picture for each azimuth [deg] and the frame shown with it.

    Args:
        positions: [m, (F, N, 3)]
        moments: index of the frame, one for each azimuth.

    Yields:
        [0..255, (size, size, 3), uint8]
    """
    grid = lru_cache(1)(lambda moment: renderer.grid(positions[moment]))
    for azimuth, moment in zip(azimuths, moments, strict=True):
        image, _ = renderer.image(grid(moment), orbit.rays(azimuth), (orbit.size, orbit.size))
        yield to_bytes(image)
