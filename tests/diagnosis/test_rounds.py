"""What a round compares with what, and residuals in which a fault of one camera is judged."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from pacnerf_lpo.diagnosis.statistics.acceptance import HeldOut
from pacnerf_lpo.diagnosis.verdict import removed_by, unexplained, verdict

from pacnerf_lpo.diagnosis.catalogue import Candidate, name_of
from pacnerf_lpo.diagnosis.diagnose import lookalikes, ranked, rival
from pacnerf_lpo.diagnosis.refitting import worth_refitting
from pacnerf_lpo.diagnosis.rounds import asks_for_an_effect, left_over
from pacnerf_lpo.diagnosis.screening import Screening
from pacnerf_lpo.identification.problem import absolute, relative
from pacnerf_lpo.mpm.effects import (
    DensityGradient,
    GravityMagnitude,
    InitialSpin,
    KelvinVoigt,
    LinearDrag,
    QuadraticDrag,
    StiffnessGradient,
    UniformForce,
    YieldStress,
)
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.render.camera_faults import (
    CameraRotation,
    CameraShift,
    TimeOffset,
)


def refitted(effect: Effect, removed: float, accepted: bool = True, misfit: float = 100.0) -> SimpleNamespace:
    verdict = SimpleNamespace(accepted=accepted, removed=removed)
    return SimpleNamespace(candidate=Candidate(name_of(effect), effect), verdict=verdict, misfit=misfit)


def screened(p_values: dict[str, float]) -> Screening:
    """A ranking in which every effect is a class of its own."""
    scores = [SimpleNamespace(name=name) for name in p_values]
    return Screening(scores, list(p_values.values()), {}, 4.0, [(name,) for name in p_values], np.eye(len(p_values)))


def test_only_misfits_of_the_same_data_are_compared():
    camera, wind = refitted(CameraShift(view=2), 0.95), refitted(UniformForce(), 0.6)
    drag, rejected = refitted(LinearDrag(), 0.8), refitted(LinearDrag(), 0.99, accepted=False)
    assert rival([camera, wind, drag, rejected], wind.candidate) is drag
    assert rival([camera, rejected], drag.candidate) is None
    assert rival([camera, drag], camera.candidate) is None


def test_of_effects_that_remove_as_much_that_comes_first_which_fits_best():
    gravity, drag = refitted(GravityMagnitude(), 0.930, misfit=1660), refitted(LinearDrag(), 0.925, misfit=1203)
    wind, camera = refitted(UniformForce(), 0.90, misfit=900), refitted(CameraShift(view=2), 0.99, misfit=10)
    rejected = refitted(QuadraticDrag(), 0.93, accepted=False, misfit=1)
    assert ranked([camera, wind, gravity, rejected, drag]) == [drag, gravity, wind, camera]
    assert ranked([refitted(CameraShift(view=1), 0.5), camera])[0] is camera


def test_the_best_are_refitted_whatever_their_score_where_the_residual_is_more_than_noise():
    effects = LinearDrag(), CameraShift(view=2), GravityMagnitude(), UniformForce(), InitialSpin(), YieldStress()
    candidates = [Candidate(name_of(effect), effect) for effect in effects]
    drag, camera, gravity, wind, _, plastic = candidates
    ranking = screened(dict(zip([c.name for c in candidates], [0.001, 0.02, 0.03, 0.2, 0.5, 0.9], strict=True)))
    assert worth_refitting(candidates, ranking) == [drag, plastic]  # an alternative of kind is refitted always
    assert worth_refitting(candidates, ranking, 3) == [drag, gravity, wind, plastic]
    assert worth_refitting(candidates, screened({"LinearDrag": 1.0}), 3) == [drag, plastic]
    faulty = screened({"CameraShift@2": 0.001, "LinearDrag": 0.4})
    assert worth_refitting(candidates, faulty, 1) == [camera, drag, plastic]
    assert [ranking.names(candidate) for candidate in candidates] == [True, False, False, False, False, False]
    assert not screened({"YieldStress": 0.001}).names(plastic)  # says little of it


def test_neighbours_of_the_best_are_tried_though_no_score_names_them():
    stiff, spin, drag = (Candidate(name_of(e), e) for e in (StiffnessGradient(), InitialSpin(), LinearDrag()))
    heavy = refitted(DensityGradient(), 0.9)
    assert lookalikes([heavy, refitted(LinearDrag(), 0.5)], [drag, spin, stiff]) == [spin, stiff]
    assert lookalikes([heavy], []) == []
    assert lookalikes([refitted(DensityGradient(), 0.9, accepted=False)], [spin, stiff]) == []
    assert lookalikes([refitted(KelvinVoigt(), 0.9)], [drag]) == [drag]  # viscosity says so of drag,
    assert lookalikes([refitted(LinearDrag(), 0.9)], [Candidate("KelvinVoigt", KelvinVoigt())])  # which does not of it


def test_neighbours_of_a_wrong_camera_are_those_of_the_same_camera():
    shifted = refitted(CameraShift(view=1), 0.9)
    others = [Candidate(name_of(e), e) for e in (TimeOffset(view=2), TimeOffset(view=1), UniformForce())]
    assert lookalikes([shifted], others) == [others[1]]
    turned = refitted(CameraRotation(view=1), 0.9)
    assert lookalikes([turned], others) == []  # a uniform force is fitted to other frames


def foretold(share: float, z: float = 8.0, before: float = 3.0) -> HeldOut:
    """What a force does in the held-out views, whose noise is 1."""
    return HeldOut(before, before - share * abs(before - 1.0), 1.0, (3, 4), z, 2.1)


def passed(
    accepted: SimpleNamespace | None,
    p_fitted: float,
    p_held: float,
    above: float = 0.1,
    moved: float | None = None,
    beside: HeldOut | None = None,
) -> SimpleNamespace:
    omnibus, held = SimpleNamespace(p_value=p_fitted), SimpleNamespace(p_value=p_held, statistic=1.0, twins=[0.9, 1.1])
    excess = {"fitted": -0.01, "held": above}
    force = None if moved is None else SimpleNamespace(explained=moved, held=beside or foretold(0.5))
    return SimpleNamespace(accepted=accepted, omnibus=omnibus, held=held, excess=excess, force=force)


def test_effects_that_remove_too_little_do_not_explain_what_is_more_than_noise():
    spin, wind = refitted(LinearDrag(), 0.34), refitted(UniformForce(), 0.3)
    first, noisy, quiet = passed(spin, 1e-5, 1e-5), passed(None, 0.3, 0.01), passed(None, 0.3, 0.3)
    assert unexplained([first, noisy])
    assert not unexplained([first, quiet])
    assert not unexplained([first, passed(wind, 0.3, 0.01), noisy])  # both remove 54 % together
    assert not unexplained([passed(refitted(LinearDrag(), 0.6), 1e-5, 1e-5), noisy])
    assert not unexplained([passed(None, 0.01, 0.1, above=-0.1)])  # no larger than the errors of twins
    assert not unexplained([noisy])  # nothing accepted, and the fitted data are noise


def test_what_an_effect_removes_is_told_by_the_next_pass_in_units_of_its_own_noise():
    first, noisy = passed(refitted(LinearDrag(), 0.34), 1e-5, 1e-5), passed(None, 0.3, 0.01)
    first.held.statistic, noisy.held.statistic, noisy.held.twins = 5.0, 1.4, [0.6]
    assert removed_by([first, noisy]) == pytest.approx(0.8) and not unexplained([first, noisy])
    noisy.held.statistic = 3.6
    assert removed_by([first, noisy]) == pytest.approx(0.25) and unexplained([first, noisy])
    noisy.held.statistic = 0.4
    assert removed_by([first, noisy]) == 1.0
    assert removed_by([]) == 0.0
    assert removed_by([first]) == pytest.approx(0.34)  # no pass after
    first.held.statistic = 0.9
    assert removed_by([first, noisy]) == pytest.approx(0.34)  # was not above the noise
    camera = passed(refitted(CameraShift(view=2), 0.95), 1e-5, 1e-5)
    camera.held.statistic = 5.0
    assert removed_by([camera, noisy]) == pytest.approx(0.95)  # relative to frame 0 a shift does not show


def test_what_leaves_much_more_than_noise_is_no_explanation():
    """Nine tenths may be removed of a very large error, and the rest be far beyond what noise leaves."""
    first, last = passed(refitted(UniformForce(), 0.9), 1e-5, 1e-5), passed(None, 0.003, 1e-9)
    first.held.statistic = 100.0
    for statistic, beyond in ((3.9, False), (4.1, True)):
        last.held.statistic = statistic
        assert unexplained([first, last]) is beyond and removed_by([first, last]) > 0.95
    faithful = passed(None, 0.07, 1e-9)  # fits its own data
    faithful.held.statistic = 6.0
    assert asks_for_an_effect(faithful) and unexplained([faithful])
    faithful.held.p_value = 0.01
    assert not asks_for_an_effect(faithful) and not unexplained([faithful])  # may be an accident


def test_a_residual_that_a_smooth_force_removes_is_missing_physics():
    wind = refitted(UniformForce(), 0.8)
    assert unexplained([passed(wind, 1e-5, 1e-5), passed(None, 0.01, 0.01, moved=0.75)])
    assert not unexplained([passed(wind, 1e-5, 1e-5), passed(None, 0.01, 0.01, moved=0.4)])  # of a reconstruction
    assert not unexplained([passed(wind, 1e-5, 1e-5), passed(None, 0.3, 0.3, moved=0.75)])  # noise
    assert unexplained([passed(None, 0.01, 0.1, moved=0.8)])
    assert not unexplained([passed(None, 0.01, 0.1, moved=0.6)])
    assert unexplained([passed(None, 0.01, 0.1, above=-0.1, moved=0.8)])
    assert not unexplained([passed(None, 0.01, 0.1, above=-0.1, moved=0.4)])
    assert not unexplained([passed(None, 0.01, 0.3, moved=0.8)])  # the held-out data do not agree


def test_a_force_has_to_foretell_the_views_that_it_was_not_fitted_to():
    noisy = partial(passed, None, 0.01, 0.01, moved=0.75)
    assert unexplained([noisy(beside=foretold(0.3))])
    assert not unexplained([noisy(beside=foretold(0.2))])
    assert not unexplained([noisy(beside=foretold(-0.5))])
    assert not unexplained([noisy(beside=foretold(0.3, z=2.0))])
    assert unexplained([noisy(beside=foretold(0.3, z=8.0, before=0.9))])  # stands out of an error that is noise
    assert not unexplained([noisy(beside=foretold(0.3, z=4.0, before=0.9))])


@pytest.mark.parametrize(
    ("p_fitted", "p_held", "above", "moved", "kind", "rest", "said"),
    [
        (0.3, 0.01, 0.1, None, "nothing", False, "no more than its own numerical error"),
        (0.3, 1e-6, 0.1, None, "nothing", True, "does not hold in the views and frames kept aside"),
        (0.3, 1e-6, -0.1, None, "nothing", False, "no more than its own numerical error"),  # nor is it larger
        (0.01, 0.01, 0.1, 0.5, "nothing", True, "like an error of the reconstruction or of a camera"),
        (0.01, 0.01, 0.1, 0.8, "unknown", False, "none of the known effects"),
        (0.01, 0.01, 0.1, None, "unfinished", False, "more than the model's own numerical error"),
    ],
)
def test_without_an_effect_the_verdict_depends_on_what_the_residual_looks_like(
    p_fitted, p_held, above, moved, kind, rest, said
):
    only = passed(None, p_fitted, p_held, above, moved)
    only.screening, only.refits = SimpleNamespace(p_values=[0.5]), []
    if only.force is not None:
        only.force.law = SimpleNamespace(terms=[], explained=0.0)
    found = verdict(None, [only])
    assert (found["kind"], found["rest"], found["effects"]) == (kind, rest, [])
    assert said in found["sentence"]


@pytest.mark.parametrize(
    ("effect", "scores", "omnibus", "said"),
    [
        (LinearDrag(), {"LinearDrag": 0.002, "KelvinVoigt": 0.001}, 0.15, "p = 0.002"),
        (LinearDrag(), {"LinearDrag": 0.3, "KelvinVoigt": 0.001}, 0.15, "p = 0.002"),  # its neighbour's made it one
        (LinearDrag(), {"LinearDrag": 0.3}, 0.01, "p = 0.02"),  # what is left over did
        (YieldStress(), {"YieldStress": 0.002}, 0.15, "p = 0.004"),  # the smaller of two
        (YieldStress(), {"YieldStress": 1.0}, 0.01, "p = 0.02"),  # its score at the null says little
        (YieldStress(), {"YieldStress": 0.3, "KelvinVoigt": 0.001}, 0.15, "p = 0.002"),  # another's made it a candidate
        (YieldStress(), {"YieldStress": 0.3, "CameraShift@2": 0.001}, 0.15, "p = 0.3"),  # no effect on the body
    ],
)
def test_what_no_score_names_is_as_rare_as_what_stands_out_or_as_the_residual(effect, scores, omnibus, said):
    found = passed(refitted(effect, 0.8), omnibus, 1.0)
    name = found.accepted.candidate.name
    found.candidates = [Candidate(name, effect), Candidate("KelvinVoigt", KelvinVoigt())]
    found.candidates.append(Candidate("CameraShift@2", CameraShift(view=2)))
    found.screening, found.refits = screened(scores), [found.accepted]
    found.accepted.known, found.parameters = {}, []
    last = passed(None, 0.5, 0.5)
    last.comparison = SimpleNamespace(known={})
    problem = SimpleNamespace(physics=SimpleNamespace(parameters={}, material=SimpleNamespace(free_names=())))
    result = verdict(problem, [found, last])
    assert result["effects"] == [name]
    assert said in result["sentence"]


def test_what_accepted_effects_leave_is_more_than_noise_in_either_data_and_in_pixels():
    assert left_over(passed(None, 0.3, 0.01)) and left_over(passed(None, 0.01, 0.3))
    assert not left_over(passed(None, 0.3, 0.3))
    assert not left_over(passed(None, 0.01, 0.01, above=-0.1))
    assert not left_over(passed(refitted(LinearDrag(), 0.6), 0.01, 0.01))  # what it leaves is not known yet


def test_a_constant_shift_of_one_camera_shows_in_every_frame():
    """Relative to frame 0 it shows there alone; beside it, what moves the same in all views stays as it is."""
    random = np.random.default_rng(0)
    moved = np.cumsum(random.standard_normal((1, 6, 11)), axis=1) * np.ones((4, 1, 1))
    moved -= moved[:, :1]
    shifted = moved.copy()
    shifted[2, :, 0] += 1.5
    seen = relative(shifted)
    assert seen[2, 1:, 0] == pytest.approx(moved[2, 1:, 0]) and seen[2, 0, 0] == pytest.approx(1.5)
    found = absolute(seen, 2)
    assert found[2, 1:, 0] == pytest.approx(moved[2, 1:, 0] + 1.5)
    assert found[[0, 1, 3]] == pytest.approx(seen[[0, 1, 3]])
    seen[2, 0] = np.nan
    assert np.isfinite(absolute(seen, 2)[2, 1:]).all()
