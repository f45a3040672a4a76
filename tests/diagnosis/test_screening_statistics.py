"""Score test, calibration, omnibus test and classes, by simulation in the linear world of toy.py."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from pacnerf_lpo.diagnosis.statistics.calibration import Calibration, calibrate
from pacnerf_lpo.diagnosis.statistics.classes import classes, correlation
from pacnerf_lpo.diagnosis.statistics.omnibus import omnibus
from pacnerf_lpo.diagnosis.statistics.score import Probe, Remainder, equivalent_z, log_chi2_survival, score_test
from scipy.stats import binom

from pacnerf_lpo.inference.noise import NoiseModel
from tests.diagnosis import toy

LAYOUT, JACOBIAN, PROBES = toy.layout(), toy.jacobian(), toy.probes()
SENSOR = np.full(len(LAYOUT), toy.SENSOR)
WORLD = toy.World()


def learn(rng: np.random.Generator, twins: int = 10) -> NoiseModel:
    return NoiseModel.from_twins(WORLD.draw(rng, twins), SENSOR, LAYOUT)


@cache
def fixed(twins: int = 16) -> tuple[NoiseModel, Calibration]:
    noise = learn(np.random.default_rng(7), twins)
    return noise, calibrate(noise, JACOBIAN, PROBES)


def most_likely_at(level: float, count: int) -> int:
    """Most false alarms that a true rate of ``level`` produces in 99 of 100 such tests."""
    return int(binom.ppf(0.99, count, level))


def test_false_alarms_stay_below_the_level(monkeypatch):
    """400 nulls, each with twins of its own; score test over the catalogue and omnibus test, both at 5 %."""
    monkeypatch.setattr("pacnerf_lpo.diagnosis.statistics.calibration.DRAWS", 4000)
    rng, count = np.random.default_rng(0), 400
    named = fired = 0
    for _ in range(count):
        noise = learn(rng)
        null = WORLD.draw(rng, 1)[0]
        calibration = calibrate(noise, JACOBIAN, PROBES)
        best = score_test(noise, null, JACOBIAN, PROBES, calibration.scales)[0]
        named += calibration.p_value(best) < 0.05
        fired += omnibus(noise, null, JACOBIAN).p_value < 0.05
    assert named <= most_likely_at(0.05, count)
    assert fired <= most_likely_at(0.05, count)


def test_left_out_twins_look_like_new_nulls():
    """Mean square of whitened left-out twins and of fresh nulls, over models: equal within three standard errors."""
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(40):
        noise = learn(rng, 12)
        twins = omnibus(noise, WORLD.draw(rng, 1)[0], JACOBIAN)
        ratios.append(np.log(twins.statistic) - np.log(twins.twins).mean())
    assert abs(np.mean(ratios)) < 3 * np.std(ratios) / np.sqrt(40)


def strength_of(noise: NoiseModel, calibration: Calibration, name: str) -> tuple[np.ndarray, float]:
    """The first change of an effect (D,), and its size at one calibrated standard deviation."""
    probe = next(probe for probe in PROBES if probe.name == name)
    left = Remainder.of(noise, JACOBIAN).change(probe.change[:, :1])
    return probe.change[:, 0], calibration.scales[name] / float(np.linalg.norm(left))


def test_power_and_naming_at_seven_and_twenty_sigma():
    """Effects of 7 and 20 calibrated sigma: detected, and the true one in the class of the best, where classes differ.

    At 7 sigma a score falls below the threshold of about 3.4 with probability 0.0002; the twins of one model are one
    draw of their covariance, so 90 % is asked instead. Among the effects are pairs that correlate up to 0.9.
    """
    noise, calibration = fixed()
    rng = np.random.default_rng(4)
    detected, named = {7: [], 20: []}, {7: [], 20: []}
    for probe in PROBES:
        change, sigma = strength_of(noise, calibration, probe.name)
        for strength in (7, 20):
            for null in WORLD.draw(rng, 6):
                scores = score_test(noise, null + strength * sigma * change, JACOBIAN, PROBES, calibration.scales)
                merged = classes(np.array([s.signature for s in scores]), [s.name for s in scores])
                detected[strength].append(abs(scores[0].z) > calibration.threshold)
                named[strength].append(probe.name in next(group for group in merged if scores[0].name in group))
    assert np.mean(detected[7]) >= 0.9 and np.mean(detected[20]) == 1.0
    assert np.mean(named[7]) >= 0.8 and np.mean(named[20]) >= 0.95


def test_coefficients_and_their_intervals():
    """Without noise the coefficient is exact; over models 90 % intervals cover 80 to 97 %."""
    noise, _ = fixed()
    probe = next(probe for probe in PROBES if probe.name == "gravity")
    scaled = Probe("gravity", 0.5 * probe.change, (0.5,))
    exact = score_test(noise, noise.mean + 1.7 * probe.change[:, 0] + JACOBIAN @ np.arange(5.0), JACOBIAN, [scaled])[0]
    assert exact.coefficient[0] == pytest.approx(1.7, rel=1e-9) and exact.fraction == pytest.approx(1.0)
    rng, covered = np.random.default_rng(5), []
    for _ in range(60):
        model = learn(rng)
        calibration = calibrate(model, JACOBIAN, PROBES)
        for null in WORLD.draw(rng, 3):
            measured = null + 2.0 * probe.change[:, 0]
            for score in score_test(model, measured, JACOBIAN, PROBES, calibration.scales):
                if score.name == "gravity":
                    low, high = calibration.interval(score)[0]
                    covered.append(low < 2.0 < high)
    assert 0.80 <= np.mean(covered) <= 0.97


def test_components_are_found_together():
    noise, calibration = fixed()
    force = next(probe for probe in PROBES if probe.joint)
    measured = noise.mean + force.change @ [3.0, -4.0]
    best = score_test(noise, measured, JACOBIAN, PROBES, calibration.scales)[0]
    assert best.name == "uniform force" and best.coefficient == pytest.approx((3.0, -4.0), rel=1e-9)
    one = score_test(noise, measured, JACOBIAN, [Probe("x", force.change[:, :1], (1.0,))])[0]
    assert one.z**2 < score_test(noise, measured, JACOBIAN, [force])[0].z ** 2


def test_a_one_sided_effect_counts_on_its_side_only():
    noise, _ = fixed()
    drag = next(probe for probe in PROBES if probe.name == "linear drag")
    against = score_test(noise, noise.mean - 5 * drag.change[:, 0], JACOBIAN, [drag])[0]
    along = score_test(noise, noise.mean + 5 * drag.change[:, 0], JACOBIAN, [drag])[0]
    assert against.z == 0 and against.coefficient == (0.0,) and along.z > 3


def test_what_the_parameters_imitate_is_no_effect():
    noise, _ = fixed()
    imitated = Probe("start velocity", JACOBIAN[:, 1:2], (1.0,))
    score = score_test(noise, noise.mean + 9 * JACOBIAN[:, 1], JACOBIAN, [imitated])[0]
    assert score.z == 0 and score.snr == 0 and score.error == (np.inf,)


@pytest.mark.parametrize("dof", [1, 2, 3, 5])
def test_equivalent_z_is_continuous_where_the_series_takes_over(dof):
    """The asymptotic series of three terms is wrong by (dof/2 - 1)(dof/2 - 2)(dof/2 - 3) / x^3 of the probability."""
    at = 300.0 + 10 * dof
    below, above = log_chi2_survival(np.array([at, at + 1e-6]), dof)
    assert above == pytest.approx(below, abs=1e-6)
    assert equivalent_z(np.array(25.0), 1) == pytest.approx(5.0)
    assert equivalent_z(np.array(1e4), dof) < 100.0001


def test_p_values_follow_the_threshold():
    noise, calibration = fixed()
    at = np.quantile(calibration.draws, [0.5, 0.95])
    score = score_test(noise, noise.mean, JACOBIAN, PROBES)[0]
    p_values = [calibration.p_value(type(score)(**{**vars(score), "z": z})) for z in (*at, 12.0)]
    assert p_values[:2] == pytest.approx([0.5, 0.05], rel=0.01) and p_values[2] < 1e-5
    assert calibration.threshold == pytest.approx(at[1])
    assert all(scale >= 1 for scale in calibration.scales.values())


def test_a_large_unnamed_error_fires_the_omnibus_test():
    noise, _ = fixed()
    rng = np.random.default_rng(8)
    assert omnibus(noise, WORLD.draw(rng, 1)[0] + rng.standard_normal(192), JACOBIAN).p_value < 1e-3


def test_classes_hold_pairs_that_cannot_be_told_apart():
    """A row of neighbours at 20 degrees: cos 20 = 0.94, cos 40 = 0.77, so no class may hold three."""
    angles = np.deg2rad([0.0, 20.0, 40.0])
    fan = np.stack((np.cos(angles), np.sin(angles)), axis=1) * [[1], [-2], [3]]
    groups = classes(fan, ["a", "b", "c"])
    assert sorted(map(len, groups)) == [1, 2] and ("a", "c") not in groups
    assert correlation(fan)[0, 1] == pytest.approx(np.cos(angles[1]))
    assert classes(np.zeros((2, 3)), ["d", "e"]) == [("d",), ("e",)]
    assert classes(fan[:1], ["a"]) == [("a",)]


def test_an_error_whose_direction_is_known_is_noise():
    """The data show an error that the twins have not, three standard deviations of one that is known beforehand: it is
    noise then, and the size of a drag is found better.
    """
    error = toy.seen(along_x=toy.CONTACT, taller=toy.CONTACT**2)[:, None]
    drag = toy.seen(along_y=toy.TIME**3)
    found = {}
    for directions in (None, error):
        rng = np.random.default_rng(11)
        noise = NoiseModel.from_twins(WORLD.draw(rng, 16), SENSOR, LAYOUT, directions)
        scores, sizes = [], []
        for _ in range(30):
            measured = WORLD.draw(rng, 1)[0] + 3 * rng.choice([-1, 1]) * error[:, 0]
            sizes.append(omnibus(noise, measured, JACOBIAN).statistic)
            probe = Probe("drag", drag[:, None], (1.0,))
            scores.append(score_test(noise, measured + 6 * drag, JACOBIAN, [probe])[0].coefficient[0])
        found[directions is not None] = np.median(sizes), np.abs(np.array(scores) - 6).max(), noise
    (large, off, without), (small, close, noise) = found[False], found[True]
    assert small < 1.3 < 2 * small < large
    assert close < off
    # C + B B^T with B of one column: the squared length of B falls from l to l / (1 + l), in units of (1 + 1/T) C
    length = float(np.sum(without.whiten(error) ** 2))
    assert np.sum(noise.whiten(error) ** 2) == pytest.approx(length / (1 + length * 17 / 16), rel=1e-6)
    assert all(model.directions is noise.directions for model, _ in noise.left_out)
