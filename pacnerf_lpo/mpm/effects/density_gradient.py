"""Bodies that are heavier on one side."""

from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.effects.base import Initial, InitialState, linear_factor, one_at_a_time
from pacnerf_lpo.mpm.parameters import by_axis


class DensityGradient(InitialState):
    """The mass of a particle times max(1 + k . (X - X_c), 0.05), with the centre of mass X_c at frame 0. Unless the
    bound is met the mass of the body stays, and its centre moves.

    Args:
        density_gradient_x, density_gradient_y, density_gradient_z: k [1/m].
    """

    parameters = by_axis("density_gradient", "1/m", (-100.0, 100.0), "density gradient along", scale=0.5)
    signature = "the body tips over on contact, towards its heavy side"
    confused_with = ("StiffnessGradient", "InitialSpin")
    separating_experiment = "the body balanced on an edge, which shows its centre of mass"
    probes = one_at_a_time(**dict.fromkeys(parameters, 2.0))

    @staticmethod
    def apply(positions: Tensor, velocity: Tensor, mass: Tensor, stiffness: Tensor, c: SimpleNamespace) -> Initial:
        return velocity, linear_factor(positions, mass, c, "density_gradient") * mass, stiffness
