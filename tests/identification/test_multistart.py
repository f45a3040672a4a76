"""A search with stages finds the right one of many local minima, and passes over what is unstable."""

import numpy as np
import pytest

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import Effort, Fit, fit
from pacnerf_lpo.identification.multistart import Stage, horizons, multistart

SCALES = np.array([0.03, 0.03])
BOUNDS = np.array([3.0, -1.0]), np.array([7.0, 1.0])
RIGHT, LATE = 5.0, 4.75
"""log10 E where the body rebounds with the video, and where it does so a frame late."""


def rebound(free):
    """Minima in log10 E: the phase of the rebound is seen modulo a frame, its height a little."""
    phase = 2 * np.pi * (free[0] - RIGHT) / (RIGHT - LATE)
    return np.array([np.sin(phase / 2), 0.2 * (free[0] - RIGHT), 0.1 * (free[1] - 0.3)])


def oscillation(free):
    """A spring seen in twelve frames: the more of them, the more minima has the cost in log10 of its stiffness."""
    times = np.arange(1, 13)
    return np.cos(2 * 10 ** ((free[0] - RIGHT) / 2) * times) - np.cos(2 * times)


def unstable(free):
    raise SimulationError(0, 3, "unstable")


def stiff_is_unstable(free):
    if free[0] > 6.5:
        raise SimulationError(0, 3, "unstable")
    return free[:1] - 4.0


def at(*moduli):
    return [np.array([modulus, 0.3]) for modulus in moduli]


@pytest.mark.parametrize(
    ("contact", "frames", "expected"), [(6, 14, [4, 8, 10, 14]), (12, 14, [7, 14]), (14, 14, [14]), (1, 7, [3, 5, 7])]
)
def test_the_frames_after_contact_double(contact, frames, expected):
    assert horizons(contact, frames) == expected


def test_a_fit_that_takes_in_more_and_more_frames_finds_the_minimum_that_a_fit_of_all_of_them_misses():
    start = np.array([RIGHT - 0.3, 0.3])
    stuck = fit(oscillation, start, SCALES, BOUNDS, Effort(20))
    assert abs(stuck.free[0] - RIGHT) > 0.05 and stuck.cost > 1.0
    rows = [np.arange(12) < until for until in horizons(0, 12)]
    found = multistart([Stage(oscillation, SCALES, BOUNDS, rows, iterations=8, confirm=True)], [start])
    assert found.fits[0].free[0] == pytest.approx(RIGHT, abs=1e-3)
    assert found.fits[0].cost < 1e-4


@pytest.mark.parametrize("start", [4.72, 5.22])
def test_a_neighbouring_minimum_is_found_to_either_side(start):
    stage = Stage(rebound, SCALES, BOUNDS, iterations=15, confirm=True)
    stuck = multistart([stage], at(start)).fits[0]
    assert abs(stuck.free[0] - RIGHT) > 0.2
    beside = Stage(rebound, SCALES, BOUNDS, iterations=15, spans={0: (3.0, 7.0)}, offsets=(-0.2, 0.2), confirm=True)
    found = multistart([beside], [stuck]).fits[0]
    assert found.free[0] == pytest.approx(RIGHT, abs=1e-3)
    assert found.cost < 0.1 * stuck.cost


def test_a_sample_of_the_whole_span_finds_the_lowest_of_many_minima():
    spans = {0: (4.0, 6.0)}
    stages = [
        Stage(rebound, SCALES, BOUNDS, keep=6, spans=spans, samples=32, apart=np.array([0.1, np.inf])),
        Stage(rebound, SCALES, BOUNDS, iterations=10, confirm=True),
    ]
    assert multistart(stages, at(4.1)).fits[0].free[0] == pytest.approx(RIGHT, abs=1e-3)


def test_points_that_are_kept_lie_apart_and_none_is_unstable():
    stage = Stage(stiff_is_unstable, SCALES, BOUNDS, keep=3, apart=np.array([0.4, np.inf]))
    found = multistart([stage], at(4.0, 4.3, 4.5, 5.2, 6.9))
    assert [other.free[0] for other in found.fits] == [4.0, 4.5, 5.2]
    assert (found.rollouts, found.unstable) == (5, 1)


def test_points_are_ranked_by_each_set_of_rows():
    def two(free):
        return np.array([free[0] - 4.0, 2 * (free[0] - 6.0)])

    rows = (np.array([True, False]), None)
    found = multistart([Stage(two, SCALES, BOUNDS, rows)], at(4.0, 5.0, 5.6, 7.0))
    assert [other.free[0] for other in found.fits] == [4.0, 5.6]


def test_optima_that_are_kept_are_apart_and_not_much_worse_than_the_best():
    def residual(free):
        """Minima of 1, 1.5 and 9 at 4, 5 and 6; the slope is gentle, and steps short."""
        for modulus, cost in ((6.0, 9.0), (5.0, 1.5)):
            if abs(free[0] - modulus) < 0.5:
                return np.array([cost**0.5, free[0] - modulus])
        return np.array([1.0, free[0] - 4.0])

    stage = Stage(residual, SCALES, BOUNDS, keep=5, iterations=10, within=2.0)
    found = multistart([stage], at(6.01, 5.02, 4.03, 3.98))
    assert [round(other.free[0], 1) for other in found.fits] == [4.0, 5.0]


def test_what_a_stage_has_fitted_by_the_same_residual_is_not_fitted_again():
    calls = []

    def residual(free):
        calls.append(free)
        return free - np.array([4.0, 0.2])

    stage = Stage(residual, SCALES, BOUNDS, iterations=5)
    found = multistart([stage, stage], at(4.1))
    assert found.rollouts == len(calls) == multistart([stage], at(4.1)).rollouts


def test_the_jacobian_of_a_coarse_body_serves_on_a_fine_one():
    calls = []

    def fine(free):
        calls.append(free)
        return free - np.array([4.02, 0.2])

    coarse = Stage(lambda free: free - np.array([4.0, 0.2]), SCALES, BOUNDS, iterations=5)
    found = multistart([coarse, Stage(fine, SCALES, BOUNDS, iterations=5)], at(4.1))
    assert found.fits[0].free == pytest.approx([4.02, 0.2], abs=1e-3)
    assert len(calls) <= 3


def test_a_stage_in_which_nothing_is_stable_is_passed_over():
    good, bad = Stage(rebound, SCALES, BOUNDS, iterations=5), Stage(unstable, SCALES, BOUNDS, iterations=5)
    assert multistart([bad, bad], at(5.0)).fits == []
    found = multistart([bad, good, bad], at(5.05))
    assert found.fits[0].free[0] == pytest.approx(RIGHT, abs=0.02)
    assert found.unstable == 2


def test_watched_starts_are_counted():
    seen = []
    stage = Stage(rebound, SCALES, BOUNDS, iterations=2)
    multistart([stage], [Fit(np.array([5.0, 0.3]), rebound(at(5.0)[0])), *at(5.1)], lambda s, n: seen.append(n) or s)
    assert seen == [2]
