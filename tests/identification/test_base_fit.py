"""The base fit of a small scene: it finds the modulus, says what is suspect, and survives unstable rollouts."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.base_fit import (
    SEARCH_ITERATIONS,
    Objective,
    base_fit,
    coarse_search,
    notes,
    priors,
)
from pacnerf_lpo.identification.forward_model import BodyModel
from pacnerf_lpo.identification.least_squares import Effort, fit
from pacnerf_lpo.mpm.effects import GroundFriction, LinearDrag, YieldStress
from pacnerf_lpo.mpm.materials.common import POISSON, YOUNG
from pacnerf_lpo.mpm.simulator import Simulator
from validation.hidden_effects.film import film
from validation.hidden_effects.known_shape import KnownShape, physics_of
from validation.hidden_effects.setting import Size, draw_setting

SMALL = Size(particles=60, views=3, held=1, frames=8, image_size=32)


@pytest.fixture(scope="module")
def scene():
    """An elastic body without an effect, as its own model sees it, and the true values [SI]."""
    setting, true = draw_setting(np.random.default_rng(5), SMALL, "NeoHookean")
    return KnownShape.simulated("small", setting, true), {**physics_of(setting).guess, **true}


@pytest.mark.parametrize(("extrapolated", "most"), [(False, 100), (True, 120)])
def test_it_finds_its_own_modulus_in_few_rollouts(scene, monkeypatch, extrapolated: bool, most: int):
    """What the model itself shows has the modulus of the model's own grid, not of a finer one."""
    problem, true = scene
    monkeypatch.setattr(type(problem), "deforms", extrapolated)
    found = base_fit(problem, (), problem.first_guess)
    assert found.rollouts <= most
    assert extrapolated or np.log10(found.known["E"] / true["E"]) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("material", ["NeoHookean", "VonMises"])
def test_it_finds_the_modulus_of_a_body_that_was_simulated_on_a_finer_grid(material):
    """The grid alone would be 0.2 decades off, and 0.6 where the body is plastic."""
    random = np.random.default_rng(5)
    setting, true = draw_setting(random, replace(SMALL, particles=200), material)
    seen = film(setting, true, [], random, 0.5)
    problem = KnownShape.seen("small", setting, seen.silhouettes, seen.brightness)
    found = base_fit(problem, (), problem.first_guess).known
    assert np.log10(found["E"] / true["E"]) == pytest.approx(0.0, abs=0.1)


def test_what_two_bodies_show_is_extrapolated_to_vanishing_node_spacing(scene):
    """An error that goes with the square of the spacing is gone."""
    problem, _ = scene
    models = problem.model((), problem.first_guess), problem.coarse_model((), problem.first_guess)
    prior = priors(problem, models[0])
    fine, coarse = (Objective(problem, model, *prior)(model.start) for model in models)
    error = (coarse - fine) / (models[1].body.spacing ** 2 - models[0].body.spacing ** 2)
    found = Objective(problem, models[0], *prior, coarse=models[1])(models[0].start)
    assert found == pytest.approx(fine - error * models[0].body.spacing ** 2, rel=1e-6)
    assert np.abs(coarse - fine).max() > 1.0


def test_errors_of_the_first_frames_do_not_lead_away_from_a_good_start(scene):
    """The search ends no higher than a fit of all frames from its start, whatever the first frames say."""
    problem, true = scene
    measured = problem.measured.copy()
    measured[:, 1:3, :10] += 2.0 * np.random.default_rng(2).standard_normal(measured[:, 1:3, :10].shape)
    wrong = KnownShape("wrong", problem.setting, problem.video, measured, problem.noise)
    known = {name: true.get(name, value) for name, value in wrong.first_guess.items()}
    coarse = wrong.coarse_model((), known)
    objective = Objective(wrong, coarse, *priors(wrong, coarse))
    direct = fit(objective, coarse.start, coarse.scales, coarse.bounds, Effort(SEARCH_ITERATIONS, confirm=False))
    assert coarse_search(wrong, (), known).fits[0].cost <= 1.001 * direct.cost


def test_an_effect_without_a_gradient_at_its_null_starts_at_its_probes(scene):
    problem, _ = scene
    effect, told = GroundFriction(), []
    base_fit(problem, [effect], {**problem.first_guess, **effect.null}, told.append)
    assert told[0].startswith("base fit from 3 starts")


def test_priors_lie_around_the_guess_and_what_is_usual(scene):
    problem, _ = scene
    effects = LinearDrag(), YieldStress()
    nulls = {name: value for effect in effects for name, value in effect.null.items()}
    model = problem.model(effects, {**problem.first_guess, **nulls})
    mean, deviation = (dict(zip(model.names, values, strict=True)) for values in priors(problem, model))
    assert (mean["E"], deviation["E"]) == pytest.approx((np.log10(problem.physics.guess["E"]), 1.0))
    assert float(POISSON.transform.to_physical(torch.tensor(mean["nu"]))) == pytest.approx(0.35)
    assert (mean["drag"], deviation["drag"]) == pytest.approx((0.0, 30.0))
    assert 2.4 < mean["yield_stress"] < 3.6  # of its probes: the null, 1e9 Pa, stands for never
    assert (YOUNG.prior(1e5)[0], YOUNG.prior(1e5)[1]) == pytest.approx((5.0, 1.0))


def test_a_ground_that_was_measured_may_be_farther_off_than_a_grid_shifts_it(scene, monkeypatch):
    problem, _ = scene
    for error in (0.0, 0.02):
        monkeypatch.setattr(problem.physics, "ground_error", error)
        model = problem.model((), problem.first_guess)
        low, high = (side[model.names.index("ground_height")] for side in model.bounds)
        assert (low, high) == pytest.approx((-problem.spacing / 2 - error, problem.spacing / 2 + error))


def test_estimates_at_a_bound_or_far_from_the_guess_are_reported(scene):
    problem, _ = scene
    model = problem.model((), problem.first_guess)
    mean, deviation = priors(problem, model)
    assert notes(model, mean, mean, deviation) == []
    free = mean.copy()
    free[model.names.index("E")] -= 3.0
    free[model.names.index("nu")] = model.bounds[1][model.names.index("nu")]
    young, poisson = notes(model, free, mean, deviation)
    assert "Young's modulus" in young and "3.0 standard deviations" in young
    assert "Poisson's ratio" in poisson and "bound" in poisson


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 1.0])
def test_rollouts_that_fail_at_random_are_steps_back_and_no_crash(scene, monkeypatch, share):
    """Only where no motion at all is stable there is no fit, and an error that says so."""
    problem, _ = scene
    random, simulate = np.random.default_rng(int(10 * share)), Simulator.__call__

    def failing(self, *arguments, **more):
        if random.random() < share:
            raise SimulationError(3, 7, "at random")
        return simulate(self, *arguments, **more)

    monkeypatch.setattr(Simulator, "__call__", failing)
    if share == 1.0:
        with pytest.raises(SimulationError, match="from every start of the base fit"):
            base_fit(problem, (), problem.first_guess)
    else:
        assert np.isfinite(base_fit(problem, (), problem.first_guess).cost)


def test_a_model_whose_paths_fail_at_random_says_what_was_left_out(scene, monkeypatch):
    problem, _ = scene
    random, path = np.random.default_rng(1), BodyModel.path

    def failing(self, free):
        if random.random() < 0.3:
            raise SimulationError(3, 7, "at random")
        return path(self, free)

    monkeypatch.setattr(BodyModel, "path", failing)
    found = base_fit(problem, (), problem.first_guess)
    assert any("left out" in note for note in found.notes)
