"""How noisy the sensor is, measured in the residual."""

import numpy as np
import pytest

from pacnerf_lpo.inference.sensor import sensor_scale

VIEWS, FRAMES, KINDS = 5, 10, 10
SHAPE = VIEWS, FRAMES, KINDS
ROOT = 0.2 * np.broadcast_to(np.linalg.cholesky(0.9 + 0.1 * np.eye(KINDS)), (*SHAPE, KINDS))
"""Of ten kinds of which an edge moves all alike."""
CONTACT = np.arange(FRAMES)[:, None] >= 6


def white(factor: float, seed: int = 0) -> np.ndarray:
    return factor * np.einsum("vfkq,vfq->vfk", ROOT, np.random.default_rng(seed).standard_normal(SHAPE))


@pytest.fixture
def errors() -> np.ndarray:
    """Of the model in eight replicates: large after contact [(T, V, F, K)], with a bias."""
    random = np.random.default_rng(1)
    return 0.5 + np.where(CONTACT, 2.0, 0.01) * random.standard_normal((8, *SHAPE))


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
def test_the_factor_of_white_noise_is_found(errors, factor):
    found = [sensor_scale(errors.mean(0) + white(factor, seed), errors, ROOT) for seed in range(5)]
    assert np.median(found) == pytest.approx(factor, rel=0.15)


def test_what_changes_smoothly_and_what_a_contact_does_is_no_noise(errors):
    time = np.arange(FRAMES)[:, None] / FRAMES
    wrong = 3.0 * time + 2.0 * time**2 + np.where(CONTACT, 5.0 * np.random.default_rng(2).standard_normal(SHAPE), 0.0)
    assert sensor_scale(errors.mean(0) + white(0.5) + wrong, errors, ROOT) == pytest.approx(0.5, rel=0.3)


def test_unseen_entries_do_not_count(errors):
    residual = errors.mean(0) + white(0.5)
    residual[:2] = np.nan
    assert sensor_scale(residual, errors, ROOT) == pytest.approx(0.5, rel=0.3)


def test_where_the_model_errs_by_more_everywhere_the_presumed_noise_stays(errors):
    assert sensor_scale(white(0.3), 100 * (errors - errors.mean(0)), ROOT) == 1.0
