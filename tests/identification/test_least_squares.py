"""The damped Gauss-Newton fit on problems with known minima."""

import numpy as np
import pytest

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import Effort, Fit, fit, sensitivities

FREE = (np.full(2, -np.inf), np.full(2, np.inf))


def curved(p):
    """Rosenbrock's valley as residuals; minimum 0 at (1, 1)."""
    return np.array([10 * (p[1] - p[0] ** 2), 1 - p[0]])


def test_it_follows_a_curved_valley():
    found = fit(curved, np.array([-0.5, 1.0]), np.array([0.01, 0.01]), FREE, Effort(80))
    assert found.free == pytest.approx([1.0, 1.0], abs=0.02)
    assert found.cost < 1e-3


def test_it_stays_within_the_bounds():
    found = fit(
        lambda p: p - 3.0,
        np.array([0.0, 0.0]),
        np.array([0.5, 0.5]),
        (np.array([-1.0, -1.0]), np.array([1.0, 5.0])),
        Effort(20),
    )
    assert found.free == pytest.approx([1.0, 3.0], abs=1e-3)


def test_an_unstable_region_is_avoided():
    def residual(p):
        if p[0] > 2.0:
            raise SimulationError(3, 7, "too fast")
        return p - np.array([1.9, 0.0])

    found = fit(residual, np.array([-3.0, 1.0]), np.array([1.0, 1.0]), FREE, Effort(20))
    assert found.free == pytest.approx([1.9, 0.0], abs=1e-3)


def test_sensitivities_look_to_the_other_side_of_a_bound():
    bounds = (np.array([-5.0, -5.0]), np.array([1.0, 5.0]))
    at = np.array([1.0, 0.0])
    found = sensitivities(lambda p: np.array([2 * p[0], 3 * p[1]]), at, np.array([2.0, 0.0]), np.ones(2), bounds)
    assert found == pytest.approx(np.diag([2.0, 3.0]))


def test_a_fit_ends_with_lines_that_are_as_long_as_the_unknowns_are_known():
    """Whether its start has sensitivities or not, and is the minimum or not. Data of errors 1 that determine two
    unknowns to 0.1 and to 0.03, and are rough along a way that is short beside that.
    """
    directions = np.random.default_rng(0).standard_normal((100, 2)) * [1.0, 3.0]

    def rough(x: np.ndarray) -> np.ndarray:
        noise = 0.02 * np.sin(400 * directions @ x + np.arange(100))
        return directions @ (x - 0.5) + noise

    scales = np.full(2, 0.002)
    at_once = Fit(
        np.full(2, 0.5),
        rough(np.full(2, 0.5)),
        sensitivities(rough, np.full(2, 0.5), rough(np.full(2, 0.5)), scales, FREE),
        1,
        rough,
    )
    for start in (np.zeros(2), at_once):
        narrow, wide = (fit(rough, start, scales, FREE, Effort(20, widest=widest)) for widest in (None, np.ones(2)))
        assert narrow.jacobian is not None and wide.jacobian is not None
        assert np.std(narrow.jacobian - directions) > 1.0 and np.std(wide.jacobian - directions) < 0.3
        assert wide.free == pytest.approx([0.5, 0.5], abs=0.02)
    short = fit(rough, np.zeros(2), scales, FREE, Effort(20, widest=np.full(2, 0.01)))
    assert short.jacobian is not None and np.std(short.jacobian - directions) > 0.5


def test_lines_lead_out_of_dents_in_which_a_descent_ends():
    """A cost with a dent every 0.3 of a standard deviation, deep enough to end a descent far from its minimum."""

    def dented(x: np.ndarray) -> np.ndarray:
        return np.concatenate((10 * (x - 0.5), 0.5 * np.sin(200 * x + np.arange(4))))

    scales = np.full(1, 1e-3)
    descended, ended = (
        fit(dented, np.full(1, 0.0), scales, (-np.ones(1), np.ones(1)), Effort(20, widest=widest))
        for widest in (None, np.ones(1))
    )
    assert abs(descended.free[0] - 0.5) > 0.2 and abs(ended.free[0] - 0.5) < 0.05


def test_a_minimum_that_is_far_away_is_reached_by_longer_and_longer_steps():
    found = fit(lambda p: p - np.array([700.0, 0.2]), np.zeros(2), np.ones(2), FREE, Effort(10))
    assert found.free == pytest.approx([700.0, 0.2], abs=1.0)


def test_a_hopeless_start_is_given_up():
    calls = []

    def residual(p):
        calls.append(1)
        return np.array([p[0] * 0.1 + 100.0, p[1]])

    fit(residual, np.zeros(2), np.ones(2), FREE, Effort(50, 1.0))
    assert len(calls) < 50


def test_a_fit_whose_steps_keep_their_promise_and_could_be_longer_is_not_given_up():
    found = fit(lambda p: p - np.array([700.0, 0.2]), np.zeros(2), np.ones(2), FREE, Effort(10, 1.0))
    assert found.free == pytest.approx([700.0, 0.2], abs=1.0)


def test_an_unknown_at_its_bound_does_not_hold_up_the_others():
    """Two unknowns that do nearly the same: unless the one at its bound is left out, the step of the other is wrong."""
    matrix = np.array([[1.0, 0.99], [0.0, 0.1], [1.0, 1.0]])
    target = matrix @ np.array([-1.0, 3.0])
    bounds = (np.array([0.0, -10.0]), np.array([5.0, 10.0]))
    found = fit(lambda p: matrix @ p - target, np.array([0.0, 0.0]), np.ones(2), bounds, Effort(10))
    best = np.linalg.lstsq(matrix[:, 1:], target, rcond=None)[0]
    assert found.free == pytest.approx([0.0, float(best[0])], abs=0.02)  # it ends when little is left to gain
