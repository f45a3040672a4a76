"""The smooth unknown force."""

from types import SimpleNamespace

import pytest

from pacnerf_lpo.identification.smooth_force import KNOTS, SmoothForce, contact_accelerations
from tests.diagnosis.test_points import GUESS, Ball, points, tracked


def test_a_smooth_force_is_the_interpolation_of_its_knots():
    effect = SmoothForce(duration=2.0, centre=(1.0, 0.0, 0.0), extent=2.0)
    values = {**effect.null, **effect.constants, "force_y_1_1": 4.0, "force_x_x_2": 6.0}
    point = SimpleNamespace(t=0.75, X=[2.0, 0.0, 0.0])  # half way between knots 1 (0.5 s) and 2 (1 s)
    found = effect.acceleration(point, SimpleNamespace(**values))
    assert found == pytest.approx([0.5 * 6.0 * 0.5, 0.5 * 4.0, 0.0])


def test_only_contact_accelerates_by_more_than_gravity(small_threads: None):
    """A ball in flight, and the same thrown down from 2 m with 6 m/s, which touches in frame 7 of 10."""
    problem = Ball(points(tracked(), None))
    assert not contact_accelerations(problem, (), GUESS).any()
    found = contact_accelerations(problem, (), {**GUESS, "v_x": 0.0, "v_y": -6.0}).reshape(KNOTS, -1)
    assert (found == found[:, :1]).all() and found.shape[1] == 12
    assert not found[:2].any()  # up to half of the way
    change = 6.0 + 9.8 * 7 / 24  # m/s, reversed in part within two frames
    assert found[3, 0] > change / (2 / 24) / 2 and found[3, 0] > 2 * found[4, 0]
