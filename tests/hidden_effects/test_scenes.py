"""Two tiny scenes from the draw to the score."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pacnerf_lpo.diagnosis.twins import twins

from benchmarks.hidden_effects import generate, run
from benchmarks.hidden_effects.known_shape import KnownShape
from benchmarks.hidden_effects.outcomes import outcome
from benchmarks.hidden_effects.score import page
from benchmarks.hidden_effects.setting import Size
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.diagnosis.residual_force import residual_force
from pacnerf_lpo.identification.least_squares import sensitivities
from pacnerf_lpo.mpm.effects import UniformForce

TINY = Size(particles=300, views=4, held=2, frames=8, image_size=48)
CANDIDATES = "- class_path: LinearDrag\n- class_path: UniformForce\n"
NULL, DRAG = 2, 1  # seeds of development scenes


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    return {seed: generate.generate(folder, seed, TINY) for seed in (NULL, DRAG)}


def test_a_drawn_scene_has_the_wanted_strength_and_hides_it(scenes):
    truth = json.loads((scenes[DRAG] / "truth.json").read_text())
    assert [hidden["name"] for hidden in truth["hidden"]] == ["LinearDrag"]
    assert truth["hidden"][0]["snr"] == pytest.approx(20.0, rel=0.1)  # the search stops within a tenth
    assert truth["hidden"][0]["values"]["drag"] > 0
    assert "drag" not in (scenes[DRAG] / "setting.json").read_text()
    assert json.loads((scenes[NULL] / "truth.json").read_text())["hidden"] == []


def test_the_video_is_that_of_the_truth_and_the_model_starts_elsewhere(scenes):
    problem = KnownShape.read(scenes[NULL])
    truth = json.loads((scenes[NULL] / "truth.json").read_text())["values"]
    # a body floats above the ground by half a node spacing, and the model's is larger than the truth's
    known = {**problem.first_guess, "ground_height": -0.5 * (1 - TINY.finer) * problem.spacing}
    model = problem.model((), {**known, **truth})
    close = np.nanstd(problem.residual(model.predict(model.start))[..., :2])
    guess = problem.model((), known)
    far = np.nanstd(problem.residual(guess.predict(guess.start))[..., :2])
    assert close < 0.5 * far  # centroids: true values on a coarser grid beat the first guess
    assert problem.fitted.any(axis=(1, 2)).sum() == TINY.views - TINY.held


def test_scenes_are_drawn_once_and_alike(scenes, tmp_path):
    stamp = (scenes[NULL] / "video.npz").stat().st_mtime_ns
    generate.generate(scenes[NULL].parent, NULL, TINY)
    assert (scenes[NULL] / "video.npz").stat().st_mtime_ns == stamp
    again = generate.generate(tmp_path, NULL, TINY)
    assert (again / "truth.json").read_text() == (scenes[NULL] / "truth.json").read_text()


def test_a_force_foretells_views_that_were_not_fitted_and_a_fault_of_those_that_were_does_not(scenes, small_threads):
    problem = KnownShape.read(scenes[NULL])
    null = problem.model((), problem.first_guess)
    everywhere = problem.residual_of(null, np.ones_like(problem.usable))
    jacobian = sensitivities(everywhere, null.start, everywhere(null.start), null.scales, null.bounds)
    noise = twins(problem, (), null.start, null, 6, 0)
    wind = problem.model((UniformForce(6.0),), {**problem.first_guess, "push_x": 6.0})
    pushed = problem.relative(wind.predict(wind.start) - null.predict(null.start))
    drifting = np.zeros_like(pushed)
    time = np.linspace(0, 1, pushed.shape[1])
    for view, sign in zip(np.flatnonzero(problem.split.views), (1, -1), strict=True):
        drifting[view, :, 0] = 4 * sign * time**2
    shape = (*problem.usable.shape, -1)
    jacobian, wrong = jacobian.reshape(shape), np.zeros((*problem.usable.shape, 0))  # the shape is known
    known = Comparison((), null.names, null.start, problem.first_guess, noise[0], jacobian, noise[1:], wrong)
    force, fault = (
        residual_force(problem, replace(known, residual=known.residual + change), lambda _: None)
        for change in (pushed, drifting)
    )
    assert force.explained > 0.6 and fault.explained > 0.6
    assert force.held.removed > 0.9 and force.held.z > force.held.needed
    assert fault.held.removed < 0 and fault.held.z < fault.held.needed


def test_a_scene_is_diagnosed_scored_and_not_done_again(scenes, tmp_path, small_threads):
    (tmp_path / "candidates.yaml").write_text(CANDIDATES)
    options = Options(str(tmp_path / "candidates.yaml"), twins=5, effects=1, until="screen")
    line = run.diagnose_scene(scenes[DRAG], options)
    assert line.startswith("0001: ")
    found = outcome(scenes[DRAG])
    assert found.ranking[0] == "LinearDrag" and found.within(1, exact=True)
    assert outcome(scenes[NULL]) is None
    assert run.diagnose_scene(scenes[DRAG], options) == "0001: done before"
    assert "single effect, 20 sigma" in page([found], "command", "")
