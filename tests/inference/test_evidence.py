"""Scores of hypotheses against marginal likelihoods that are integrated numerically, without any closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp

from pacnerf_lpo.inference.evidence import Alternative, score
from pacnerf_lpo.inference.hypotheses import Hypothesis
from tests.inference import toy

NOISE = toy.learnt(np.random.default_rng(1), 12)
DRAG, WIND = toy.EFFECTS["linear drag"][0], toy.EFFECTS["uniform force"][0]
SIGMAS = np.linspace(-0.4, 1.2, 81)
"""Logarithms of the common dispersion. The likelihood of 192 data narrows it to about 1/sqrt(2 * 192) = 0.05: two and a
half steps of the grid."""
COEFFICIENTS = np.linspace(-9.0, 9.0, 161)
"""In units of the dispersion; the posterior deviation of the coefficients below is more than a tenth."""


def residual(strength: float, change: np.ndarray, seed: int = 5) -> np.ndarray:
    """Of a null, as large as the noise says or larger, with an effect."""
    drawn = 1.3 * np.random.default_rng(seed).standard_normal(len(NOISE.mean))
    size = np.linalg.norm(NOISE.whiten(change))
    return NOISE.mean + np.linalg.solve(NOISE.whiten(np.eye(len(drawn))), drawn) + strength * change / size


def brute(y: np.ndarray, X: np.ndarray, scale: float, one_sided: bool = False) -> float:
    """log of the ratio of int dsigma/sigma int db N(b; 0, sigma^2) N(y; X b, sigma^2 V) to that with b = 0; V is 1, but
    scale^2 along X.
    """
    axes = np.linalg.qr(X)[0]
    V = np.eye(len(y)) + (scale**2 - 1) * axes @ axes.T
    A = np.linalg.inv(V)
    grids = np.meshgrid(*[COEFFICIENTS] * X.shape[1], indexing="ij")
    z = np.stack([grid.ravel() for grid in grids])  # b / sigma
    prior = -0.5 * (z**2).sum(0) - 0.5 * len(z) * np.log(2 * np.pi) + len(z) * np.log(COEFFICIENTS[1] - COEFFICIENTS[0])
    if one_sided:
        prior = np.where(z[0] > 0, prior + np.log(2), np.where(z[0] == 0, prior, -np.inf))
    linear, quadratic = X.T @ A @ y @ z, np.einsum("kn,kl,ln->n", z, X.T @ A @ X, z)
    with_it, without = [], []
    for log_sigma in SIGMAS:
        sigma = np.exp(log_sigma)
        null = -len(y) * log_sigma - 0.5 * (y @ A @ y) / sigma**2
        without.append(null)
        with_it.append(null + logsumexp(prior + linear / sigma - 0.5 * quadratic))
    return float(logsumexp(with_it) - logsumexp(without))


def found(hypothesis: Hypothesis, measured: np.ndarray, scale: float) -> float:
    return score(NOISE, measured, hypothesis, scale).log_bayes_factor


@pytest.mark.parametrize("scale", [1.0, 1.8])
@pytest.mark.parametrize("strength", [0.0, 3.0, -8.0])
def test_one_coefficient_is_integrated_out(strength: float, scale: float):
    change = 0.3 * DRAG[0][:, None]
    measured = residual(strength, change[:, 0])
    expected = brute(NOISE.whiten_residual(measured), NOISE.whiten(change), scale)
    assert found(Hypothesis("drag", (change,), (np.ones(1),)), measured, scale) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_two_coefficients_are_integrated_out(scale: float):
    """Two that resemble each other, at different sizes."""
    change = np.stack((0.2 * WIND[0], 0.1 * WIND[1] + 0.1 * WIND[0]), axis=1)
    measured = residual(6.0, WIND[0] + 0.5 * WIND[1])
    expected = brute(NOISE.whiten_residual(measured), NOISE.whiten(change), scale)
    hypothesis = Hypothesis("wind", (change,), (np.ones(2),))
    assert found(hypothesis, measured, scale) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("strength", [6.0, 0.5, -2.0])
def test_a_coefficient_with_a_sign_has_half_the_prior(strength: float):
    """The normal distribution in place of Student's t with D = 192 is off by x (x^2 + 1) phi(x) / 4 D Phi(x) in the
    logarithm: 0.02 at x = -2.5.
    """
    change = 0.3 * DRAG[0][:, None]
    measured = residual(strength, change[:, 0])
    hypothesis = Hypothesis("drag", (change,), (np.ones(1),), one_sided=True)
    y, X = NOISE.whiten_residual(measured), NOISE.whiten(change)
    assert found(hypothesis, measured, 1.2) == pytest.approx(brute(y, X, 1.2, one_sided=True), abs=0.03)
    two_sided = found(Hypothesis("drag", (change,), (np.ones(1),)), measured, 1.2)
    assert (found(hypothesis, measured, 1.2) > two_sided) == (X[:, 0] @ y > 0)


def test_alternatives_are_averaged():
    """Several sizes of one hypothesis: the mean of their Bayes factors."""
    changes = tuple(size * DRAG[0][:, None] for size in (0.1, 1.0, 10.0))
    measured = residual(6.0, DRAG[0])
    single = [found(Hypothesis("drag", (change,), (np.ones(1),)), measured, 1.0) for change in changes]
    together = score(NOISE, measured, Hypothesis("drag", changes, (np.ones(1),) * 3), 1.0)
    assert together.log_bayes_factor == pytest.approx(np.log(np.mean(np.exp(single))))
    assert together.alternative == int(np.argmax(single))


def test_spreads_of_a_prior_are_alternatives_of_the_same_change():
    change, measured, spreads = DRAG[0][:, None], residual(6.0, DRAG[0]), (0.1, 1.0, 10.0)
    together = score(NOISE, measured, Hypothesis("drag", (change,), (np.full(1, 2.0),), spreads=spreads), 1.0)
    single = [score(NOISE, measured, Hypothesis("drag", (s * change,), (np.full(1, 2 * s),)), 1.0) for s in spreads]
    best = max(single, key=lambda one: one.log_bayes_factor)
    factors = [one.log_bayes_factor for one in single]
    assert together.log_bayes_factor == pytest.approx(np.log(np.mean(np.exp(factors))))
    assert together.coefficient == pytest.approx(best.coefficient) and together.alternative == 0


def test_coefficients_are_the_posterior_mean_in_their_unit():
    """Against the normal equations; prior deviations of 4 and 0.5 of their units."""
    widths, change = np.array([4.0, 0.5]), np.stack(WIND, axis=1)
    measured = NOISE.mean + change @ [3.0, -0.7]
    told = score(NOISE, measured, Hypothesis("wind", (change * widths,), (widths,)), 1.0)
    X = NOISE.whiten(change)
    precision = X.T @ X + np.diag(widths**-2)
    assert told.coefficient == pytest.approx(np.linalg.solve(precision, X.T @ X @ [3.0, -0.7]), rel=1e-9)
    assert told.error == pytest.approx(np.sqrt(np.diag(np.linalg.inv(precision))), rel=1e-9)
    assert np.linalg.norm(told.signature) == pytest.approx(1.0)


def test_a_residual_below_the_noise_is_no_evidence():
    """A small effect, and nothing else: a dispersion that is estimated, not bounded, would call it large."""
    ((alternative,),) = Alternative.of_all(NOISE, [Hypothesis("drag", (DRAG[0][:, None],), (np.ones(1),))])
    small = alternative.log_bayes_factor(np.array([1.0]), np.array(0.0), 1.0, False)
    usual = alternative.log_bayes_factor(np.array([1.0]), np.array(191.0), 1.0, False)
    assert small == pytest.approx(float(usual)) and small < 0.5


@pytest.mark.parametrize(("columns", "widths", "one_sided"), [(2, 1, False), (2, 2, True)])
def test_a_hypothesis_that_contradicts_itself_is_refused(columns: int, widths: int, one_sided: bool):
    with pytest.raises(ValueError, match="hypothesis odd"):
        Hypothesis("odd", (np.ones((5, columns)),), (np.ones(widths),), one_sided)


def test_probes_become_lines_through_the_null():
    """Probes at 2 and -4 with a prior deviation of 3: changes per prior deviation, and the sign where there is one."""
    change = np.stack((np.full(5, 2.0), np.full(5, -8.0)), axis=1)
    sizes, width = np.array([2.0, -4.0]), np.array([3.0, 3.0])
    both = Hypothesis.of_probes("e", change, sizes, width, one_sided=False)
    assert [float(one[0, 0]) for one in both.alternatives] == [3.0, 6.0]
    joint = Hypothesis.of_probes("e", change, sizes, width, one_sided=False, components=2)
    assert joint.alternatives[0].shape == (5, 2) and joint.widths[0].tolist() == [3.0, 3.0]
    halves = Hypothesis.of_probes(
        "e", np.tile(change, 2), np.tile(sizes, 2) / 2, np.tile(width, 2), False, components=2
    )
    assert [one.tolist() for one in halves.alternatives[1]] == [one.tolist() for one in 2 * joint.alternatives[0]]
    below = Hypothesis.of_probes("e", change[:, 1:], sizes[1:], width[1:], one_sided=True)
    assert float(below.alternatives[0][0, 0]) == -6.0 and below.widths[0].tolist() == [-3.0]
