"""Effects that look alike."""

import numpy as np
import pytest

from pacnerf_lpo.inference.classes import correlation

ANGLES = np.deg2rad([0.0, 20.0, 40.0])
FAN = np.stack((np.cos(ANGLES), np.sin(ANGLES)), axis=1) * [[1], [-2], [3]]


def test_correlation_is_that_of_directions_whatever_sign_and_size():
    found = correlation(FAN)
    assert found[0, 1] == pytest.approx(np.cos(ANGLES[1])) and found[0, 2] == pytest.approx(np.cos(ANGLES[2]))
    assert np.diag(found) == pytest.approx(1.0) and (found <= 1.0).all()


def test_what_changes_nothing_resembles_nothing():
    assert correlation(np.array([[1.0, 0.0], [0.0, 0.0]])).tolist() == [[1.0, 0.0], [0.0, 0.0]]
