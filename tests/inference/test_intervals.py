"""Intervals of parameters: their coverage, what is not determined, and profile likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, norm, t

from pacnerf_lpo.inference.intervals import disagreement, posterior_intervals, profile_likelihood, spread_along
from pacnerf_lpo.inference.noise import NoiseModel
from tests.inference import toy

JACOBIAN = toy.jacobian()
NAMES = ("v0_x", "v0_y", "v0_z", "E", "nu")
MANY = 1e9
"""Degrees of freedom of a noise that is known."""


def test_intervals_cover_where_parameters_come_from_their_prior():
    """White noise, 400 draws of three parameters, one strongly, one weakly and one not determined: each is covered in
    90 % but for binomial chance (99.8 %).
    """
    rng, draws = np.random.default_rng(0), 400
    jacobian = rng.standard_normal((30, 3)) * [2.0, 0.3, 0.0]
    deviations = np.array([4.0, 0.5, 2.0])
    true = rng.standard_normal((draws, 3))
    measured = true @ jacobian.T + rng.standard_normal((draws, 30))
    estimates = measured @ jacobian @ np.linalg.inv(jacobian.T @ jacobian + np.eye(3)) * deviations
    covered = np.zeros(3)
    for values, at in zip(estimates, true * deviations, strict=True):
        found, _ = posterior_intervals(jacobian, 1.0, values, ["a", "b", "c"], deviations, 0.9, MANY)
        covered += [one.low < x < one.high for one, x in zip(found, at, strict=True)]
    assert [one.identifiable for one in found] == [True, True, False]
    assert found[2].error == pytest.approx(2.0)  # its prior
    assert (covered >= binom.ppf(1e-3, draws, 0.9)).all() and (covered <= binom.ppf(1 - 1e-3, draws, 0.9)).all()


def test_intervals_cover_where_the_noise_is_learnt_from_few_replicates():
    """The toy world, 8 times ten replicates, two nulls and five parameters each: at least nine tenths are covered but
    for chance, taken for 16 independent recordings; and intervals are not all of the prior.
    """
    world, rng, deviation = toy.World(), np.random.default_rng(0), np.full(5, toy.PRIOR)
    sensor, layout = np.full(len(toy.layout()), toy.SENSOR), toy.layout()
    covered, errors = [], []
    for _ in range(8):
        noise = NoiseModel.from_replicates(world.draw(rng, 10), sensor, layout)
        whitened = noise.whiten(JACOBIAN * deviation)
        for null in world.draw(rng, 2):
            true = deviation * rng.standard_normal(5)
            residual = null + JACOBIAN @ true
            moved = np.linalg.solve(whitened.T @ whitened + np.eye(5), whitened.T @ noise.whiten_residual(residual))
            left = residual - JACOBIAN @ (deviation * moved)
            spread = spread_along(noise, left, JACOBIAN * deviation)
            found, _ = posterior_intervals(whitened, spread, deviation * moved, NAMES, deviation, 0.9, 9)
            covered.append(np.mean([one.low < x < one.high for one, x in zip(found, true, strict=True)]))
            errors.append([one.error for one in found])
    assert np.sum(covered) >= binom.ppf(1e-3, 16, 0.9)
    assert np.median(errors, axis=0).max() < 0.2 * toy.PRIOR


def test_white_noise_and_a_wide_prior_give_the_textbook_interval():
    """One parameter, n = 100 ones, noise of 2: error 2/10; Student's t with 9 degrees of freedom."""
    (only,), undetermined = posterior_intervals(1e6 * np.ones((100, 1)), 2.0, [2.0], ["E"], [1e6], 0.9, 9)
    assert (only.error, only.high - 2) == pytest.approx((0.2, t.ppf(0.95, 9) * 0.2), rel=1e-6)
    assert only.identifiable and not undetermined


def test_a_ratio_is_all_that_motion_gives():
    """Only log E - log rho moves the residual; c is known, d does nothing."""
    rng = np.random.default_rng(1)
    ratio, other = 10 * rng.standard_normal((2, 200))
    jacobian = np.stack((ratio, -ratio, other, np.zeros(200)), axis=1)
    found, sentences = posterior_intervals(
        jacobian, 1.0, np.zeros(4), ["log E", "log rho", "c", "d"], np.ones(4), 0.9, MANY
    )
    assert [one.identifiable for one in found] == [False, False, True, False]
    assert len(sentences) == 2
    assert any("log E" in text and "log rho" in text and "together" in text for text in sentences)
    assert any(text.startswith("d is not determined") for text in sentences)
    assert found[0].error == pytest.approx(np.sqrt(0.5), rel=1e-3)  # half of the variance of the prior is left
    assert found[2].high == pytest.approx(norm.ppf(0.95) / np.linalg.norm(other), rel=0.02)


def test_opposite_changes_are_worded_so():
    column = np.linspace(1, 9, 50)
    _, (sentence,) = posterior_intervals(
        np.stack((column, column), axis=1), 1.0, [0, 0], ["tilt", "wind"], [1.0, 1.0], 0.9, MANY
    )
    assert sentence.startswith(("raising tilt while lowering wind", "raising wind while lowering tilt"))


def test_a_residual_larger_than_the_noise_widens_intervals():
    noise = NoiseModel.from_replicates(
        toy.World().draw(np.random.default_rng(0), 10), np.full(192, toy.SENSOR), toy.layout()
    )
    rough = np.random.default_rng(1).standard_normal(192)
    small, large = (spread_along(noise, noise.mean + size * rough, JACOBIAN) for size in (0.0, 2.0))
    assert (small >= 1.0).all() and (large > 3 * small).all()


def test_profile_of_a_parabola_is_the_laplace_interval():
    """||r||^2 = 40 + ((v - 3) / 0.5)^2: +- 1.645 * 0.5; the root is found to 2 % of the last step, here 1 % of it."""
    profile = profile_likelihood(lambda v: 40 + ((v - 3) / 0.5) ** 2, 3.0, 0.4, (-10.0, 10.0))
    assert (profile.low, profile.high) == pytest.approx((3 - 1.645 * 0.5, 3 + 1.645 * 0.5), abs=0.03)
    assert not profile.low_open and not profile.high_open and len(profile.trials) <= 10


def test_profile_of_a_threshold_is_open_above():
    """Above 2 nothing changes, as with a yield stress that is never reached."""
    profile = profile_likelihood(lambda v: max(0.0, 30 * (2 - v)), 2.5, 1.0, (0.0, 8.0))
    assert profile.high_open and profile.high == 8.0
    assert not profile.low_open and profile.low == pytest.approx(2 - 2.706 / 30, abs=0.05)


def test_estimates_of_a_part_and_of_all_data_disagree_as_much_as_the_noise_is_larger_than_presumed():
    """Two thirds of 60 data and all of them, of three parameters; the noise is presumed to be 1."""
    random = np.random.default_rng(3)
    changes = random.standard_normal((60, 3)) * [1.0, 3.0, 0.3]
    part = changes[:40]

    def estimated(data: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.linalg.solve(rows.T @ rows + np.eye(3), rows.T @ data)

    for size in (1.0, 3.0):
        found = []
        for _ in range(300):
            data = changes @ random.standard_normal(3) + size * random.standard_normal(60)
            shift = estimated(data, changes) - estimated(data[:40], part)
            found.append(disagreement(shift, part, changes, 0.1))
        assert min(found) >= 1.0
        assert np.mean(found) == pytest.approx(1.4 if size == 1.0 else 9.0, rel=0.15)
    assert disagreement(np.full(3, 0.01), changes, changes, 0.5) == 1.0  # nothing was held out
