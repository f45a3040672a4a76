"""The effects that only the generator knows do what they say."""

from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import known_classes
from validation.hidden_effects.outside import GUST_TIME, GUST_WIDTH, Belt, Fibres, Gust, Vortex

IDENTITY = np.eye(3).tolist()


def test_the_gust_is_a_bell_in_time_along_x():
    def push(t: float) -> list[float]:
        return Gust.acceleration(SimpleNamespace(t=t), SimpleNamespace(gust=3.0))

    assert push(GUST_TIME) == [3.0, 0.0, 0.0]
    assert push(GUST_TIME + GUST_WIDTH)[0] == pytest.approx(3.0 / np.e)


def test_the_vortex_does_no_work_on_a_circle_and_turns_it():
    position = np.array([0.3, 0.7, -0.4])
    a = np.array(Vortex.acceleration(SimpleNamespace(x=position.tolist()), SimpleNamespace(vortex=2.0)))
    assert a @ (position * [1, 0, 1]) == pytest.approx(0.0)
    assert np.linalg.norm(a) == pytest.approx(2.0 * 0.5)  # the point is 0.5 m from the axis


def test_the_belt_carries_what_touches_it():
    assert Belt.velocity([4.0, -2.0, 1.0], SimpleNamespace(belt=0.5)) == [0.5, 0.0, 0.0]


def test_fibres_have_the_stress_of_their_energy():
    """tau = (dW/dF) F^T with W = k/4 (|F e_x|^2 - 1)^2, by central differences: their error is about 1e-9 relative."""
    F = np.array([[1.1, 0.2, 0.0], [0.1, 0.9, -0.1], [-0.2, 0.0, 1.05]])
    k, step = 3e4, 1e-5

    def energy(at: np.ndarray) -> float:
        return k / 4 * (at[:, 0] @ at[:, 0] - 1) ** 2

    gradient = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            change = np.zeros((3, 3))
            change[i, j] = step
            gradient[i, j] = (energy(F + change) - energy(F - change)) / (2 * step)
    zero = np.zeros((3, 3)).tolist()
    point = SimpleNamespace(F=F.tolist(), stiffness=1.0)
    _, tau = Fibres.law(lambda point, c: (point.F, zero), point, SimpleNamespace(fibres=k))
    assert np.allclose(tau, gradient @ F.T, rtol=1e-6, atol=1e-4)
    at_rest = SimpleNamespace(F=IDENTITY, stiffness=1.0)
    assert np.allclose(Fibres.law(lambda point, c: (point.F, zero), at_rest, SimpleNamespace(fibres=k))[1], 0.0)


def test_the_catalogue_knows_none_of_them():
    assert not {"Gust", "Vortex", "Belt", "Fibres"} & {kind.__name__ for kind in known_classes()}
