"""A camera whose clock is wrong."""

from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.render.camera_faults.base import Observation


class TimeOffset(Observation):
    """A frame stamped t shows the world at t + time_offset.

    An offset s common to all views is nearly the same as another start, x0 + v0 s and v0 + g s.

    Args:
        time_offset: how much later than stamped the frames were taken [s].
        view: file id of the camera; None: all cameras.
    """

    parameters = named(Parameter("time_offset", "s", Identity(), (-0.5, 0.5), "time offset", scale=0.004))
    signature = "one view runs ahead or behind: its error follows the speed of the body and changes sign at the rebound"
    confused_with = ("CameraShift", "CameraDrift")
    separating_experiment = "a flash of light that all cameras see"
    probes = ({"time_offset": 0.004}, {"time_offset": -0.02})

    def time(self, t: Tensor, c: SimpleNamespace) -> Tensor:
        return t + c.time_offset.to(t)
