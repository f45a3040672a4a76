"""Intervals, identifiability, profile likelihood, acceptance on held-out data, and naming a residual force."""

from __future__ import annotations

import numpy as np
import pytest
from pacnerf_lpo.diagnosis.statistics.acceptance import HeldOut, acceptance, held_out_noise, judge_held_out, survival
from pacnerf_lpo.diagnosis.statistics.intervals import (
    laplace_intervals,
    overdispersion,
    profile_likelihood,
    twin_inflation,
)
from pacnerf_lpo.diagnosis.statistics.residual_force import name_force
from scipy.stats import binom, norm

from pacnerf_lpo.inference.layout import Layout
from pacnerf_lpo.inference.noise import NoiseModel
from tests.diagnosis import toy

JACOBIAN = toy.jacobian()
NAMES = ("v0_x", "v0_y", "v0_z", "E", "nu")


def test_intervals_of_fitted_parameters_cover():
    """Least squares in the toy world, 60 models of 3 nulls and 5 parameters: 80 to 97 % of 90 % intervals cover."""
    world, layout, rng = toy.World(), toy.layout(), np.random.default_rng(0)
    sensor, truth = np.full(len(layout), toy.SENSOR), np.array([0.3, -0.2, 0.1, 0.5, 0.4])
    covered = []
    for _ in range(60):
        noise = NoiseModel.from_twins(world.draw(rng, 10), sensor, layout)
        whitened, inflation = noise.whiten(JACOBIAN), twin_inflation(noise, JACOBIAN)
        for null in world.draw(rng, 3):
            values = np.linalg.lstsq(whitened, noise.whiten_residual(null + JACOBIAN @ truth), rcond=None)[0]
            found = laplace_intervals(whitened, values, NAMES, np.ones(5), inflation=inflation, dof=9)
            covered += [one.low < true < one.high for one, true in zip(found.intervals, truth, strict=True)]
    assert 0.80 <= np.mean(covered) <= 0.97


def test_white_noise_gives_the_textbook_interval():
    """One parameter, n = 100 ones: error 1/10, 90 % at 1.645."""
    found = laplace_intervals(np.ones((100, 1)), [2.0], ["E"], [1.0], inflation=2.0)
    only = found.intervals[0]
    assert (only.error, only.high - 2, 2 - only.low) == pytest.approx((0.2, 1.645 * 0.2, 1.645 * 0.2), rel=1e-3)
    assert only.identifiable and not found.undetermined


def test_a_ratio_is_all_that_motion_gives():
    """Only log E - log rho moves the residual; c is known, d does nothing."""
    rng = np.random.default_rng(1)
    ratio, other = rng.standard_normal((2, 200))
    jacobian = np.stack((ratio, -ratio, other, np.zeros(200)), axis=1)
    found = laplace_intervals(jacobian, np.zeros(4), ["log E", "log rho", "c", "d"], np.ones(4))
    assert [one.identifiable for one in found.intervals] == [False, False, True, False]
    sentences = [one.sentence for one in found.undetermined]
    assert len(sentences) == 2
    assert any("log E" in text and "log rho" in text and "together" in text for text in sentences)
    assert any(text.startswith("d is not determined") for text in sentences)
    assert found.intervals[3].error == np.inf and found.intervals[2].error == pytest.approx(200**-0.5, rel=0.2)


def test_opposite_changes_are_worded_so():
    column = np.linspace(1, 9, 50)
    found = laplace_intervals(np.stack((column, column), axis=1), [0, 0], ["tilt", "wind"], [1.0, 1.0])
    assert found.undetermined[0].sentence.startswith("raising tilt while lowering wind") or found.undetermined[
        0
    ].sentence.startswith("raising wind while lowering tilt")


def test_overdispersion():
    assert overdispersion(2 * np.ones(30), 20) == pytest.approx(6.0)
    assert overdispersion(0.1 * np.ones(30), 20) == 1.0


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


HELD = (toy.layout().view == 3) | (toy.layout().frame >= 10)
DRAG = toy.seen(along_y=toy.TIME**3)
"""Of drag; the held-out entries are the last view and the last two frames."""


def part(layout: Layout, mask: np.ndarray) -> Layout:
    return Layout(layout.view[mask], layout.frame[mask], layout.kind[mask])


def told(rng: np.random.Generator, strength: float, found: float, direction: np.ndarray = DRAG) -> HeldOut:
    """Data with drag, fitted without it; an effect of the size that was found changes the held-out data."""
    world, layout, fitted = toy.World(), toy.layout(), ~HELD
    sensor, twins = np.full(len(layout), toy.SENSOR), world.draw(rng, 10)
    measured = world.draw(rng, 1)[0] + strength * DRAG
    noise = NoiseModel.from_twins(twins[:, fitted], sensor[fitted], part(layout, fitted))
    held = held_out_noise(noise, JACOBIAN[fitted], twins[:, HELD], JACOBIAN[HELD], sensor[HELD], part(layout, HELD))
    whitened = noise.whiten(JACOBIAN[fitted])

    def left(residual: np.ndarray) -> np.ndarray:
        steps = np.linalg.lstsq(whitened, noise.whiten_residual(residual[fitted]), rcond=None)[0]
        return (residual - JACOBIAN @ steps)[HELD]

    return judge_held_out(held, left(measured), left(measured - found * direction))


def test_an_effect_that_is_there_foretells_held_out_data():
    rng = np.random.default_rng(2)
    there = [told(rng, 6.0, found) for found in 30 * [6.0, 3.0]]
    assert np.mean([one.z > one.needed for one in there]) >= 0.95
    whole, half = np.median([one.removed for one in there[0::2]]), np.median([one.removed for one in there[1::2]])
    assert whole == pytest.approx(1.0, abs=0.1) and half == pytest.approx(0.75, abs=0.1)  # squares: 1 - 0.5^2


def test_an_effect_that_is_not_there_seldom_does():
    """A change that the data had no part in: two standard errors are 2.3 % one-sided, of 300 at most 13 (99 %)."""
    rng = np.random.default_rng(4)
    absent = [told(rng, 0.0, rng.choice([-1, 1])) for _ in range(300)]
    assert sum(one.z > one.needed for one in absent) <= binom.ppf(0.99, 300, norm.sf(2))
    assert {round(one.needed, 2) for one in absent} == {2.32}  # Student's t with 9 degrees of freedom


def test_what_the_effect_leaves_over_weakens_it():
    """Much that no model explains is left: the same change counts for less."""
    rng, clean = np.random.default_rng(5), np.random.default_rng(5)
    rough = 3.0 * np.random.default_rng(6).standard_normal(int(HELD.sum()))
    noise = NoiseModel.from_twins(
        toy.World().draw(rng, 10)[:, HELD], np.full(HELD.sum(), 0.1), part(toy.layout(), HELD)
    )
    after = toy.World().draw(clean, 11)[10][HELD]
    change = 6.0 * DRAG[HELD]
    assert (
        judge_held_out(noise, after + rough + change, after + rough).z
        < 0.5 * judge_held_out(noise, after + change, after).z
    )
    assert judge_held_out(noise, after, after).z == 0.0


def test_views_whose_error_is_noise_have_no_vote():
    """The effect removes what one view shows; in the others it adds something, within their noise or above it."""
    world, layout = toy.World(), part(toy.layout(), HELD)
    draws = world.draw(np.random.default_rng(7), 11)[:, HELD]
    noise, quiet = NoiseModel.from_twins(draws[:10], np.full(HELD.sum(), toy.SENSOR), layout), draws[10]
    shown = np.where(layout.view == 3, 6.0 * DRAG[HELD], 0.0)
    elsewhere = np.where(layout.view == 3, 0.0, DRAG[HELD])
    assert judge_held_out(noise, quiet + shown, quiet + 0.1 * elsewhere).falls == (1, 1)
    assert judge_held_out(noise, quiet + shown, quiet + 6.0 * elsewhere).falls == (1, 4)
    assert judge_held_out(noise, quiet, quiet).falls == (0, 4)  # noise everywhere: every view counts


def judged(after: float, before: float = 5.0, falls: int = 4, z: float = 8.0, least: float = 0.25, **changes):
    facts = {"interval": (0.9, 1.6), "null": 0.0, "misfits": (600.0, 90.0), "floor": 80.0, "scored": True}
    return acceptance(HeldOut(before, after, 1.0, (falls, 4), z, 2.3, least), coefficients=2, **{**facts, **changes})


def test_every_criterion_can_refuse():
    assert judged(2.0).accepted and survival(judged(2.0), 1.3, 1.2).accepted
    assert judged(2.0).removed == pytest.approx(0.75)
    for verdict, refusal in (
        (judged(2.0, interval=(-0.1, 2.0)), "includes 0"),
        (survival(judged(2.0), 1.3, 0.3), "does not survive"),
        (survival(judged(2.0), 1.3, -1.2), "does not survive"),
        (survival(judged(5.8), 1.3, 1.2), "rises by 20%"),
        (judged(2.0, falls=2), "in 2 of 4 views"),
        (judged(5.8), "rises by 20%"),
        (judged(4.2), "falls by 20%, less than 25%"),
        (judged(3.0, least=2 / 3), "falls by 50%, less than 67%"),
        (judged(2.0, least=2 / 3, misfits=(600.0, 300.0)), "hardly gets better"),
        (judged(0.5, before=0.9, scored=False), "not above the noise floor"),
        (judged(0.5, before=0.9, z=4.0), "not above the noise floor"),
        (judged(2.0, z=1.0), "does not foretell"),
        (judged(2.0, misfits=(600.0, 597.0)), "no better"),
        (judged(2.0, misfits=(600.0, 520.0)), "hardly gets better (600 to 520, 80 is noise)"),
    ):
        assert not verdict.accepted
        assert any(refusal in sentence for passed, sentence in verdict.reasons if not passed)


def test_a_fit_that_was_no_worse_than_noise_has_to_get_better_by_its_coefficients_only():
    assert judged(2.0, misfits=(600.0, 590.0), floor=610.0).accepted
    assert judged(2.0, misfits=(600.0, 590.0), floor=570.0).accepted
    assert not judged(2.0, misfits=(600.0, 590.0), floor=550.0).accepted


def test_an_effect_may_stand_out_of_an_error_that_as_a_whole_does_not():
    verdict = judged(0.6, before=0.9, z=8.0)
    assert verdict.accepted and verdict.removed == pytest.approx(1 / 3)


def fall(rng: np.random.Generator, count: int = 900) -> dict[str, np.ndarray]:
    """A tumbling body on a parabola that touches the ground in the last third."""
    t = np.repeat(np.linspace(0, 1, 30), count // 30)
    spin = np.tile([0.0, 0.0, 4.0], (count, 1))
    velocity = np.stack((1.5 + 0 * t, -9.8 * t, 0.7 - t), axis=1) + 0.3 * rng.standard_normal((count, 3))
    position = np.stack((1.5 * t, 2 - 4.9 * t**2, 0.7 * t - t**2 / 2), axis=1) + 0.1 * rng.standard_normal((count, 3))
    contact = t > 0.66
    velocity[contact, 1] *= -0.3
    return {"velocity": velocity, "position": position, "spin": spin, "contact": contact, "blocks": np.round(29 * t)}


def named(law) -> dict[str, float]:
    return {term.name: term.coefficient for term in law.terms}


def test_the_law_behind_a_residual_force_is_named():
    rng = np.random.default_rng(4)
    samples = fall(rng)
    v, x = samples["velocity"], samples["position"]
    noise = 0.5 * rng.standard_normal(v.shape)
    linear = name_force(-1.5 * v + noise, **samples)
    quadratic = name_force(-0.3 * np.linalg.norm(v, axis=1, keepdims=True) * v + noise, **samples)
    magnus = name_force(0.5 * np.cross(samples["spin"], v) + [0, 0, 3.0] + noise, **samples)
    spring = name_force(-12 * (x - [0.5, 1.0, 0.0]) + noise, **samples)
    assert named(linear) == {"-v": pytest.approx(1.5, rel=0.05)}
    assert named(quadratic) == {"-|v| v": pytest.approx(0.3, rel=0.05)}
    assert named(magnus) == {"spin x v": pytest.approx(0.5, rel=0.05), "1 along z": pytest.approx(3.0, rel=0.05)}
    assert named(spring)["-x"] == pytest.approx(12, rel=0.1) and set(named(spring)) <= {"-x", "1 along x", "1 along y"}
    term = linear.terms[0]
    assert term.low < 1.5 < term.high and term.frequency == 1.0 and linear.explained > 0.9


def test_noise_and_foreign_laws_are_not_named():
    """White noise, and a force periodic in height, which nothing in the library resembles."""
    rng = np.random.default_rng(5)
    samples = fall(rng)
    assert not name_force(rng.standard_normal((900, 3)), **samples).terms
    foreign = name_force(np.sin(40 * samples["position"])[:, [1, 2, 0]], **samples)
    assert foreign.explained < 0.5
