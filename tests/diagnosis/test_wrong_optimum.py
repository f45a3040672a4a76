"""A fit that ends in a wrong optimum is no evidence for an effect whose fit leaves it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnerf_lpo.diagnosis import comparison
from pacnerf_lpo.diagnosis.diagnose import Options, better_model, investigate
from pacnerf_lpo.diagnosis.refitting import better_null
from pacnerf_lpo.diagnosis.rounds import Round, verdict
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.base_fit import refined
from pacnerf_lpo.identification.forward_model import BodyModel
from pacnerf_lpo.identification.multistart import Search
from tests.diagnosis import falling
from tests.diagnosis.examples import refit

RIDGE, WRONG = 7.0, 8.0
"""log10 of a modulus above which a body falls otherwise, and of one with which the difference is least there."""


def path(model: BodyModel, free: np.ndarray) -> torch.Tensor:
    """The motion, of which the modulus has two optima: beyond the ridge the body is held up [m, (F, N, 3)]."""
    beyond = free[model.names.index("E")]
    held = 6.0 + 3.0 * (beyond - WRONG) ** 2 if beyond > RIDGE else 0.0
    times = torch.arange(falling.FRAMES) / falling.RATE
    return falling.motion(model, free) + held / 2 * (times**2)[:, None, None] * torch.tensor([0.0, 1.0, 0.0])


@pytest.fixture
def misled(monkeypatch, small_threads) -> falling.Falling:
    """A recording in which nothing is missing, of a body whose fit begins beyond the ridge and is not searched for."""

    def unsearched(problem, effects, known, *more, **settings):
        return refined(problem, effects, known, Search([], 0, 0), *more, **settings)

    monkeypatch.setattr(comparison, "base_fit", unsearched)
    monkeypatch.setattr(BodyModel, "path", path)
    problem = falling.Falling({})
    problem.first_guess = {**falling.GUESS, "E": 10**WRONG}
    return problem


def diagnosed(problem: falling.Falling, folder, **more) -> list[Round]:
    options = Options(falling.listed(folder), replicates=5, effects=1, **more)
    return investigate(problem, Store(folder, b"folded", {}), options, lambda _: None)


def test_an_effect_that_only_leaves_a_wrong_optimum_is_not_named(misled, tmp_path):
    screened = diagnosed(misled, tmp_path, until="screen")
    assert screened[0].comparison.known["E"] > 10**RIDGE
    rounds = diagnosed(misled, tmp_path)
    assert verdict(rounds).names == []
    assert rounds[0].again == 1
    assert rounds[0].comparison.known["E"] < 10**RIDGE
    assert rounds[0].comparison.cost < 0.5 * screened[0].comparison.cost


def test_a_better_optimum_that_cannot_be_examined_still_counts(misled, tmp_path, monkeypatch):
    """Replicates at the better optimum, on finer grids, are unstable: the round stays, and names nothing."""
    fine = 0.95 * falling.SPACING

    def unstable(model: BodyModel, free: np.ndarray) -> torch.Tensor:
        if model.body.spacing < fine and free[model.names.index("E")] < RIDGE:
            raise SimulationError(3, 1, "made unstable by a test")
        return path(model, free)

    monkeypatch.setattr(BodyModel, "path", unstable)
    rounds = diagnosed(misled, tmp_path)
    assert verdict(rounds).names == [] and rounds[0].comparison.known["E"] > 10**RIDGE
    assert rounds[0].refits[0].cost_without < 0.5 * rounds[0].comparison.cost


def test_once_a_round_may_not_begin_again_evidence_is_counted_against_the_best_optimum(misled, tmp_path, monkeypatch):
    for module in ("diagnose", "competition"):
        monkeypatch.setattr(f"pacnerf_lpo.diagnosis.{module}.MOST_AGAIN", 0)
    rounds = diagnosed(misled, tmp_path)
    assert len(rounds) == 1 and rounds[0].accepted is None
    assert len({again.cost_without for again in rounds[0].refits}) == 1
    assert rounds[0].refits[0].cost_without < 0.5 * rounds[0].comparison.cost


def test_the_optimum_of_a_larger_model_is_a_start_for_a_smaller_one(misled, tmp_path):
    wrong = diagnosed(misled, tmp_path, until="screen")[0]
    fitted, mask = wrong.comparison, misled.fitted
    told = misled, (), fitted
    cost, known, held, _ = better_null(*told, {**falling.TRUTH, "drag": 0.1}, fitted.cost, mask)
    assert known is not None and known["E"] < 10**RIDGE
    assert cost < 0.5 * fitted.cost
    assert held is not None and held.cost < 2 * (misled.usable & ~mask).sum()
    assert better_null(*told, fitted.known, fitted.cost, mask)[:2] == (pytest.approx(fitted.cost), None)


def test_the_first_round_that_a_better_optimum_concerns_begins_again(misled, tmp_path):
    """A second round that found it, and a first one whose model it contains: both had missed it."""
    first = diagnosed(misled, tmp_path, until="screen")[0]
    second = diagnosed(misled, tmp_path, until="screen")[0]
    assert better_model(misled, [first]) is None
    second.refits = [refit("LinearDrag", better={**falling.TRUTH, "drag": 0.1})]
    place, known = better_model(misled, [first, second]) or (-1, {})
    assert place == 0 and known["E"] < 10**RIDGE


def test_a_model_that_is_at_its_optimum_is_not_begun_again(tmp_path, monkeypatch, small_threads):
    falling.install(monkeypatch)
    rounds = diagnosed(falling.Falling({"drag": 2.0}), tmp_path)
    assert verdict(rounds).names == ["LinearDrag"]
    assert [found.again for found in rounds] == [0, 0]
