"""The smooth unknown force."""

from types import SimpleNamespace

import pytest

from pacnerf_lpo.identification.smooth_force import SmoothForce


def test_a_smooth_force_is_the_interpolation_of_its_knots():
    effect = SmoothForce(duration=2.0, centre=(1.0, 0.0, 0.0), extent=2.0)
    values = {**effect.null, **effect.constants, "force_y_1_1": 4.0, "force_x_x_2": 6.0}
    point = SimpleNamespace(t=0.75, X=[2.0, 0.0, 0.0])  # half way between knots 1 (0.5 s) and 2 (1 s)
    found = effect.acceleration(point, SimpleNamespace(**values))
    assert found == pytest.approx([0.5 * 6.0 * 0.5, 0.5 * 4.0, 0.0])
