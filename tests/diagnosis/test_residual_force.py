"""The smooth unknown force: its shape, and the ridge by which it is found."""

from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.residual_force import SmoothForce, ridge


def test_ridge_finds_what_is_there_and_little_where_there_is_noise_alone():
    random = np.random.default_rng(0)
    design = random.standard_normal((200, 30)) * np.logspace(0, -3, 30)
    true = np.zeros(30)
    true[:3] = (1.0, -2.0, 0.5)
    noise = 0.1 * random.standard_normal(200)
    # 30 coefficients from 200 values at 0.1: the strong ones are known to about 0.1 / sqrt(200)
    assert ridge(design, design @ true + noise)[:3] == pytest.approx(true[:3], abs=0.05)
    assert np.linalg.norm(design @ ridge(design, noise)) < np.linalg.norm(noise) * np.sqrt(2 * 30 / 200)


def test_a_smooth_force_is_the_interpolation_of_its_knots():
    effect = SmoothForce(duration=2.0, centre=(1.0, 0.0, 0.0), extent=2.0)
    values = {**effect.null, **effect.constants, "force_y_1_1": 4.0, "force_x_x_2": 6.0}
    point = SimpleNamespace(t=0.75, X=[2.0, 0.0, 0.0])  # half way between knots 1 (0.5 s) and 2 (1 s)
    found = effect.acceleration(point, SimpleNamespace(**values))
    assert found == pytest.approx([0.5 * 6.0 * 0.5, 0.5 * 4.0, 0.0])
