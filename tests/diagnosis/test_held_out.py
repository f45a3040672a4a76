"""Held-out data speak for or against an effect, decide between effects, and make a verdict that fails look again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis import competition
from pacnerf_lpo.diagnosis.diagnose import Options, _number, investigate
from pacnerf_lpo.diagnosis.refitting import Refit
from pacnerf_lpo.diagnosis.rounds import Round, verdict
from pacnerf_lpo.diagnosis.screening import FORCE, judge
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.identification.smooth_force import AXES, KNOTS, PARTS
from pacnerf_lpo.inference.checks import Prediction
from pacnerf_lpo.inference.decision import LINEAR, best, log_odds, worth_refitting
from tests.diagnosis import falling
from tests.diagnosis.examples import refit, screening

SIZE = 180


def diagnosed(problem: falling.Falling, folder) -> list[Round]:
    options = Options(falling.listed(folder), replicates=5, effects=1)
    return investigate(problem, Store(folder, b"held", {}), options, lambda _: None)


def test_held_out_data_count_as_the_fitted_ones_do():
    """They may speak for an effect, against it, and against parameters that they would have to determine; alone, they
    name nothing.
    """
    found, judged = refit("LinearDrag"), screening(LinearDrag=9.0)

    def scored(with_it: Prediction, without: Prediction) -> Refit:
        return replace(found, held=with_it).against(200.0, without, judged)

    alike = scored(Prediction(80.0, 0.0), Prediction(80.0, 0.0))
    better, worse = scored(Prediction(30.0, 0.0), Prediction(80.0, 0.0)), scored(Prediction(160.0, 0.0), alike.held)
    gain = SIZE / 2 * (np.log1p((280 - 90) / 1.44 / SIZE) - np.log1p((280 - 140) / 1.44 / SIZE))
    assert better.log_bayes_factor == pytest.approx(alike.log_bayes_factor + gain) and better.p_value < alike.p_value
    assert worse.log_bayes_factor < alike.log_bayes_factor - 10 and worse.p_value > alike.p_value
    wider = scored(Prediction(80.0, -40.0), alike.held)
    assert wider.log_bayes_factor == pytest.approx(alike.log_bayes_factor - 40)
    alone = replace(found, cost=199.0, held=Prediction(10.0, 0.0)).against(200.0, alike.held, judged)
    assert alone.log_bayes_factor < found.occam + 1.0 and alone.p_value > 0.4


def test_of_two_effects_that_fit_as_well_the_one_that_predicts_is_named():
    fits, predicts = (refit(name, held=Prediction(cost, 0.0)) for name, cost in (("Fits", 90.0), ("Predicts", 60.0)))
    fits = replace(fits, cost=fits.cost - 5.0)
    contenders = [fits.contender, predicts.contender]
    leader = best(contenders, log_odds(contenders, SIZE, 1.0))
    assert leader is not None and leader.name == "Predicts"


def test_what_a_straight_line_did_not_lead_to_is_fitted_where_a_verdict_leaves_more(
    monkeypatch, tmp_path, small_threads
):
    """Drag, in a world where only the scores of other effects say that they could win."""

    def misled(scores, threshold, part=LINEAR):
        names = worth_refitting(scores, threshold, part)
        return [name for name in names if name != "LinearDrag" or part < LINEAR]

    falling.install(monkeypatch)
    monkeypatch.setattr(competition, "worth_refitting", misled)
    rounds = diagnosed(falling.Falling({"drag": 2.0}), tmp_path)
    assert verdict(rounds).names == ["LinearDrag"] and not verdict(rounds).more_than_noise
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
    to_and_fro = np.zeros(found.comparison.errors.force.shape[-1])
    to_and_fro[1 :: len(PARTS) * len(AXES)] = 30.0 * (-1.0) ** np.arange(KNOTS)  # m/s^2 up and down
    change = np.nan_to_num(found.comparison.errors.force @ to_and_fro)
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
    names |= {_number(3, 0, [first, second], "LinearDrag")}
    assert len(names) == 6
