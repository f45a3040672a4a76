"""A camera that creeps while it films."""

from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.render.camera_faults.base import Observation
from pacnerf_lpo.render.camera_faults.camera_shift import moved_in_its_plane

SPEED = (-10.0, 10.0)  # m/s


class CameraDrift(Observation):
    """The camera moves along its own axes, x right and y up, at a constant speed; at frame 0 it stands where believed.

    A point at depth z moves in the image by -f drift t / z.

    Args:
        drift_x, drift_y: velocity of the camera [m/s].
        view: file id of the camera; None: all cameras.
    """

    parameters = named(
        Parameter("drift_x", "m/s", Identity(), SPEED, "drift to the right", scale=0.03),
        Parameter("drift_y", "m/s", Identity(), SPEED, "drift upwards", scale=0.03),
    )
    signature = "one view departs from the others steadily, from nothing at frame 0, whatever the body does"
    confused_with = ("TimeOffset", "UniformForce")
    separating_experiment = "the same camera filming an object at rest for as long"
    probes = ({"drift_x": 0.03, "drift_y": 0.0}, {"drift_x": 0.0, "drift_y": 0.03})

    def camera(self, view: int, c2w: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        return moved_in_its_plane(c2w, c.drift_x * t, c.drift_y * t)
