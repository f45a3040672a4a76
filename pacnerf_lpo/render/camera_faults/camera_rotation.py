"""A camera that looks in another direction than its calibration says."""

from math import radians
from types import SimpleNamespace

import torch
from torch import Tensor

from pacnerf_lpo.mpm.effects.base import one_at_a_time
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.render.camera_faults.base import Observation

RANGE = (-45.0, 45.0)  # deg


class CameraRotation(Observation):
    """The camera is turned about its own axes by a constant: true pose = believed pose times exp([w]x).

    A small tilt up (about x) moves the image down by f w_x, a pan to the left (about y) moves it right by f w_y, a roll
    (about the axis that points out of the scene) turns it.

    Args:
        tilt, pan, roll: the components of w about the camera's x, y and z axes [deg].
        view: file id of the camera; None: all cameras.
    """

    parameters = named(
        Parameter("tilt", "deg", Identity(), RANGE, "tilt upwards", scale=0.25),
        Parameter("pan", "deg", Identity(), RANGE, "pan to the left", scale=0.25),
        Parameter("roll", "deg", Identity(), RANGE, "roll", scale=1.0),
    )
    signature = "one view is shifted or turned by the same amount in every frame, frame 0 included; the others fit"
    confused_with = ("CameraShift", "UniformForce")
    separating_experiment = "a checkerboard or a plumb line filmed by all cameras before the drop"
    probes = one_at_a_time(tilt=0.25, pan=0.25, roll=1.0)

    def camera(self, view: int, c2w: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        turn = radians(1.0) * torch.stack((c.tilt, c.pan, c.roll)).to(c2w)
        generator = torch.linalg.cross(torch.eye(3).to(c2w), turn.expand(3, 3))
        return torch.cat((c2w[:, :3] @ torch.linalg.matrix_exp(generator), c2w[:, 3:]), dim=1)
