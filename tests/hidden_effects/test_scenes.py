"""Two tiny scenes from the draw to the score."""

import json

import numpy as np
import pytest
import torch

from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.inference.decision import LEVEL
from validation.hidden_effects import generate, run
from validation.hidden_effects.known_shape import KnownShape
from validation.hidden_effects.outcomes import outcome
from validation.hidden_effects.score import compact, page
from validation.hidden_effects.setting import Size
from validation.record import made

pytestmark = pytest.mark.slow

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


def test_every_sampling_of_the_body_is_distorted_alike(scenes):
    """Replicates of a body are samplings of it, and no other bodies."""
    problem = KnownShape.read(scenes[NULL])

    def moved(spacing: float, seed: int) -> np.ndarray:
        """Displacements of the particles nearest to some of the coarse ones."""
        plain, sampled = problem._undistorted(spacing, seed), problem.sample(spacing, seed)
        distance = torch.cdist(problem._reference.positions[::10], plain.positions)
        return (sampled.positions - plain.positions)[distance.argmin(1)].numpy()

    coarse, fine = moved(problem.spacing, 0), moved(0.6 * problem.spacing, 7)
    assert np.linalg.norm(coarse - fine) < 0.35 * np.linalg.norm(coarse)


def test_the_model_knows_that_its_body_may_be_distorted(scenes):
    """As that of a reconstruction, by as much as it is, around the distorted one."""
    problem = KnownShape.read(scenes[NULL])
    right, bodies = problem.body, problem.wrong_bodies(problem.body, problem.setting.warp)
    moves = torch.stack([body.positions - right.positions for body in bodies[:24]])
    assert float(moves.square().sum(2).mean(1).sum().sqrt()) == pytest.approx(problem.setting.warp, rel=1e-3)
    assert all(torch.equal(body.positions, right.positions) for body in bodies[-4:])  # denser here than there


def test_scenes_are_drawn_once_and_alike(scenes, tmp_path):
    stamp = (scenes[NULL] / "video.npz").stat().st_mtime_ns
    generate.generate(scenes[NULL].parent, NULL, TINY)
    assert (scenes[NULL] / "video.npz").stat().st_mtime_ns == stamp
    again = generate.generate(tmp_path, NULL, TINY)
    assert (again / "truth.json").read_text() == (scenes[NULL] / "truth.json").read_text()


def test_a_scene_is_diagnosed_scored_and_not_done_again(scenes, tmp_path, small_threads):
    (tmp_path / "candidates.yaml").write_text(CANDIDATES)
    options = Options(str(tmp_path / "candidates.yaml"), replicates=5, effects=1)
    line = run.diagnose_scene(scenes[DRAG], options)
    assert line.startswith("0001: ")
    found = outcome(scenes[DRAG])
    assert found.kind == "missing" and found.found("LinearDrag") and found.top(1)
    assert found.p_value < LEVEL and found.hidden == ("drag",)
    assert set(found.covered) >= {"drag", "E", "nu", "v_x", "v_y", "v_z"}
    assert outcome(scenes[NULL]) is None
    assert run.diagnose_scene(scenes[DRAG], options) == "0001: done before"
    assert "### Single effects at 20 sigma: 1" in page({**made(), "note": "", "outcomes": compact([found])})
