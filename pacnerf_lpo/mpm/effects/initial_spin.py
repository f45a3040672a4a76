"""A body that already turns in the first frame."""

from types import SimpleNamespace

import torch
from torch import Tensor

from pacnerf_lpo.mpm.effects.base import Initial, InitialState, from_centre, one_at_a_time
from pacnerf_lpo.mpm.parameters import by_axis


class InitialSpin(InitialState):
    """v += omega x (X - X_c) with the centre of mass X_c, and the velocity gradient that belongs to it.

    Args:
        spin_x, spin_y, spin_z: omega [rad/s].
    """

    parameters = by_axis("spin", "rad/s", (-200.0, 200.0), "initial spin about")
    of_recording = True
    signature = "the body turns from frame 0 on"
    confused_with = ("GroundFriction", "DensityGradient")
    separating_experiment = "a longer flight before the contact"
    probes = one_at_a_time(spin_x=1.0, spin_y=1.0, spin_z=1.0)

    @staticmethod
    def apply(positions: Tensor, velocity: Tensor, mass: Tensor, stiffness: Tensor, c: SimpleNamespace) -> Initial:
        return velocity + from_centre(positions, mass) @ InitialSpin.velocity_gradient(c).T, mass, stiffness

    @staticmethod
    def velocity_gradient(c: SimpleNamespace) -> Tensor:
        spin = torch.stack((c.spin_x, c.spin_y, c.spin_z))
        return torch.linalg.cross(torch.eye(3).to(spin), spin.expand(3, 3))  # v = spin x r
