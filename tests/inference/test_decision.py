"""What is chosen, and what is said to be indistinguishable from it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from pacnerf_lpo.inference.decision import (
    DECISIVE,
    LEVEL,
    LINEAR,
    Contender,
    best,
    explains_most,
    indistinguishable,
    log_bayes_factor,
    log_occam_factor,
    log_odds,
    log_spread_factor,
    worth_refitting,
)


def contender(name: str, cost: float, occam: float = -3.0, p_value: float = 1e-4) -> Contender:
    return Contender(name, cost, occam, p_value)


def test_odds_are_those_of_what_is_left_and_of_the_prior():
    """Costs of 100 data below 100: their dispersion is 1; ten units of the cost are five of the logarithm."""
    odds = log_odds([contender("a", 90.0), contender("b", 80.0), contender("c", 80.0, -5.0)], 100, 1.0)
    assert list(odds) == ["b", "c", "a"]
    assert list(odds.values()) == pytest.approx([0.0, -2.0, -5.0])
    assert log_odds([], 100, 1.0) == {}


@pytest.mark.parametrize(("costs", "scale"), [((400.0, 380.0), 1.0), ((100.0, 80.0), 2.0)])
def test_a_dispersion_above_one_weakens_the_odds(costs: tuple[float, float], scale: float):
    """The best leaves 3.8 times its expectation; or noise along hypotheses is twice as large as thought."""
    odds = log_odds([contender("a", costs[0]), contender("b", costs[1])], 100, scale)
    assert odds["a"] == pytest.approx(-20 / (2 * max(scale**2, costs[1] / 100)))


def test_the_most_probable_of_the_rare_ones_is_chosen():
    tried = [contender("often", 50.0, p_value=1.1 * LEVEL), contender("drag", 80.0), contender("wind", 90.0)]
    odds = log_odds(tried, 100, 1.0)
    assert best(tried, odds).name == "drag"
    assert best(tried[:1], odds) is None and best([], {}) is None


def test_what_is_within_twenty_to_one_is_not_told_apart():
    tried = [contender("drag", 80.0), contender("near", 80 + 1.9 * DECISIVE), contender("far", 80 + 2.1 * DECISIVE)]
    odds = log_odds(tried, 100, 1.0)
    assert indistinguishable(tried[0], odds) == ["drag", "near"]
    tried.append(contender("often", 70.0, p_value=0.5))  # better, but not rarer than a false alarm
    assert indistinguishable(tried[0], log_odds(tried, 100, 1.0))[0] == "drag"
    assert "often" in indistinguishable(tried[0], log_odds(tried, 100, 1.0))


def test_what_could_win_is_refitted():
    """What reaches the threshold but for odds of twenty, and of the best a good part."""
    threshold = 8.0
    scores = [("a", 6.0), ("b", 8.0 - DECISIVE - 0.1), ("c", 7.0)]
    assert worth_refitting(scores, threshold) == ["c", "a"]
    strong = [("a", 100.0), ("b", 100 * LINEAR - DECISIVE - 0.1), ("c", 100 * LINEAR - DECISIVE + 0.1)]
    assert worth_refitting(strong, threshold) == ["a", "c"]
    assert worth_refitting([], threshold) == []
    assert worth_refitting([("a", -0.1), ("b", 0.1)], 1.5) == ["b"]


def linear_problem() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    others, own = rng.standard_normal((40, 3)), rng.standard_normal((40, 2))
    y = rng.standard_normal(40) + others @ [2.0, -1.0, 0.5] + own @ [1.5, 0.3]
    return others, own, y, np.eye(40)


def cost(changes: np.ndarray, y: np.ndarray) -> float:
    """|y - X b|^2 + |b|^2 at its least."""
    b = np.linalg.solve(changes.T @ changes + np.eye(changes.shape[1]), changes.T @ y)
    return float(np.sum((y - changes @ b) ** 2) + b @ b)


def test_an_effect_explains_most_where_it_leaves_less_than_half_of_what_was_more_than_noise():
    assert explains_most(1100.0, 590.0, 100) and not explains_most(1100.0, 610.0, 100)
    assert not explains_most(1100.0, np.inf, 100)


def test_the_occam_factor_and_the_costs_are_the_marginal_likelihood_of_a_linear_model():
    """log N(y; 0, 1 + X X^T) with and without the hypothesis, dispersion one."""
    others, own, y, unit = linear_problem()
    both = np.concatenate((others, own), axis=1)
    exact = multivariate_normal.logpdf(y, cov=unit + both @ both.T) - multivariate_normal.logpdf(
        y, cov=unit + others @ others.T
    )
    laplace = (cost(others, y) - cost(both, y)) / 2 + log_occam_factor(others, own)
    assert laplace == pytest.approx(exact, rel=1e-9)


def test_a_bayes_factor_of_a_fit_is_that_of_students_t():
    """Costs 120 and 60 of 40 data with priors' terms: D/2 log(120/60); costs below their number count as it."""
    assert log_bayes_factor(120.0, 60.0, 40, -2.0, 1.0) == pytest.approx(20 * np.log(2) - 2)
    assert log_bayes_factor(30.0, 20.0, 40, -2.0, 1.0) == pytest.approx(20 * np.log1p(10 / 40) - 2)
    assert log_bayes_factor(120.0, 60.0, 40, -2.0, 2.0) == pytest.approx(20 * np.log1p(15 / 60) - 2)
    assert log_bayes_factor(60.0, 61.0, 40, -2.0, 1.0) == -2.0  # a refit that ended higher is no evidence against it


def test_a_prior_of_several_spreads_against_the_evidence_of_each():
    """y = X b + e in closed form: p(y) = N(0, I + s^2 X X^T) with a prior of standard deviation s."""
    random, spreads = np.random.default_rng(5), (0.05, 0.3, 1.0)
    changes = random.standard_normal((30, 2)) * [3.0, 0.4]
    y = changes @ [0.2, -0.6] + random.standard_normal(30)
    covariance = np.linalg.inv(np.eye(2) + changes.T @ changes)

    def evidence(spread: float) -> float:
        return float(multivariate_normal.logpdf(y, cov=np.eye(30) + spread**2 * changes @ changes.T))

    expected = logsumexp([evidence(spread) for spread in spreads]) - np.log(3) - evidence(1.0)
    assert log_spread_factor(covariance @ changes.T @ y, covariance, spreads) == pytest.approx(expected)
    assert log_spread_factor(covariance @ changes.T @ y, covariance, (1.0,)) == pytest.approx(0.0, abs=1e-12)


def test_a_one_sided_prior_of_several_spreads_against_the_evidence_by_quadrature():
    random, spreads = np.random.default_rng(6), (0.05, 0.3, 1.0)
    column = 4.0 * random.standard_normal(30)
    y = 0.1 * column + random.standard_normal(30)
    variance = 1 / (1 + column @ column)
    values = np.linspace(-3.0, 3.0, 60_001)
    likelihood = np.exp(values * (column @ y) - values**2 * (column @ column) / 2)

    def evidence(spread: float, sides: int) -> float:
        prior = norm.pdf(values, scale=spread) * (values > 0 if sides == 1 else 0.5)
        return float((2 * prior * likelihood).sum())

    expected = np.log(np.mean([evidence(spread, 1) for spread in spreads]) / evidence(1.0, 2))
    mean, covariance = np.array([variance * (column @ y)]), np.array([[variance]])
    assert log_spread_factor(mean, covariance, spreads, one_sided=True) == pytest.approx(expected, abs=1e-3)
