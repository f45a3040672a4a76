"""Bodies that are stiffer on one side."""

from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.effects.base import Initial, InitialState, linear_factor, one_at_a_time
from pacnerf_lpo.mpm.parameters import by_axis


class StiffnessGradient(InitialState):
    """All moduli of a particle times max(1 + k . (X - X_c), 0.05), with the centre of mass X_c at frame 0.

    Args:
        stiffness_gradient_x, stiffness_gradient_y, stiffness_gradient_z: k [1/m].
    """

    parameters = by_axis("stiffness_gradient", "1/m", (-100.0, 100.0), "stiffness gradient along", scale=0.5)
    signature = "one side gives way more than the other, and the body tips over on rebound"
    confused_with = ("DensityGradient", "InitialSpin")
    separating_experiment = "the same body dropped upside down"
    probes = one_at_a_time(**dict.fromkeys(parameters, 2.0))

    @staticmethod
    def apply(positions: Tensor, velocity: Tensor, mass: Tensor, stiffness: Tensor, c: SimpleNamespace) -> Initial:
        return velocity, mass, linear_factor(positions, mass, c, "stiffness_gradient") * stiffness
