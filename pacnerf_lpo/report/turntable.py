"""Views that no camera took: stills from any side and a camera that goes once around the object."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.data.cameras import pixel_rays
from pacnerf_lpo.evaluation.prediction import StateRenderer, to_bytes
from pacnerf_lpo.types import FieldGrid, Rays

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
        turn, rise = math.radians(azimuth), math.radians(self.elevation)
        backward = torch.tensor(
            [math.sin(turn) * math.cos(rise), math.sin(rise), math.cos(turn) * math.cos(rise)], dtype=torch.float64
        )
        right = torch.tensor([math.cos(turn), 0.0, -math.sin(turn)], dtype=torch.float64)
        up = torch.linalg.cross(backward, right)
        position = torch.tensor(self.centre, dtype=torch.float64) + self.distance * backward
        return torch.stack((right, up, backward, position), dim=1)

    def rays(self, azimuth: float) -> Rays:
        """The rays of the camera at this azimuth [deg]."""
        focal = self.size / (2 * math.tan(math.radians(FIELD_OF_VIEW / 2)))
        intrinsic = torch.tensor([[focal, 0, self.size / 2], [0, focal, self.size / 2], [0, 0, 1]], dtype=torch.float64)
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
    shown: tuple[int, FieldGrid] | None = None
    for azimuth, moment in zip(azimuths, moments, strict=True):
        if shown is None or shown[0] != moment:
            shown = (moment, renderer.grid(positions[moment]))
        image, _ = renderer.image(shown[1], orbit.rays(azimuth), (orbit.size, orbit.size))
        yield to_bytes(image)
