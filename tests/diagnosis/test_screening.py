"""Scores of all hypotheses at a fitted model, an effect that later ones make superfluous, and a smooth force."""

from __future__ import annotations

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison, compare, intervals
from pacnerf_lpo.diagnosis.refitting import refit
from pacnerf_lpo.diagnosis.removal import superfluous
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.screening import FORCE, fitted_by, usual_fault
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.mpm.effects import LinearDrag, UniformForce
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.render.camera_faults import CameraShift
from tests.diagnosis import falling
from tests.diagnosis.examples import score, screened

pytestmark = pytest.mark.slow

DRAG = 2.0
BOTH = [falling.candidate(name) for name in ("LinearDrag", "UniformForce")]
HELD = Candidate("CameraShift@2", CameraShift(view=2))


def compared(problem: falling.Falling, effects: tuple[Effect, ...] = ()) -> Comparison:
    known = {**problem.first_guess, **{name: value for effect in effects for name, value in effect.guess.items()}}
    return compare(problem, effects, known, (6, 1), False, lambda _: None)


@pytest.fixture(scope="module")
def stable():
    with pytest.MonkeyPatch.context() as patch:
        falling.install(patch)
        yield


@pytest.fixture(scope="module")
def fitted(stable) -> tuple[falling.Falling, Comparison]:
    """A ball with drag, fitted without it."""
    problem = falling.Falling({"drag": DRAG})
    return problem, compared(problem)


def test_the_hidden_effect_is_ranked_first_with_its_size(fitted, small_threads):
    problem, comparison = fitted
    found = screened(problem, (), comparison, [*BOTH, HELD])
    best = next(one for one in found.scores if one.name != FORCE)
    assert best.name == "LinearDrag" and found.p_value(best.log_bayes_factor) < LEVEL
    assert DRAG / 2 < best.coefficient[0] < DRAG  # a straight line: so strong a drag bends
    again = refit(problem, (), comparison, BOTH[0], found, lambda _: None)
    assert again is not None
    (drag,) = (one for one in again.intervals if one.name == "drag")
    assert drag.low < DRAG < drag.high and drag.high - drag.low < 0.4 * DRAG
    assert [one.log_bayes_factor for one in found.scores] == sorted(
        (one.log_bayes_factor for one in found.scores), reverse=True
    )
    assert found.correlations.shape == (len(found.scores),) * 2
    assert np.diag(found.correlations) == pytest.approx(1.0)
    # a fault of the held-out camera competes with all others, and is fitted to what that camera saw
    assert found.outside == ["CameraShift@2"]
    assert fitted_by(problem, True)[2].any() and not fitted_by(problem, False)[2].any()
    shift = found.score("CameraShift@2")
    assert shift is not None and found.p_value(shift.log_bayes_factor) > LEVEL


def test_an_unstable_probe_is_left_out_and_so_is_a_candidate_without_any(fitted, monkeypatch, small_threads):
    problem, comparison = fitted
    falling.install(monkeypatch, lambda model, _: "drag" in model.names)
    found = screened(problem, (), comparison, BOTH)
    assert found.score("LinearDrag") is None and found.score("UniformForce") is not None
    assert found.scale("LinearDrag") == found.usual_scale
    assert refit(problem, (), comparison, BOTH[0], found, lambda _: None) is None


def test_a_fitted_model_that_is_unstable_cannot_be_screened(fitted, monkeypatch, small_threads):
    problem, comparison = fitted
    falling.install(monkeypatch, lambda *_: True)
    with pytest.raises(SimulationError):
        screened(problem, (), comparison, BOTH)


def test_an_effect_is_superfluous_only_where_its_coefficient_is_at_its_null(fitted, small_threads):
    """Drag and wind fitted to a ball with drag alone."""
    problem, _ = fitted
    effects = LinearDrag(1.5), UniformForce()
    comparison = compared(problem, effects)
    screening = screened(problem, effects, comparison, [])
    told = intervals(problem, effects, comparison)
    found = Round(effects, comparison, *comparison.checks(problem), *told, [], screening=screening)
    assert superfluous(problem, found) == [effects[1]]


def test_the_usual_fault_of_a_camera_is_the_median_of_its_kind():
    """A gain of the cost is the square of a deviate; the median deviate of normal ones is 0.6745."""
    names = [f"CameraShift@{view}" for view in range(5)]
    scores = [score(name, 1.0) for name in names]
    assert usual_fault(scores, names[0]) == pytest.approx(3.0 / 0.6745)
    assert usual_fault(scores[:3], names[0]) == 1.0  # too few
    assert usual_fault(scores, "LinearDrag") == 1.0 and usual_fault(scores, "CameraDrift@1") == 1.0


def test_fits_see_the_motion_that_tests_install(stable):
    """Not the simulator's."""
    problem = falling.Falling({})
    model: Model = problem.model((), problem.first_guess)
    assert model.path(model.start).numpy() == pytest.approx(falling.motion(model, model.start).numpy())
