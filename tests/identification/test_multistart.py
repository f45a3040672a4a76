"""The valleys of a misfit beside the one that a local fit ended in."""

from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import Fit, fit
from pacnerf_lpo.identification.multistart import (
    best_beside,
    best_fits,
    best_fitted,
    grown,
    horizons,
    rivals,
    shortlist,
)
from pacnerf_lpo.mpm.materials import NeoHookean

MATERIAL = NeoHookean()
UNKNOWNS = [MATERIAL.parameters[name] for name in ("E", "nu")]
MODEL = SimpleNamespace(
    unknowns=UNKNOWNS,
    names=("E", "nu"),
    start=np.array([5.05, 0.3]),
    physics=SimpleNamespace(halvings=0),
    scales=np.array([0.03, 0.03]),
    bounds=(np.array([3.0, -1.0]), np.array([7.0, 1.0])),
)
RIGHT, LATE = 5.0, 4.75
"""log10 E where the body rebounds with the video, and where it does so a frame late."""


def rebound(free: np.ndarray) -> np.ndarray:
    """Two valleys in log10 E: the phase of the rebound is seen modulo a frame, its height a little."""
    phase = 2 * np.pi * (free[0] - RIGHT) / (RIGHT - LATE)
    return np.array([np.sin(phase / 2), 0.2 * (free[0] - RIGHT), 0.1 * (free[1] - 0.3)])


def stopped_at(start: float) -> Fit:
    return fit(rebound, np.array([start, 0.3]), MODEL.scales, MODEL.bounds, iterations=20)


@pytest.mark.parametrize("start", [4.72, 5.22])
def test_the_next_valley_is_found_to_either_side(start):
    stuck = stopped_at(start)
    assert abs(stuck.free[0] - RIGHT) > 0.2
    found = best_beside(MODEL, ("E", "nu"), rebound, stuck, 10)
    assert found.free[0] == pytest.approx(RIGHT, abs=1e-3)
    assert found.misfit < 0.1 * stuck.misfit


def test_only_unknowns_of_the_material_that_have_a_logarithm_are_moved():
    begun = []

    def residual(free):
        begun.append(free.copy())
        return rebound(free)

    stuck = stopped_at(4.72)
    best_beside(MODEL, ("nu",), residual, stuck, 10)
    assert begun == []


def test_a_valley_farther_away_is_found_with_a_longer_reach():
    """Valleys of log10 E are 0.25 apart: half a decade leads over the one between."""
    stuck = stopped_at(RIGHT - 0.5)
    assert stuck.free[0] == pytest.approx(RIGHT - 0.5, abs=0.05)
    nearer = best_beside(MODEL, ("E",), rebound, stuck, 10)
    assert nearer.free[0] == pytest.approx(LATE, abs=0.05)
    assert best_beside(MODEL, ("E",), rebound, stuck, 10, reach=0.5).free[0] == pytest.approx(RIGHT, abs=1e-3)


def test_points_are_judged_by_where_they_lead():
    """A point at the bottom of the wrong valley is lower than the guess on the slope of the right one."""
    wrong = np.array([LATE + 0.001, 0.3])
    assert shortlist(MODEL, rebound, [MODEL.start, wrong], {"E": (4.0, 6.0)}, 2)[0][0] == wrong[0]
    assert best_fitted(MODEL, rebound, [wrong], 2)[0] == pytest.approx(RIGHT, abs=1e-3)
    assert best_fitted(MODEL, rebound, [np.array([RIGHT + 0.06, 0.3]), wrong], 2)[0] == pytest.approx(RIGHT, abs=1e-3)


def test_a_shortlist_has_one_point_of_each_neighbourhood_and_none_that_is_unstable():
    def residual(free):
        if free[0] > 6.5:
            raise SimulationError(0, 3, "unstable")
        return free[:1] - 4.0

    tried = [np.array([young, 0.3]) for young in (4.0, 4.3, 4.5, 5.2, 6.9)]
    found = shortlist(MODEL, residual, tried, {"E": (4.0, 6.0)}, 3)
    assert [point[0] for point in found] == [4.0, 4.5, 5.2]
    assert len(shortlist(MODEL, residual, tried, {"E": (4.0, 6.0)}, 2)) == 2
    assert len(best_fits(MODEL, residual, [tried[-1], tried[3]], 10)) == 1


def test_short_fits_are_ranked_by_where_they_end():
    fits = best_fits(MODEL, rebound, [np.array([LATE + 0.001, 0.3]), np.array([RIGHT + 0.06, 0.3])], 10)
    assert fits[0].free[0] == pytest.approx(RIGHT, abs=1e-3)
    assert [other.misfit for other in fits] == sorted(other.misfit for other in fits)


@pytest.mark.parametrize(
    ("contact", "frames", "expected"),
    [(6, 14, [8, 9, 10, 12, 14]), (7, 14, [9, 10, 11, 13, 14]), (12, 14, [14]), (14, 14, [14]), (3, 7, [5, 6, 7])],
)
def test_fits_that_grow_take_in_half_as_many_frames_again_each_time(contact, frames, expected):
    assert horizons(contact, frames) == expected


def oscillation(frames: int):
    """A spring seen in so many frames: the more of them, the more valleys has the misfit in log10 of its stiffness."""
    times = np.arange(1, frames + 1)
    return lambda free: np.cos(2 * 10 ** ((free[0] - RIGHT) / 2) * times) - np.cos(2 * times)


def test_a_fit_that_grows_with_the_frames_finds_the_valley_that_a_fit_of_all_of_them_misses():
    start, frames = np.array([RIGHT - 0.3, 0.3]), 12
    stuck = fit(oscillation(frames), start, MODEL.scales, MODEL.bounds, 20)
    assert abs(stuck.free[0] - RIGHT) > 0.05 and stuck.misfit > 1.0
    stages = [(MODEL, oscillation(until)) for until in horizons(0, frames)]
    found = grown(stages, [start], 5)
    assert found[0].free[0] == pytest.approx(RIGHT, abs=1e-3)
    assert found[0].misfit < 1e-4


def test_rivals_end_apart_and_are_not_much_worse_than_the_best():
    def residual(free):
        """Valleys of misfit 1, 1.5 and 9 at 4, 5 and 6; the slope is gentle, and steps short."""
        if abs(free[0] - 6.0) < 0.5:
            return np.array([3.0, free[0] - 6.0])
        if abs(free[0] - 5.0) < 0.5:
            return np.array([1.5**0.5, free[0] - 5.0])
        return np.array([1.0, free[0] - 4.0])

    starts = [np.array([young, 0.3]) for young in (6.01, 5.02, 4.03, 3.98, 99.0)]
    seen = []
    found = rivals(MODEL, residual, starts, 10, lambda items, count: seen.append(count) or items)
    assert [round(fit.free[0], 2) for fit in found] == [4.0, 5.0]
    assert seen == [5]


def test_no_rivals_where_no_start_is_stable():
    def residual(free):
        raise SimulationError(0, 3, "unstable")

    assert rivals(MODEL, residual, [MODEL.start], 3) == []
    assert grown([(MODEL, residual), (MODEL, residual)], [MODEL.start], 3) == []


def test_without_a_stable_start_the_guess_stays():
    def residual(free):
        raise SimulationError(0, 3, "unstable")

    assert best_fitted(MODEL, residual, [np.array([4.0, 0.3])], 2) is MODEL.start


def test_where_every_start_is_unstable_the_fit_stays():
    def residual(free):
        raise SimulationError(0, 3, "unstable")

    stuck = stopped_at(4.72)
    assert best_beside(MODEL, ("E",), residual, stuck, 10) is stuck
