"""A lens that bends straight lines."""

from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.render.camera_faults.base import Observation


class RadialDistortion(Observation):
    """Image coordinates are stretched by 1 + k1 r^2, r the distance from the principal point (Brown 1966, first term).

    Positive k1 is a pincushion, negative a barrel. The image folds where r^2 = -1 / (3 k1).

    Args:
        k1: in coordinates x / z [1].
        view: file id of the camera; None: all cameras.
    """

    parameters = named(Parameter("k1", "1", Identity(), (-0.5, 2.0), "radial distortion", scale=0.05))
    signature = "the error points away from the image centre or towards it, and grows with the cube of the distance"
    confused_with = ("CameraShift",)
    separating_experiment = "a checkerboard that fills the image"
    probes = ({"k1": 0.05}, {"k1": -0.2})

    def image_plane(self, view: int, uv: Tensor, c: SimpleNamespace) -> Tensor:
        return uv * (1 + c.k1.to(uv) * uv.square().sum(-1, keepdim=True))
