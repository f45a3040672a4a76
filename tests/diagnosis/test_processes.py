"""Simulations in several processes: the same numbers as one after the other."""

from __future__ import annotations

import os

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import whole_catalogue
from pacnerf_lpo.diagnosis.comparison import compare
from pacnerf_lpo.diagnosis.processes import each, processes
from pacnerf_lpo.diagnosis.screening import screen
from pacnerf_lpo.errors import SimulationError, UserInputError
from tests.diagnosis.test_points import GUESS, Ball, points, tracked

FORCES = ("LinearDrag", "UniformForce", "GravityMagnitude")


def doubled(number: int) -> tuple[int, int]:
    return 2 * number, os.getpid()


def test_order_is_kept_and_other_processes_do_the_work():
    """Without a context everything happens here."""
    given = [(number,) for number in range(5)]
    assert list(each(doubled, given)) == [(2 * number, os.getpid()) for number in range(5)]
    with processes(2):
        found = list(each(doubled, given))
    assert [result for result, _ in found] == [0, 2, 4, 6, 8]
    assert os.getpid() not in {process for _, process in found}


def unstable(frame: int) -> SimulationError:
    return SimulationError(frame, 7, "NaN")


def test_what_went_wrong_is_told_across_processes():
    with processes(2):
        (found,) = each(unstable, [(3,)])
    assert (found.frame, found.substep, str(found)) == (3, 7, str(unstable(3)))


def test_fewer_than_one_is_refused():
    with pytest.raises(UserInputError, match="jobs = 0; give 1 or more"), processes(0):
        pass


def test_a_diagnosis_is_the_same(small_threads):
    """Fit, twins and scores of a ball whose tracks show drag."""
    problem = Ball(points(tracked(), None))
    screened = []
    for jobs in (1, 2):
        with processes(jobs):
            comparison = compare(problem, (), GUESS, 4, 1, lambda _: None)
            catalogue = whole_catalogue(problem.physics.material, problem.video.view_ids, ())
            candidates = [candidate for candidate in catalogue if candidate.name in FORCES]
            screened.append((comparison, screen(problem, comparison, candidates, lambda _: None)))
    (alone, ranking), (together, same) = screened
    np.testing.assert_allclose(together.free, alone.free, rtol=1e-5)
    np.testing.assert_allclose(together.twins, alone.twins, atol=1e-5)
    assert [score.name for score in same.scores] == [score.name for score in ranking.scores]
    np.testing.assert_allclose([s.z for s in same.scores], [s.z for s in ranking.scores], rtol=1e-3)
