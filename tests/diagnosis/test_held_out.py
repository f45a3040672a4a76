"""Held-out data speak against an effect, decide between effects, and let a verdict that fails be looked at again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis import diagnose
from pacnerf_lpo.diagnosis.diagnose import Options, _number, investigate
from pacnerf_lpo.diagnosis.rounds import Round, verdict
from pacnerf_lpo.diagnosis.screening import FORCE, judge
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.identification.smooth_force import AXES, KNOTS, PARTS
from pacnerf_lpo.inference.checks import Prediction
from pacnerf_lpo.inference.decision import LINEAR, best, log_odds, worth_refitting
from tests.diagnosis import falling
from tests.diagnosis.examples import refit, screening

SIZES = 100, 180


def diagnosed(problem: falling.Falling, folder) -> list[Round]:
    options = Options(falling.listed(folder), replicates=5, effects=1)
    return investigate(problem, Store(folder, b"held", {}), options, lambda _: None)


def test_held_out_data_count_against_an_effect_and_never_for_it():
    found, judged = refit("LinearDrag"), screening(LinearDrag=9.0)
    unheld = replace(found, held=Prediction(0.0, 0.0), held_without=Prediction(0.0, 0.0)).against(
        200.0, (100, 100), judged
    )
    better = replace(found, held=Prediction(30.0, 0.0), held_without=Prediction(300.0, 0.0)).against(
        200.0, SIZES, judged
    )
    worse = replace(found, held=Prediction(160.0, 0.0), held_without=Prediction(80.0, 0.0)).against(
        200.0, SIZES, judged
    )
    wider = replace(found, held=Prediction(80.0, -40.0), held_without=Prediction(80.0, 0.0)).against(
        200.0, SIZES, judged
    )
    assert better.log_bayes_factor == pytest.approx(unheld.log_bayes_factor)
    assert worse.log_bayes_factor < unheld.log_bayes_factor - 10 and worse.p_value > unheld.p_value
    assert wider.log_bayes_factor < unheld.log_bayes_factor - 30


def test_of_two_effects_that_fit_as_well_the_one_that_predicts_is_named():
    fits, predicts = (refit(name, held=Prediction(cost, 0.0)) for name, cost in (("Fits", 90.0), ("Predicts", 60.0)))
    fits = replace(fits, cost=fits.cost - 5.0)
    contenders = [fits.contender, predicts.contender]
    leader = best(contenders, log_odds(contenders, SIZES[1], 1.0))
    assert leader is not None and leader.name == "Predicts"


def test_what_a_straight_line_did_not_lead_to_is_fitted_where_a_verdict_leaves_more(
    monkeypatch, tmp_path, small_threads
):
    """Drag, in a world where only the scores of other effects say that they could win."""

    def misled(scores, threshold, part=LINEAR):
        names = worth_refitting(scores, threshold, part)
        return [name for name in names if name != "LinearDrag" or part < LINEAR]

    falling.install(monkeypatch)
    monkeypatch.setattr(diagnose, "worth_refitting", misled)
    rounds = diagnosed(falling.Falling({"drag": 2.0}), tmp_path)
    assert verdict(rounds).names == ["LinearDrag"] and not verdict(rounds).rest
    assert [found.widened for found in rounds] == [True, False]
    names = {again.name for again in rounds[0].refits}
    assert "LinearDrag" in names and len(names) == len(rounds[0].refits)


def test_rounds_that_explain_all_are_not_widened(monkeypatch, tmp_path, small_threads):
    falling.install(monkeypatch)
    for number, hidden in enumerate(({}, {"drag": 2.0})):
        folder = tmp_path / str(number)
        folder.mkdir()
        rounds = diagnosed(falling.Falling(hidden), folder)
        assert not any(found.widened for found in rounds)
        assert all(np.isfinite(again.held.cost) and again.held.cost >= 0 for again in rounds[0].refits)


def test_held_out_data_speak_against_an_unknown_force(monkeypatch, tmp_path, small_threads):
    """A smooth force that only the fitted views and frames show, against one that all show."""
    falling.install(monkeypatch)
    problem = falling.Falling({})
    options = Options(falling.listed(tmp_path), replicates=5, until="screen")
    (found,) = investigate(problem, Store(tmp_path, b"force", {}), options, lambda _: None)
    assert found.probes is not None
    to_and_fro = np.zeros(found.comparison.force.shape[-1])
    to_and_fro[1 :: len(PARTS) * len(AXES)] = 30.0 * (-1.0) ** np.arange(KNOTS)  # m/s^2 up and down
    change = np.nan_to_num(found.comparison.force @ to_and_fro)
    factors = []
    for shown in (problem.usable, problem.fitted):
        comparison = replace(found.comparison, residual=found.comparison.residual + np.where(shown, change, 0.0))
        force = judge(problem, comparison, found.probes).score(FORCE)
        assert force is not None
        factors.append(force.log_bayes_factor)
    seen_by_all, contradicted = factors
    assert seen_by_all > contradicted + 10


def test_rounds_that_came_about_in_other_ways_have_other_names(monkeypatch, tmp_path, small_threads):
    """Stored steps of a round that was given up are none of one of the same number that takes its place."""
    falling.install(monkeypatch)
    first, second = (diagnosed(falling.Falling({"drag": 2.0}), tmp_path)[0] for _ in range(2))
    names = {_number(3, 0, [first, second])}
    first.widened = True
    names |= {_number(3, 0, [first, second]), _number(3, 1, [first, second])}
    second.left_out["Adhesion"] = "unstable"
    names |= {_number(3, 0, [first, second]), _number(3, 0, [second, first])}
    assert len(names) == 5
