"""Scores of all hypotheses at a fitted model, an effect that later ones make superfluous, and a smooth force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2, f

from pacnerf_lpo.diagnosis.comparison import Comparison, compare, intervals, solver_errors
from pacnerf_lpo.diagnosis.refitting import refit
from pacnerf_lpo.diagnosis.removal import without_each
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.screening import EFFICIENCY, FORCE, Usual, usual_faults
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.layout import Layout
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.mpm.effects import LinearDrag, UniformForce
from pacnerf_lpo.mpm.effects.base import Effect
from tests.diagnosis import falling
from tests.diagnosis.examples import screened

pytestmark = pytest.mark.slow

DRAG = 2.0
BOTH = [falling.candidate(name) for name in ("LinearDrag", "UniformForce")]
HELD = falling.candidate("CameraShift@2")


def compared(problem: falling.Falling, effects: tuple[Effect, ...] = ()) -> Comparison:
    known = {**problem.first_guess, **{name: value for effect in effects for name, value in effect.guess.items()}}
    return compare(problem, effects, known, (12, 1), False, lambda _: None)


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


def test_a_solver_that_errs_like_a_change_of_a_velocity_moves_it_by_as_much(fitted):
    problem, comparison = fitted
    place = comparison.names.index("v_x")
    errs = comparison.jacobian[..., [place, place]] * [0.03, -0.04]
    own = {one.name: one for one in intervals(problem, (), comparison)[0]}
    wrong = replace(comparison, errors=replace(comparison.errors, solver=errs))
    found = solver_errors(problem, (), wrong, list(own.values()))
    assert found["v_x"].shift == pytest.approx(0.05, rel=0.02)
    assert found["v_z"].shift < 0.001
    x, with_solver = own["v_x"], found["v_x"]
    half = np.hypot(x.high - x.value, 1.645 * 0.05)  # errors of the solver are presumed, and so normal
    assert with_solver.high - x.value == pytest.approx(half, rel=0.02)
    assert x.value - with_solver.low == pytest.approx(with_solver.high - x.value, rel=1e-6)
    assert found["v_z"].low == pytest.approx(own["v_z"].low, abs=0.1 * own["v_z"].error)


@pytest.mark.parametrize(("young", "times"), [(7e4, 1), (2e6, 2)])
def test_errors_are_learnt_again_where_the_fit_has_moved_far(stable, young: float, times: int, small_threads):
    problem, told = falling.Falling({}), list[str]()
    known = {**problem.first_guess, "E": young}
    found = compare(problem, (), known, (6, 1), False, told.append)
    assert sum(line.startswith("replicate 1 of") for line in told) == times
    assert [found.known[name] for name in ("v_x", "v_y")] == pytest.approx([0.4, -1.0], abs=0.02)


def test_the_hidden_effect_is_ranked_first_with_its_size(fitted, small_threads):
    problem, comparison = fitted
    found = screened(problem, (), comparison, [*BOTH, HELD])
    best = next(one for one in found.scores if one.name != FORCE)
    assert best.name == "LinearDrag" and found.p_value(best.log_bayes_factor) < LEVEL
    assert abs(best.coefficient[0] - DRAG) < DRAG / 10  # by a straight line
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
    assert problem.of_all_cameras[2].any() and not comparison.fitted[2].any()
    assert (problem.fitted_with([HELD.effect]) == problem.of_all_cameras).all()
    assert (problem.fitted_with([BOTH[0].effect]) == problem.fitted).all()
    shift = found.score("CameraShift@2")
    assert shift is not None and found.p_value(shift.log_bayes_factor) > LEVEL


def test_a_model_with_a_fault_of_the_held_out_camera_is_fitted_to_what_that_saw(stable, small_threads):
    """Else nothing would tell its size: it would drift, and be taken back as superfluous."""
    shift = {"shift_x_view2": 0.06, "shift_y_view2": -0.04}
    problem = falling.Falling(shift)
    found = compared(problem, (HELD.effect,))
    assert {name: found.known[name] for name in shift} == pytest.approx(shift, abs=0.01)
    assert (found.fitted == problem.of_all_cameras).all()


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
    assert [look.effect for look in without_each(problem, found) if look.superfluous] == [effects[1]]


VIEWS, FRAMES = 6, 10


def white_noise() -> NoiseModel:
    """One kind of data in six views and ten frames, with a noise of 1."""
    view, frame = np.divmod(np.arange(VIEWS * FRAMES), FRAMES)
    replicates = np.random.default_rng(1).standard_normal((20, VIEWS * FRAMES))
    return NoiseModel.from_replicates(replicates, np.ones(VIEWS * FRAMES), Layout(view, frame, np.full(len(view), "x")))


def usual(noise: NoiseModel, residual: np.ndarray, columns: np.ndarray) -> list[float]:
    """Of a shift of each view."""
    faults = [
        Hypothesis(f"CameraShift@{view}", (column[:, None],), (np.ones(1),)) for view, column in enumerate(columns)
    ]
    others = [Hypothesis("LinearDrag", (np.ones((VIEWS * FRAMES, 1)),), (np.ones(1),))]
    found = usual_faults(noise, residual, [*faults, *others], dict.fromkeys([f.name for f in [*faults, *others]], 1.0))
    assert set(found) == {fault.name for fault in faults}
    return [one.scale for one in found.values()]


def test_the_usual_fault_of_a_camera_is_that_of_the_others():
    noise, shifts = white_noise(), np.kron(np.eye(VIEWS), np.ones(FRAMES))
    sizes = 3.0 * np.sqrt(chi2.median(1)) * np.array([1, -1, 1, 1, -1, -1])
    everywhere = noise.mean + sizes / np.linalg.norm(noise.whiten(shifts.T), axis=0) @ shifts
    assert usual(noise, everywhere, shifts) == pytest.approx(VIEWS * [3.0], rel=0.1)
    assert usual(noise, noise.mean, shifts) == VIEWS * [1.0]
    assert usual(noise, everywhere, shifts[:4]) == 4 * [1.0]  # too few others
    assert usual(noise, everywhere, shifts[:0]) == []


def test_a_fault_among_few_cameras_is_believed_as_late_as_it_is_rare():
    """Drawn as it is assumed: replicates' variance of 1, cameras' of 3, a fault of two numbers. Satterthwaite's tails
    are up to twice too heavy.
    """
    random, draws, dof, others = np.random.default_rng(2), 200_000, 21.0, 10
    told = EFFICIENCY * others
    scale = np.sqrt(random.chisquare(dof, draws) / dof + 3 * random.chisquare(told, draws) / told)
    squares, rare = 4 * random.chisquare(2, draws) / 2, f.isf(0.01, 2, dof)

    def believed(square: float) -> float:
        return square / Usual(2.0, others, square, 2).factor(dof) ** 2 - rare

    edge = brentq(believed, 4.0, 4e3) / 4
    assert 0.004 < np.mean(squares / scale**2 > edge) < 0.011
    assert np.mean(squares / scale**2 > rare) > 0.02
    assert Usual(1.0, others, 50.0, 2).factor(dof) == 1.0


def test_a_fault_that_shows_in_all_cameras_is_no_usual_one():
    """The fitted motion gives way to the fault of one camera by a sixth, and so all others are off by that."""
    noise, shifts = white_noise(), np.kron(np.eye(VIEWS), np.ones(FRAMES))
    given_way = shifts - shifts.mean(0)
    found = usual(noise, noise.mean + 20.0 * given_way[2], given_way)
    assert found[2] == pytest.approx(1.0) and min(found[:2] + found[3:]) > 3


def test_fits_see_the_motion_that_tests_install(stable):
    """Not the simulator's."""
    problem = falling.Falling({})
    model: Model = problem.model((), problem.first_guess)
    assert model.path(model.start).numpy() == pytest.approx(falling.motion(model, model.start).numpy())
