"""Residuals in which a fault of one camera shows."""

from __future__ import annotations

import numpy as np
import pytest

from pacnerf_lpo.identification.problem import relative


def test_a_constant_shift_of_one_camera_shows_in_every_frame():
    """Relative to frame 0 it shows there alone; beside it, what moves the same in all views stays as it is."""
    random = np.random.default_rng(0)
    moved = np.cumsum(random.standard_normal((1, 6, 11)), axis=1) * np.ones((4, 1, 1))
    moved -= moved[:, :1]
    shifted = moved.copy()
    shifted[2, :, 0] += 1.5
    seen = relative(shifted)
    assert seen[2, 1:, 0] == pytest.approx(moved[2, 1:, 0]) and seen[2, 0, 0] == pytest.approx(1.5)
