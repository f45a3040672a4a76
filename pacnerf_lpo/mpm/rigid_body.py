"""The flight of a rigid body: the body forces that act on particles of a grid, evaluated at its centre.

The centre of mass moves by x'' = g + sum a_e(x, v, omega, t) with the accelerations a_e of the effects. That is
integrated by the Runge-Kutta method of order 8 (Dormand and Prince 1980; Hairer, Norsett and Wanner 1993) with a
controlled error. The spin omega is constant, as that of a ball without a torque is.
"""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.point import Point

RELATIVE_ERROR, ABSOLUTE_ERROR = 1e-7, 1e-7
"""Of a step; the second in m and m/s: a thousandth of what motion capture resolves."""
FASTEST = 1e4
"""[m/s] A body that is faster has left what its model is good for."""
IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


def fly(
    effects: Sequence[BodyForce],
    values: Mapping[str, float],
    gravity: Sequence[float],
    start: tuple[np.ndarray, np.ndarray],
    spin: Sequence[float],
    times: np.ndarray,
) -> np.ndarray:
    """Positions of the centre at some times [m, (F, 3)]. Raises SimulationError where the motion runs away.

    Args:
        effects: that accelerate the body besides gravity.
        values: of their coefficients [SI].
        gravity: [m/s^2, (3,)]
        start: position [m, (3,)] and velocity [m/s, (3,)] at the first time.
        spin: angular velocity of the body [rad/s, (3,)]
        times: since frame 0, increasing [s, (F,)]
    """
    constants = {name: value for effect in effects for name, value in effect.constants.items()}
    c = SimpleNamespace(**constants, **{name: values[name] for effect in effects for name in effect.parameters})
    origin, turning = start[0].tolist(), np.cross(np.eye(3), spin).tolist()  # v = omega x r

    def motion(t: float, state: np.ndarray) -> list[float]:
        numbers = state.tolist()
        x, v = numbers[:3], numbers[3:]
        if not max(map(abs, v)) < FASTEST:  # which NaN is not, either
            raise SimulationError(0, 0, "the flight runs away: an acceleration grows without bounds")
        point = Point(IDENTITY, turning, x, origin, v, float(t), 0.0, 1.0, 1.0, 1.0)
        pushes = [effect.acceleration(point, c) for effect in effects]
        return [*v, *(g + sum(push[axis] for push in pushes) for axis, g in enumerate(gravity))]

    with np.errstate(over="ignore", invalid="ignore"):
        ends, begun = times[[0, -1]], np.concatenate(start)
        found = solve_ivp(motion, ends, begun, "DOP853", times, rtol=RELATIVE_ERROR, atol=ABSOLUTE_ERROR)
    if found.status != 0 or not np.isfinite(found.y).all():
        raise SimulationError(found.y.shape[1], 0, "the flight runs away: its path cannot be integrated")
    return found.y[:3].T
