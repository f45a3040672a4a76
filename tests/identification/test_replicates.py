"""How large an error of the reconstruction is taken to be."""

import numpy as np
import pytest

from pacnerf_lpo.identification.replicates import _typical_square

VIEWS, KINDS = 11, 10


def deviates(**wrong: float) -> np.ndarray:
    """Normal deviates [(V, K)], those of some views ``v3=5.0`` times as large."""
    values = np.random.default_rng(0).standard_normal((VIEWS, KINDS))
    for view, factor in wrong.items():
        values[int(view[1:])] *= factor
    return values


def test_of_normal_deviates_it_is_about_one():
    many = np.random.default_rng(0).standard_normal((50, VIEWS, KINDS))
    assert _typical_square(many) == pytest.approx(1.0, abs=0.1)


def test_a_camera_that_is_wrong_does_not_count():
    right, wrong = _typical_square(deviates()), _typical_square(deviates(v3=100.0))
    assert wrong < 1.5 * right


def test_a_shape_that_is_wrong_in_some_views_counts():
    assert _typical_square(deviates(v1=6.0, v3=6.0, v6=6.0, v7=6.0)) > 5


def test_views_that_see_nothing_do_not_count():
    values = deviates()
    values[4] = np.nan
    assert np.isfinite(_typical_square(values)).all()
