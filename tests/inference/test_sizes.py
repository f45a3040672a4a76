"""The size of errors of the shape, in the linear world of toy.py."""

import numpy as np
import pytest

from pacnerf_lpo.inference.sizes import size_of_errors
from tests.inference import toy

SIZES = (0.125, 0.25, 0.5, 1.0)
SPREADS = (3.0, 10.0)
WORLD = toy.World()
ERRORS = 2.0 * np.stack([toy.one_view(v, k, toy.CONTACT) for v in range(toy.VIEWS) for k in toy.KINDS], axis=1)
"""Of each view and kind after the contact: as errors of a shape, no motion in space explains them."""
MISSING = np.stack([toy.seen(along_y=toy.CONTACT), toy.seen(taller=toy.CONTACT)], axis=1)


def found(size: float, push: float = 0.0, counted: bool = True) -> float:
    """Geometric mean of the sizes found in 20 recordings."""
    rng, logs = np.random.default_rng(2), []
    for _ in range(20):
        noise = toy.learnt(rng, 16)
        residual = WORLD.draw(rng, 1)[0] + size * ERRORS @ rng.standard_normal(ERRORS.shape[1])
        residual = residual + MISSING @ np.full(2, push)
        missing = (MISSING, SPREADS) if counted else ()
        logs.append(np.log(size_of_errors(noise, residual, ERRORS, SIZES, *missing)))
    return float(np.exp(np.mean(logs)))


@pytest.mark.parametrize("size", [0.25, 0.5, 1.0])
def test_errors_are_as_large_as_a_recording_shows(size: float):
    assert found(size) == pytest.approx(size, rel=0.25)


def test_errors_that_a_recording_has_not_are_small():
    assert found(0.0) < 1.5 * SIZES[0]


def test_what_is_missing_in_the_model_is_no_error_of_the_shape():
    """Where it counts as one, they are three times as large as they are."""
    assert found(0.25, push=8.0) == pytest.approx(found(0.25), rel=0.2)
    assert found(0.25, push=8.0, counted=False) > 3 * 0.25


def test_a_recording_that_says_nothing_leaves_all_sizes_as_probable_as_before():
    noise = toy.learnt(np.random.default_rng(3), 12)
    usual = float(np.sqrt(np.mean(np.square(SIZES))))
    assert size_of_errors(noise, noise.mean, 1e-9 * ERRORS, SIZES) == pytest.approx(usual, rel=1e-6)
