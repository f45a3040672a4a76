"""Simulations in several processes: the same numbers as one after the other."""

from __future__ import annotations

import os

import pytest

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.identification.processes import each, processes


def doubled(number: int) -> tuple[int, int]:
    return 2 * number, os.getpid()


@pytest.mark.slow
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
