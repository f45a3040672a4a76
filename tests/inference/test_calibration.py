"""The family-wise error rate that is promised, on simulated recordings in which nothing is missing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, kstest

from pacnerf_lpo.inference import calibration
from pacnerf_lpo.inference.calibration import Calibration, Fitted, calibrate, dispersion_of, moderated_scales
from pacnerf_lpo.inference.decision import LEVEL, believed
from pacnerf_lpo.inference.evidence import Alternative, Score, score
from tests.inference import toy

HYPOTHESES = toy.hypotheses()
DRAG = toy.seen(along_y=toy.TIME**3)
MODELS, NULLS, DRAWS = 8, 8, 2000
CHANCE = 1e-3
"""Of a false failure of a test here; seeds are fixed, but may change with NumPy."""


@pytest.fixture(scope="module")
def recordings() -> list[tuple[list[float], float, str]]:
    """For each of some worlds, learnt from 10 replicates: p-values of the best hypothesis in recordings without any
    effect, and p-value and name of the best with a drag of seven deviates of the largest scale.

    Recordings have parameters that were drawn from their prior.
    """
    rng, found = np.random.default_rng(0), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "DRAWS", DRAWS)
        for _ in range(MODELS):
            noise = toy.learnt(rng, 10)
            calibrated = calibrate(noise, HYPOTHESES, toy.all_fitted(noise, len(HYPOTHESES)), LEVEL)

            def best(strength: float, noise=noise, calibrated=calibrated) -> tuple[float, str]:
                moved = toy.PRIOR * toy.jacobian() @ rng.standard_normal(toy.jacobian().shape[1])
                measured = toy.World().draw(rng, 1)[0] + moved + strength * DRAG
                scores = [score(noise, measured, one, calibrated.scales[one.name]) for one in HYPOTHESES]
                first = max(scores, key=lambda one: one.log_bayes_factor)
                return calibrated.p_value(first.log_bayes_factor), first.name

            largest = max(calibrated.scales.values())
            strong = 7 * largest / float(np.linalg.norm(noise.whiten(DRAG)))
            found.append(([best(0.0)[0] for _ in range(NULLS)], *best(strong)))
    return found


@pytest.mark.parametrize("level", [0.01, 0.05, 0.2])
def test_nulls_are_called_an_effect_no_more_often_than_promised(recordings, level: float):
    p_values = [p for nulls, _, _ in recordings for p in nulls]
    assert sum(p < level for p in p_values) <= binom.ppf(1 - CHANCE, len(p_values), level)


def test_p_values_of_nulls_are_not_all_near_one(recordings):
    """Conservative, not useless: half of them are below 0.9."""
    assert np.median([p for nulls, _, _ in recordings for p in nulls]) < 0.9


def test_a_strong_effect_or_one_that_resembles_it_is_named(recordings):
    """Deviates are Student's t; one of 7 is above a threshold near 4 with a probability of some 97 %."""
    named = [p < LEVEL and name in ("linear drag", "quadratic drag", "gravity") for _, p, name in recordings]
    assert sum(named) >= binom.ppf(CHANCE, MODELS, 0.97)


def test_p_values_hold_where_a_part_is_held_out():
    """Two views, and the last frames of the others; scored and simulated by the same rule."""
    rng, world = np.random.default_rng(2), toy.World()
    layout = toy.layout()
    rows = (layout.view < 2) & (layout.frame < toy.FRAMES - 2)
    drawn = world.draw(rng, 40)
    whole, part = toy.of_rows(drawn, np.ones_like(rows)), toy.of_rows(drawn, rows)
    fitted = Fitted(rows, part)
    calibrated = calibrate(whole, HYPOTHESES, [fitted] * len(HYPOTHESES), LEVEL)

    def p_value() -> float:
        measured = world.draw(rng, 1)[0] + toy.PRIOR * toy.jacobian() @ rng.standard_normal(5)
        factors = []
        for one in HYPOTHESES:
            scale = calibrated.scales[one.name]
            of_all = score(whole, measured, one, scale).log_bayes_factor
            factors.append(believed(of_all, score(part, measured[rows], fitted.of(one), scale).log_bayes_factor))
        return calibrated.p_value(float(max(factors)))

    p_values = [p_value() for _ in range(100)]
    assert kstest(p_values, "uniform", alternative="greater").pvalue > CHANCE  # not too many small ones
    assert 0.3 < np.median(p_values) < 0.8
    seen = fitted.among_all(whole, Alternative.of_all(part, [fitted.of(HYPOTHESES[0])])[0][0].axes)
    assert np.linalg.norm(seen, axis=0) == pytest.approx(1.0, abs=0.2)  # a deviate is one, whichever way it is counted


def test_p_values_hold_where_errors_known_beforehand_are_smaller_than_they_may_be():
    """Sixty directions of an error that no recording has. A residual with them as large as they may be is larger than
    that of a null, so that each would be called usual; drawn as large as replicates and data are, p-values are uniform.
    """
    rng, world, plain, matched = np.random.default_rng(11), toy.World(), [], []
    known = 0.2 * toy.smooth(rng, (60, toy.VIEWS, len(toy.KINDS))).transpose(0, 1, 3, 2).reshape(60, -1).T
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "DRAWS", 500)
        for _ in range(6):
            noise = toy.learnt(rng, 16).with_directions(known)
            for _ in range(8):
                measured = world.draw(rng, 1)[0] + toy.PRIOR * toy.jacobian() @ rng.standard_normal(5)
                for found, size in ((plain, 1.0), (matched, dispersion_of(noise, measured))):
                    told = calibrate(noise, HYPOTHESES, toy.all_fitted(noise, len(HYPOTHESES)), LEVEL, size)
                    scores = [score(noise, measured, one, told.scales[one.name]) for one in HYPOTHESES]
                    found.append(told.p_value(max(one.log_bayes_factor for one in scores)))
    assert np.median(plain) > np.median(matched)
    assert 0.3 < np.median(matched) < 0.75
    assert kstest(matched, "uniform", alternative="greater").pvalue > CHANCE  # not too many small ones


def test_a_dispersion_is_at_most_one_and_at_least_that_of_replicates():
    noise = toy.learnt(np.random.default_rng(5), 16)
    least = dispersion_of(noise, noise.mean)
    assert 0.5 < least <= 1.0
    assert dispersion_of(noise, noise.mean + 20.0 * DRAG) == 1.0


def test_held_out_data_add_to_the_fitted_ones_and_name_nothing_alone():
    whole, fitted = np.array([9.0, 9.0, -3.0, -3.0]), np.array([2.0, -1.0, -1.0, 2.0])
    assert believed(whole, fitted).tolist() == [9.0, -1.0, -3.0, -3.0]


def test_a_p_value_is_the_share_of_simulated_maxima_beyond_and_falls_on_as_a_power():
    draws = np.sort(np.random.default_rng(1).exponential(size=10_000))
    told = Calibration({}, 10.0, 0.01, float(np.quantile(draws, 0.99)), draws)
    assert told.p_value(told.threshold) == pytest.approx(0.01, rel=0.02)
    assert told.p_value(float(np.median(draws))) == pytest.approx(0.5, rel=0.01)
    last = float(draws[-calibration.TAIL_DRAWS])
    far = 4 * (last - draws[0]) + draws[0]
    assert told.p_value(far) == pytest.approx(calibration.TAIL_DRAWS / 10_000 / 4**5)
    ps = [told.p_value(x) for x in np.linspace(0, 5 * last, 400)]
    assert (np.diff(ps) <= 0).all() and ps[0] == 1.0
    below = Calibration({}, 10.0, 0.01, -1.0, draws - 20.0)  # where the data speak against all hypotheses
    assert below.p_value(far - 20.0) == pytest.approx(told.p_value(far))
    assert 0.0 < below.p_value(5.0) < 1e-4


def test_scales_are_moderated_towards_their_mean_and_never_below_one():
    """6 replicates of 3 directions; the mean of all counts as four more."""
    squares = np.tile([9.0, 1.0, 0.2], (6, 1))
    common = 10.2 / 3
    expected = np.sqrt((6 * np.array([9.0, 1.0, 0.2]) + 4 * common) / 10)
    assert moderated_scales(squares) == pytest.approx(np.maximum(expected, 1.0))
    assert moderated_scales(0.1 * squares[:, 1:]).tolist() == [1.0, 1.0]


def test_the_threshold_rises_with_the_number_of_hypotheses():
    """The same one twice costs nothing, but for another draw of the dispersion; twelve more cost their odds."""
    noise = toy.learnt(np.random.default_rng(3), 12)
    alone, twice, all_ = (
        calibrate(noise, chosen, toy.all_fitted(noise, len(chosen)), 0.05).threshold
        for chosen in (HYPOTHESES[:1], HYPOTHESES[:1] * 2, HYPOTHESES)
    )
    assert twice == pytest.approx(alone, abs=0.2) and all_ > alone + 1.0


def test_a_scale_weakens_a_score():
    noise = toy.learnt(np.random.default_rng(4), 12)
    measured = noise.mean + 4 * DRAG
    by_scale: list[Score] = [score(noise, measured, HYPOTHESES[0], s) for s in (1.0, 1.5, 3.0)]
    factors = [one.log_bayes_factor for one in by_scale]
    assert factors[0] > factors[1] > factors[2]
    assert by_scale[0].error[0] < by_scale[2].error[0]
