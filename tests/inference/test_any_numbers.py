"""What must hold of intervals and correlations, whatever the numbers are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacnerf_lpo.inference.classes import correlation
from pacnerf_lpo.inference.intervals import posterior_intervals

LEVEL, DOF = 0.9, 11.0
SHAPES = st.tuples(st.integers(1, 12), st.integers(1, 4), st.integers(0, 2**32))


def drawn(rows: int, columns: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian over twelve decades, estimates and prior deviations."""
    dice = np.random.default_rng(seed)
    jacobian = dice.standard_normal((rows, columns)) * 10 ** dice.uniform(-6, 6, columns)
    return jacobian, dice.standard_normal(columns), 10 ** dice.uniform(-3, 3, columns)


@given(SHAPES)
def test_data_narrow_the_prior_and_more_data_narrow_it_further(shape: tuple[int, int, int]):
    """Posterior precision is that of the prior and of the data; rounding of the SVD is 1e-9 of its largest number."""
    jacobian, values, deviations = drawn(*shape)
    names = [f"p{k}" for k in range(len(values))]
    found, _ = posterior_intervals(jacobian, 1.0, values, names, deviations, LEVEL, DOF)
    twice, _ = posterior_intervals(np.vstack([jacobian, jacobian]), 1.0, values, names, deviations, LEVEL, DOF)
    for interval, narrower, value, deviation in zip(found, twice, values, deviations, strict=True):
        assert interval.low <= value <= interval.high
        assert interval.error <= deviation * (1 + 1e-9)
        assert narrower.error <= interval.error * (1 + 1e-6)


@given(SHAPES, st.floats(1e-3, 1e3))
def test_intervals_have_the_unit_of_their_parameter(shape: tuple[int, int, int], factor: float):
    """The Jacobian counts prior deviations, so in another unit everything is multiplied."""
    jacobian, values, deviations = drawn(*shape)
    names = [f"p{k}" for k in range(len(values))]
    found, said = posterior_intervals(jacobian, 1.0, values, names, deviations, LEVEL, DOF)
    other, same = posterior_intervals(jacobian, 1.0, factor * values, names, factor * deviations, LEVEL, DOF)
    assert said == same
    for interval, scaled in zip(found, other, strict=True):
        assert scaled.error == pytest.approx(factor * interval.error, rel=1e-9)
        assert (scaled.low, scaled.high) == pytest.approx((factor * interval.low, factor * interval.high))


@given(SHAPES)
def test_correlations_are_cosines(shape: tuple[int, int, int]):
    signatures = drawn(*shape)[0]
    found = correlation(signatures)
    assert (found >= 0).all() and (found <= 1).all()
    np.testing.assert_allclose(found, found.T, atol=1e-12)
    np.testing.assert_allclose(np.diag(found), 1.0, atol=1e-12)
    np.testing.assert_allclose(correlation(-3.0 * signatures), found, atol=1e-12)
