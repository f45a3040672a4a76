"""Which recording to make next: what separates hypotheses counts, and what they can imitate does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.diagnosis.plan import Proposal, propose
from pacnerf_lpo.diagnosis.recipes import RECIPES, Recipe, recipes_for, work_out
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.least_squares import sensitivities
from pacnerf_lpo.identification.model_errors import ModelErrors
from pacnerf_lpo.mpm.effects import GravityMagnitude, InitialSpin, LinearDrag, Magnus, UniformForce
from pacnerf_lpo.report.plan import page, sentences
from validation.hidden_effects.known_shape import KnownShape
from validation.hidden_effects.setting import Size, draw_setting
from validation.hidden_effects.study import best_drop

pytestmark = pytest.mark.slow

SIZE = Size(particles=200, views=3, frames=8, image_size=48)
SAME, HIGHER = RECIPES[0], next(recipe for recipe in RECIPES if recipe.higher == 3)


@pytest.fixture(scope="module")
def problem() -> KnownShape:
    setting, true = draw_setting(np.random.default_rng(3), SIZE, "NeoHookean")
    setting = replace(setting, held_views=[2])
    return KnownShape.simulated("drop", setting, true)


@pytest.fixture
def undecided(problem: KnownShape, small_threads: None) -> SimpleNamespace:
    """A round that leaves a drag and another gravity."""
    model = problem.model((), problem.first_guess)
    everywhere = problem.residual_of(model, problem.usable)
    now = everywhere(model.start)
    jacobian = np.full((*problem.usable.shape, len(model.names)), np.nan)
    jacobian[problem.usable] = sensitivities(everywhere, model.start, now, model.scales, model.bounds)
    mean, deviation = priors(problem, model)
    noise = 0.3 * np.random.default_rng(0).standard_normal((6, *problem.usable.shape))
    nothing = np.zeros((*problem.usable.shape, 1))
    errors = ModelErrors(noise, problem.sensor, *[nothing] * 4, np.zeros(1), nothing[..., 0])
    comparison = Comparison(
        model.names, model.start, problem.first_guess, mean, deviation, 100.0, problem.residual(problem.measured),
        jacobian, errors, (), 1, problem.fitted,
    )  # fmt: skip
    candidates = {"LinearDrag": LinearDrag(), "GravityMagnitude": GravityMagnitude()}
    fitted = {"LinearDrag": {"drag": 1.0}, "GravityMagnitude": {"extra_gravity": -1.0}}
    refits = [
        SimpleNamespace(name=name, known={**problem.first_guess, **values}, cost=100.0, log_bayes_factor=30.0)
        for name, values in fitted.items()
    ]
    return SimpleNamespace(
        effects=(),
        comparison=comparison,
        refits=refits,
        indistinguishable=list(fitted),
        second=None,
        candidate=lambda name: Candidate(name, candidates[name]),
    )


def test_a_higher_drop_tells_a_drag_from_another_gravity(problem: KnownShape, undecided: SimpleNamespace):
    told: list[str] = []
    found = propose(problem, undecided, told.append, [SAME, HIGHER])
    assert [one.higher for one in found] == [3, 1] and best_drop(found) == 1
    assert found[0].score > 2 * found[1].score > 0
    assert {(pair.true, pair.against) for pair in found[0].odds} == {
        ("LinearDrag", "GravityMagnitude"),
        ("GravityMagnitude", "LinearDrag"),
    }
    assert found[0].words.startswith("drop it from ") and "instead of" in found[0].words
    assert len(told) == 2


def test_the_opposite_spin_tells_a_side_force_from_a_wind(problem: KnownShape, undecided: SimpleNamespace):
    """Of a body that falls with backspin. The hypothesis with the spin comes second; its recipe is proposed even so."""
    spin, wind = (100.0, 0.0, 0.0), UniformForce()
    undecided.indistinguishable = ["UniformForce", "Magnus"]
    known = [{"push_x": 0.0, "push_z": -1.0}, {"magnus": 0.005}]
    for again, name, values in zip(undecided.refits, undecided.indistinguishable, known, strict=True):
        again.name, again.known = name, {**problem.first_guess, **values}
    effects = {"UniformForce": wind, "Magnus": Magnus(spin=spin)}
    undecided.candidate = lambda name: Candidate(name, effects[name])
    found = propose(problem, undecided, lambda _: None, [SAME, *(r for r in RECIPES if r.opposite)])
    assert ["opposite spin" in one.words for one in found] == [True, False]
    assert found[0].score > 2 * found[1].score > 0


def test_a_measured_spin_is_that_of_the_recording(problem: KnownShape, small_threads: None):
    effects = [Magnus(spin=(1.0, -2.0, 3.0)), LinearDrag()]
    part = problem.parts(effects, {**problem.first_guess, "magnus": 0.01, "drag": 0.5})[0]
    spins = {}
    for recipe in (SAME, *(r for r in RECIPES if r.opposite or any(r.spin))):
        proposed = work_out(recipe, part)
        assert proposed is not None
        moved = proposed.model(part)
        (side,) = [e for e in moved.physics.effects if isinstance(e, Magnus)]
        assert moved.known["magnus"] == 0.01
        spins[recipe.name] = side.spin
    turning = "let it fall with a spin of two turns per second"
    opposite = "throw it as before, but with the opposite spin"
    expected = {SAME.name: (1.0, -2.0, 3.0), turning: (0.0, 0.0, 4 * np.pi), opposite: (-1.0, 2.0, -3.0)}
    assert spins == expected
    assert not any(recipe.opposite for recipe in recipes_for([Magnus(), LinearDrag()]))


def test_nothing_separates_equal_hypotheses(problem: KnownShape, undecided: SimpleNamespace):
    undecided.candidate = lambda name: Candidate(name, LinearDrag())
    for again in undecided.refits:
        again.known = undecided.refits[0].known
    found = propose(problem, undecided, lambda _: None, [SAME])
    assert found[0].score == pytest.approx(0.0, abs=1e-9)


def test_nothing_is_left_to_tell_apart(problem: KnownShape, undecided: SimpleNamespace):
    undecided.indistinguishable = ["LinearDrag"]
    with pytest.raises(UserInputError, match="nothing is left to separate"):
        propose(problem, undecided, lambda _: None)


def test_recipes_in_numbers(problem: KnownShape, small_threads: None):
    part = problem.parts((), problem.first_guess)[0]
    same, higher = work_out(SAME, part), work_out(HIGHER, part)
    assert same is not None and higher is not None
    assert len(same.video.times) == SIZE.frames and same.lifted == 0 and same.scale == 1
    assert len(higher.video.times) > SIZE.frames and higher.contact[1] > higher.contact[0]
    bottom = float(problem.body.positions[:, 1].min())
    assert higher.lifted == pytest.approx(2 * bottom)
    assert f"{3 * bottom:.2g} m instead of {bottom:.2g} m" in higher.words
    model = higher.model(part)
    assert model.predict(model.start).shape == (SIZE.views, len(higher.video.times), 11)
    spinning = Recipe("spin", spin=(0.0, 0.0, 5.0))
    turned = work_out(spinning, part)
    assert turned is not None and turned.model(part).known["spin_z"] == 5.0
    assert not any(any(recipe.spin) for recipe in recipes_for([InitialSpin()]))


def test_words_and_page():
    plan = [Proposal("drop it from 2 m instead of 1 m", 2.0, 9.0, ()), Proposal("the same", 1.0, 0.5, ())]
    text = sentences(["LinearDrag", "GravityMagnitude"], plan)
    assert text[0].startswith("To separate linear drag and gravity magnitude")
    assert text[1] == "1. drop it from 2 m instead of 1 m: 8 100 to 1"
    assert text[2] == "2. the same: 1.6 to 1"
    assert "None of these" in sentences(["LinearDrag", "GravityMagnitude"], plan[1:])[-1]
    assert page("demo", ["LinearDrag", "GravityMagnitude"], plan).count("<rect") == 2


def test_settings_of_a_diagnosis_are_kept(tmp_path: Path):
    settings = Settings([str(tmp_path / "run")], None, Options(replicates=12, per_recording=["UniformForce"]))
    settings.write(tmp_path / "diagnosis")
    assert Settings.read(tmp_path / "diagnosis") == settings
    with pytest.raises(UserInputError, match="run `pacnerf-lpo diagnose` first"):
        Settings.read(tmp_path)
