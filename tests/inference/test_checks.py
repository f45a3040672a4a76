"""Whether a residual is what the model predicts, in fitted and in held-out entries."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from pacnerf_lpo.inference.checks import check_fitted, check_held_out, prediction
from pacnerf_lpo.inference.noise import NoiseModel
from tests.inference import toy

LAYOUT, WORLD = toy.layout(), toy.World()
SIZE = len(LAYOUT)
SENSOR = np.full(SIZE, toy.SENSOR)
FITTED = (LAYOUT.view < 3) & (LAYOUT.frame < 10)


def conditional_square(residual: np.ndarray, mean: np.ndarray, C: np.ndarray) -> float:
    """Square of the deviation of the held-out entries from their expectation given the fitted ones, in units of their
    conditional covariance.
    """
    gain = C[np.ix_(~FITTED, FITTED)] @ np.linalg.inv(C[np.ix_(FITTED, FITTED)])
    away = residual - mean
    left = away[~FITTED] - gain @ away[FITTED]
    return float(left @ np.linalg.solve(C[np.ix_(~FITTED, ~FITTED)] - gain @ C[np.ix_(FITTED, ~FITTED)], left))


def test_held_out_entries_are_judged_by_the_conditional_gaussian():
    """Replicates that vary by less than the sensor noise: the covariance is (1 + 1/T)(S^2 + B B^T), all and part."""
    rng = np.random.default_rng(0)
    drawn, B = 0.3 * toy.SENSOR * rng.standard_normal((8, SIZE)), 2 * toy.jacobian()
    whole = NoiseModel.from_replicates(drawn, SENSOR, LAYOUT, B)
    residual = rng.standard_normal(SIZE)
    check, size = check_held_out(whole, residual, FITTED), int((~FITTED).sum())
    C = np.diag(SENSOR**2) + B @ B.T
    assert check.statistic * size == pytest.approx(conditional_square(residual, drawn.mean(0), 9 / 8 * C), rel=1e-6)
    left_out = [
        conditional_square(drawn[k], np.delete(drawn, k, axis=0).mean(0), 8 / 7 * C) / size for k in range(len(drawn))
    ]
    assert check.replicates == pytest.approx(left_out, rel=1e-6)


def test_the_likelihood_of_a_part_and_of_what_it_predicts_are_that_of_all():
    """Replicates that vary by less than the sensor noise, so that both covariances are known: what is predicted of the
    held-out entries differs between two models by what a dense Gaussian says, its determinant included.
    """
    rng = np.random.default_rng(3)
    drawn, B = 0.3 * toy.SENSOR * rng.standard_normal((8, SIZE)), 2 * toy.jacobian()
    whole = NoiseModel.from_replicates(drawn, SENSOR, LAYOUT)

    def dense(residual: np.ndarray, changes: np.ndarray) -> float:
        C, log = 9 / 8 * (np.diag(SENSOR**2) + changes @ changes.T), []
        for rows in (np.ones(SIZE, bool), FITTED):
            away, block = (residual - drawn.mean(0))[rows], C[np.ix_(rows, rows)]
            log.append(-0.5 * float(away @ np.linalg.solve(block, away)) - 0.5 * np.linalg.slogdet(block)[1])
        return log[0] - log[1]

    def predicted(residual: np.ndarray, changes: np.ndarray) -> float:
        found = prediction(whole, residual, changes, FITTED)
        return found.occam - found.cost / 2

    models = [(rng.standard_normal(SIZE), B), (rng.standard_normal(SIZE), 0.1 * B[:, :2])]
    (first, second), (one, other) = ([way(*model) for model in models] for way in (predicted, dense))
    assert first - second == pytest.approx(one - other, rel=1e-3)


@pytest.mark.parametrize("held", [False, True])
def test_nulls_pass_and_large_errors_do_not(held: bool):
    """Of 60 nulls no more than chance (99.9 %) are below 0.05; three standard deviations of white noise always are."""
    rng, passed, refused = np.random.default_rng(1), [], []
    rough = 3 * toy.SENSOR * np.random.default_rng(2).standard_normal(SIZE)
    for _ in range(6):
        whole = toy.learnt(rng, 10)

        def p_value(residual: np.ndarray, whole=whole) -> float:
            found = check_held_out(whole, residual, FITTED) if held else check_fitted(whole, residual)
            return found.p_value

        passed += [p_value(null) for null in WORLD.draw(rng, 10)]
        refused.append(p_value(WORLD.draw(rng, 1)[0] + rough))
    assert sum(p < 0.05 for p in passed) <= binom.ppf(0.999, len(passed), 0.05)
    assert max(refused) < 0.01


def test_a_residual_within_known_errors_passes_where_replicates_happen_to_be_smaller():
    """Replicates of a third of the sensor noise: a residual of all of it passes, one of twice as much does not."""
    rng = np.random.default_rng(4)
    drawn = toy.SENSOR / 3 * rng.standard_normal((8, SIZE))
    noise = NoiseModel.from_replicates(drawn, SENSOR, LAYOUT)
    found = [check_fitted(noise, size * toy.SENSOR * rng.standard_normal(SIZE)) for size in (1, 2)]
    assert np.mean(found[0].replicates) < 0.2 and found[0].times_noise > 4
    assert found[0].p_value > 0.1 and found[1].p_value < 0.01


def test_sizes_relative_to_the_replicates():
    noise = toy.learnt(np.random.default_rng(3), 10)
    check = check_fitted(noise, noise.mean)
    usual = float(np.mean(check.replicates))
    assert check.statistic == 0.0 and check.excess == -usual and check.times_noise == 0.0
    large = check_fitted(noise, noise.mean + 1.0)
    assert large.times_noise == pytest.approx(large.statistic / usual) and large.excess == large.statistic - usual
