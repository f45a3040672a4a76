"""The side force on a body that spins as it flies through a fluid."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.tensors import AXES

SPIN = tuple(f"magnus_spin_{axis}" for axis in "xyz")


class Magnus(BodyForce):
    """Acceleration S omega x v with the spin omega (Robins 1742, Magnus 1852).

    On a sphere in slow viscous flow the force is pi r^3 rho_fluid omega x v (Rubinow and Keller, The transverse force
    on a spinning sphere moving in a viscous fluid, J. Fluid Mech. 11, 1961), so that S = 3 rho_fluid / (4 rho_body); on
    a long cylinder S = 2 rho_fluid / rho_body (Kutta and Joukowski). Faster flows have a smaller one: 0.0025 instead of
    0.011 for a table tennis ball. That of smooth balls is negative at some speeds (the inverse Magnus effect).

    omega is how the body turns at a particle, half the curl of the velocity; or a spin that was measured, constant in
    time, as that of a rigid ball is from one contact to the next. Nothing slows the spin down.

    Args:
        magnus: S [1].
        spin: omega that was measured [rad/s], in the axes of the scene; None: that of each particle.

    Raises:
        UserInputError: a spin that is not three finite numbers.
    """

    # bounds: of a cylinder as light as the fluid
    parameters = named(Parameter("magnus", "1", Identity(), (-2.0, 2.0), "Magnus coefficient", scale=0.002))
    constants_of_recording = True
    of_medium = True
    signature = "the path of a spinning body curves at a right angle to its velocity and to its spin"
    confused_with = ("UniformForce", "GravityMagnitude")
    separating_experiment = "a throw with the opposite spin, which turns this force round, and no wind or gravity"
    probes = ({"magnus": 0.002}, {"magnus": 0.02})  # of a table tennis ball; of a light foam in air

    def __init__(self, magnus: float = 0.0, spin: tuple[float, float, float] | None = None):
        if spin is not None and not (len(spin) == len(SPIN) and all(map(math.isfinite, spin))):
            raise UserInputError(
                f"Magnus: spin {spin}; give three finite numbers in rad/s, or none for the spin of each particle"
            )
        self.spin = None if spin is None else tuple(spin)
        given = dict(zip(SPIN, self.spin or (0.0, 0.0, 0.0), strict=True))
        super().__init__({"magnus": magnus}, {**given, "magnus_of_particle": float(spin is None)})

    def at(self, spin: Sequence[float]) -> "Magnus":
        """The same with another spin [rad/s, (3,)]."""
        return Magnus(self.guess["magnus"], (spin[0], spin[1], spin[2]))

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        given = (c.magnus_spin_x, c.magnus_spin_y, c.magnus_spin_z)
        C = point.C
        half_curl = [0.5 * (C[(i + 2) % 3][(i + 1) % 3] - C[(i + 1) % 3][(i + 2) % 3]) for i in AXES]
        omega = [g + c.magnus_of_particle * own for g, own in zip(given, half_curl, strict=True)]
        across = [omega[(i + 1) % 3] * point.v[(i + 2) % 3] - omega[(i + 2) % 3] * point.v[(i + 1) % 3] for i in AXES]
        return [c.magnus * side for side in across]
