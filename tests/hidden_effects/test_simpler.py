"""The rules that the diagnosis is compared with."""

from __future__ import annotations

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.comparison import compare, intervals
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.screening import probe
from pacnerf_lpo.identification.problem import Problem
from tests.diagnosis import falling
from tests.diagnosis.examples import refit
from validation.hidden_effects.simpler import RULES, verdicts

pytestmark = pytest.mark.slow

CANDIDATES = [falling.candidate(name) for name in ("LinearDrag", "UniformForce")]


@pytest.fixture(scope="module")
def stable():
    with pytest.MonkeyPatch.context() as patch:
        falling.install(patch)
        yield


def round_of(problem: Problem, known: dict[str, float]) -> Round:
    comparison = compare(problem, (), known, (6, 1), False, lambda _: None)
    told = intervals(problem, (), comparison)
    probes = probe(problem, (), comparison, CANDIDATES, lambda _: None)
    return Round((), comparison, *comparison.checks(problem), *told, [], probes=probes)


def test_both_rules_name_a_strong_effect_and_nothing_where_there_is_none(stable, small_threads):
    for hidden, kind, names in (({"drag": 2.0}, "missing", ["LinearDrag"]), ({}, "nothing", [])):
        problem = falling.Falling(hidden)
        found = verdicts(problem, [round_of(problem, problem.first_guess)])
        assert found == {rule: {"kind": kind, "effects": names} for rule in RULES}, hidden


def test_a_rule_goes_on_only_with_what_the_diagnosis_has_chosen(stable, small_threads):
    problem = falling.Falling({"drag": 2.0})
    found = round_of(problem, problem.first_guess)
    for accepted, expected in (("LinearDrag", 2 * ["LinearDrag"]), ("UniformForce", ["LinearDrag"])):
        found.accepted = refit(accepted)
        assert verdicts(problem, [found, found])["BIC"]["effects"] == expected


def test_what_no_candidate_explains_is_unknown(stable, small_threads):
    problem = falling.Falling({"drag": 2.0})
    found = round_of(problem, problem.first_guess)
    found.probes.hypotheses.clear()
    assert np.isfinite(found.comparison.cost)
    assert {said["kind"] for said in verdicts(problem, [found]).values()} == {"unknown"}
