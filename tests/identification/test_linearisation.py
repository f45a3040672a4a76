"""Lines through a residual that is rough, bounded or unstable somewhere."""

from collections.abc import Callable

import numpy as np
import pytest

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import Effort, fit
from pacnerf_lpo.identification.linearisation import REACH, slopes_around

FREE = (np.full(2, -np.inf), np.full(2, np.inf))


def around(residual: Callable, middle: np.ndarray, *rest: np.ndarray | tuple) -> tuple[np.ndarray, int]:
    return slopes_around(residual, middle, residual(middle), *rest)


def test_a_straight_residual_is_its_own_line():
    slopes = np.array([[1.0, 2.0], [3.0, -1.0], [0.5, 0.0]])
    found, used = around(
        lambda x: slopes @ x + 7, np.array([2.0, -1.0]), 2 * slopes, np.full(2, 1e-3), np.ones(2), FREE
    )
    assert found == pytest.approx(slopes) and used == 4


def test_points_are_spread_along_the_axes_of_the_posterior_and_no_farther_than_allowed():
    """Data that determine the sum of two unknowns to 0.1, and their difference to 50."""
    slopes = np.array([[10.0, 10.0], [0.02, -0.02]]) / np.sqrt(2)
    asked: list[np.ndarray] = []

    def straight(x: np.ndarray) -> np.ndarray:
        asked.append(x)
        return slopes @ x

    around(straight, np.zeros(2), slopes, np.full(2, 1e-3), np.ones(2), FREE)
    turn = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2)
    assert np.abs(np.array(asked) @ turn).max(0) == pytest.approx([REACH * 0.1, 1.0])
    asked.clear()
    around(straight, np.zeros(2), slopes, np.full(2, 0.5), np.ones(2), FREE)  # nearer, nothing would be noticed
    assert np.abs(np.array(asked) @ turn).max(0) == pytest.approx([0.5 * np.sqrt(2), 1.0])


def test_roughness_is_not_taken_for_information():
    """Noise of 0.02 at every point, other noise next to it, on data that determine an unknown to 0.14."""
    noise = np.random.default_rng(0)

    def rough(x: np.ndarray) -> np.ndarray:
        return np.full(50, x[0]) + 0.02 * noise.standard_normal(50)

    bounds = np.full(1, -np.inf), np.full(1, np.inf)
    slopes, _ = around(rough, np.zeros(1), np.ones((50, 1)), np.full(1, 1e-3), np.ones(1), bounds)
    assert np.std(slopes) < 0.1 and slopes.mean() == pytest.approx(1.0, abs=0.02)


def ball_that_turns(seed: int) -> Callable[[np.ndarray], np.ndarray]:
    """Of its spin [rad/s] to 545 outlines in units of their noise, which know it to 0.17 rad/s, and change with its
    particles by a square of 20 within some tenths of that.
    """
    random = np.random.default_rng(seed)
    signal, noise = random.standard_normal((2, 545))
    signal *= np.sqrt(35) / np.linalg.norm(signal)
    phases, pace = random.uniform(0, 2 * np.pi, 545), random.standard_normal(545) / 0.15
    return lambda spin: signal * spin[0] + np.sqrt(20 / 545) * np.sin(pace * spin[0] + phases) + noise


def test_particles_at_other_places_are_not_taken_for_information():
    """Short differences know the spin to 0.05 rad/s."""
    bounds, effort = (np.full(1, -50.0), np.full(1, 50.0)), Effort(24, widest=np.full(1, 10.0))
    found = [fit(ball_that_turns(seed), np.ones(1), np.full(1, 0.1), bounds, effort) for seed in range(10)]
    errors = np.array([1 / np.linalg.norm(one.jacobian) for one in found if one.jacobian is not None])
    assert len(errors) == 10 and errors.min() > 0.12 and errors.max() < 0.2
    assert np.mean((np.array([one.free[0] for one in found]) / errors) ** 2) < 4


def test_points_stay_within_bounds_and_where_the_motion_is_stable():
    asked: list[float] = []

    def curved(x: np.ndarray) -> np.ndarray:
        asked.append(float(x[0]))
        if x[0] > 1.5:
            raise SimulationError(3, 7, "too fast")
        return np.array([x[0] ** 2])

    bounds = np.array([0.0]), np.array([9.0])
    slope, used = around(curved, np.array([1.0]), np.array([[0.1]]), np.ones(1), np.array([2.0]), bounds)
    assert slope[0, 0] == pytest.approx(1.3)  # through (1, 1), near (0, 0) and (1.5, 2.25)
    assert min(asked) == 0.0 and used == 4


def test_where_the_motion_is_unstable_all_around_there_is_no_slope():
    def alone(x: np.ndarray) -> np.ndarray:
        if x[0] != 1.0:
            raise SimulationError(3, 7, "too fast")
        return np.array([5.0])

    bounds = np.array([0.0]), np.array([9.0])
    slope, _ = around(alone, np.ones(1), np.ones((1, 1)), np.full(1, 0.1), np.ones(1), bounds)
    assert slope[0, 0] == 0.0
