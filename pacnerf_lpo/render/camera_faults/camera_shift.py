"""A camera that does not stand where its calibration says."""

from types import SimpleNamespace

import torch
from torch import Tensor

from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.render.camera_faults.base import Observation

REACH = (-1.0, 1.0)  # m


class CameraShift(Observation):
    """The camera is displaced along its own axes, x right and y up, by a constant.

    A point at depth z moves in the image by -f shift / z.

    Args:
        shift_x, shift_y: true minus believed position of the camera [m].
        view: file id of the camera; None: all cameras.
    """

    parameters = named(
        Parameter("shift_x", "m", Identity(), REACH, "shift to the right", scale=0.01),
        Parameter("shift_y", "m", Identity(), REACH, "shift upwards", scale=0.01),
    )
    signature = "one view is off by the same few pixels in every frame, frame 0 included; the others fit"
    confused_with = ("CameraRotation", "TimeOffset")
    separating_experiment = "a checkerboard or any object at rest filmed by all cameras before the drop"
    probes = ({"shift_x": 0.01, "shift_y": 0.0}, {"shift_x": 0.0, "shift_y": 0.01})

    def camera(self, view: int, c2w: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        return moved_in_its_plane(c2w, c.shift_x, c.shift_y)


def moved_in_its_plane(c2w: Tensor, right: Tensor, up: Tensor) -> Tensor:
    """The pose [(3, 4)] moved along the camera's own x and y axes [m, scalars]."""
    offset = torch.stack((right, up)).to(c2w)
    return torch.cat((c2w[:, :3], c2w[:, 3:] + c2w[:, :2] @ offset[:, None]), dim=1)
