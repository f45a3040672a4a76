"""The noise model, by simulation in the linear world of toy.py."""

import numpy as np
import pytest

from pacnerf_lpo.inference.noise import NoiseModel
from tests.diagnosis import toy

LAYOUT, WORLD = toy.layout(), toy.World()
SENSOR = np.full(len(LAYOUT), toy.SENSOR)


def test_whitening_inverts_the_covariance():
    """W C W^T = I for the covariance that the fields of the model stand for, up to rounding of 192 terms."""
    noise = NoiseModel.from_twins(WORLD.draw(np.random.default_rng(7), 16), SENSOR, LAYOUT)
    size = len(LAYOUT)
    whitener = noise.whiten(np.eye(size))
    lower = np.linalg.inv(noise.series.multiply(noise.whitener, np.eye(size)))
    inner = np.eye(size) + (noise.basis * noise.weights**2) @ noise.basis.T
    covariance = (1 + 1 / 16) * lower @ inner @ lower.T
    np.testing.assert_allclose(whitener @ covariance @ whitener.T, np.eye(size), atol=1e-9)
    assert (np.sqrt(np.diag(covariance)) >= toy.SENSOR).all()


def test_entries_in_any_order_and_gaps_in_the_frames_are_the_same_problem():
    noise = NoiseModel.from_twins(WORLD.draw(np.random.default_rng(7), 16), SENSOR, LAYOUT)
    rng = np.random.default_rng(2)
    kept = rng.permutation(len(LAYOUT))[:150]
    again = NoiseModel.from_twins(noise.twins[:, kept], SENSOR[kept], LAYOUT.where(kept))
    order = np.argsort(kept)
    sorted_ = NoiseModel.from_twins(noise.twins[:, kept[order]], SENSOR[order], LAYOUT.where(kept[order]))
    null = WORLD.draw(rng, 1)[0][kept]
    assert np.linalg.norm(again.whiten_residual(null)) == pytest.approx(
        np.linalg.norm(sorted_.whiten_residual(null[order])), rel=1e-9
    )


@pytest.mark.parametrize(
    ("twins", "sigma", "words"),
    [
        (np.zeros((3, 192)), SENSOR, "at least 4"),
        (np.zeros((8, 192)), SENSOR[:-1], "sensor_sigma has shape"),
        (np.zeros((8, 192)), 0 * SENSOR, "positive"),
        (np.full((8, 192), np.nan), SENSOR, "finite"),
    ],
)
def test_unusable_twins_are_refused(twins, sigma, words):
    with pytest.raises(ValueError, match=words):
        NoiseModel.from_twins(twins, sigma, LAYOUT)


def test_twins_without_numerical_error_leave_the_sensor_noise():
    """Then ||W r||^2 is chi^2 with 192 degrees of freedom, but for the spread that was learnt from noise."""
    rng = np.random.default_rng(3)
    noise = NoiseModel.from_twins(toy.SENSOR * rng.standard_normal((16, 192)), SENSOR, LAYOUT)
    squares = [(noise.whiten_residual(toy.SENSOR * rng.standard_normal(192)) ** 2).sum() for _ in range(50)]
    assert 0.8 * 192 < np.mean(squares) < 1.05 * 192
