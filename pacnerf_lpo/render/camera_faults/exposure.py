"""A camera that is set brighter or darker than the others."""

from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.render.camera_faults.base import Observation


class Exposure(Observation):
    """The object's colour is multiplied by a gain; outlines stay where they are.

    Args:
        gain: 1 where the camera is like the others [1].
        view: file id of the camera; None: all cameras.
    """

    parameters = named(Parameter("gain", "1", Identity(), (0.0, 20.0), "gain", scale=0.05))
    null = {"gain": 1.0}  # noqa: RUF012
    signature = "one view is brighter or darker in proportion in every frame, while its silhouettes fit"
    confused_with = ()
    separating_experiment = "a grey card filmed by all cameras"
    probes = ({"gain": 1.05}, {"gain": 0.8})

    def colour(self, view: int, colour: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        return c.gain * colour
