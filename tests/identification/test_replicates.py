"""How large an error of the reconstruction is taken to be."""

import numpy as np
import pytest

from pacnerf_lpo.identification.replicates import _typical_squares

VIEWS, KINDS = 11, 10


def deviates(**wrong: float) -> np.ndarray:
    """Normal deviates [(V, K)], those of some views ``v3=5.0`` times as large."""
    values = np.random.default_rng(0).standard_normal((VIEWS, KINDS))
    for view, factor in wrong.items():
        values[int(view[1:])] *= factor
    return values


def test_of_normal_deviates_either_estimate_is_about_one():
    many = np.random.default_rng(0).standard_normal((50, VIEWS, KINDS))
    assert _typical_squares(many) == pytest.approx([1.0, 1.0], abs=0.1)


def test_a_camera_that_is_wrong_does_not_count():
    right, wrong = _typical_squares(deviates()), _typical_squares(deviates(v3=100.0))
    assert (wrong < 1.5 * right).all()


def test_a_shape_that_is_wrong_in_some_views_counts_by_its_mean():
    median, mean = _typical_squares(deviates(v1=6.0, v3=6.0, v6=6.0, v7=6.0))
    assert mean > 5 and mean > 2 * median


def test_views_that_see_nothing_do_not_count():
    values = deviates()
    values[4] = np.nan
    assert np.isfinite(_typical_squares(values)).all()
