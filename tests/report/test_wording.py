"""Sentences of the verdict agree with the numbers of the rounds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.comparison import Error
from pacnerf_lpo.diagnosis.rounds import Verdict
from pacnerf_lpo.diagnosis.screening import SHAPE
from pacnerf_lpo.inference.checks import Check
from pacnerf_lpo.inference.force_law import Law, Term
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.mpm.effects import LinearDrag
from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.report import wording

DRAG = Term("velocity", -1.5, "1/s", -1.7, -1.3, 1.0, 0.9)
MATERIAL = NeoHookean(E=5e4, nu=0.3)
FINE, POOR = 0.5, 1e-4


def check(statistic: float, p_value: float) -> Check:
    return Check(statistic, np.ones(8), p_value)


class Shape:
    """A screening of errors of the shape alone."""

    def __init__(self, p_value: float):
        self.found = p_value

    def score(self, name: str) -> Any:
        return SimpleNamespace(log_bayes_factor=9.0) if name == SHAPE else None

    def p_value(self, log_bayes_factor: float) -> float:
        return self.found


def a_round(fitted: float = FINE, held: float = FINE, accepted: Any = None, **more: Any) -> Any:
    candidate = SimpleNamespace(observes=False, effect=LinearDrag())
    fitted_model = SimpleNamespace(known={"E": 7e4, "nu": 0.3}, notes=())
    entries = {
        "check": check(3.0, fitted),
        "held": check(5.0, held),
        "errors": (Error(4.0, 2.0),),
        "accepted": accepted,
        "indistinguishable": [] if accepted is None else [accepted.name],
        "proposals": [],
        "removed": [],
        "force": None,
        "screening": None,
        "comparison": fitted_model,
        "best": fitted_model,
        "parameters": [Interval("E", 5e4, 4e4, 6e4, 6e3, True), Interval("nu", 0.3, 0.2, 0.4, 0.06, True)],
        "candidate": lambda name: candidate,
    }
    return SimpleNamespace(**(entries | more))


class Reaching(BodyForce):
    """An effect with a number that is given, and not fitted."""

    parameters = named(Parameter("push", "m/s^2", Identity(), (-100.0, 100.0), "push"))
    signature, probes = "the body moves", ({"push": 1.0}, {"push": 4.0})

    def __init__(self, push: float = 0.0, depth: float = 0.2):
        super().__init__({"push": push}, {"depth": depth})

    @staticmethod
    def acceleration(point: Any, c: Any) -> list[Any]:
        return [c.push * (point.x[1] < c.depth), 0.0, 0.0]


def said(rounds: list[Any], kind: str, names: list[str]) -> list[str]:
    ends = {one.name: (one.low, one.high) for one in rounds[-1].parameters}
    return wording.verdict(MATERIAL, rounds, Verdict(kind, names, False, 0.8), ends)


LINEAR = SimpleNamespace(name="LinearDrag", p_value=1e-6, known={"E": 7e4, "nu": 0.3}, notes=())


@pytest.mark.parametrize(
    ("last", "sentence"),
    [
        (a_round(), wording.NOTHING),
        (a_round(held=POOR), wording.DOUBT_HELD),
        (a_round(fitted=POOR), wording.DOUBT_FITTED),
        (a_round(screening=Shape(POOR)), wording.DOUBT_SHAPE),
        (a_round(screening=Shape(FINE)), wording.NOTHING),
    ],
)
def test_nothing_is_missing_only_where_every_check_says_so(last: Any, sentence: str):
    assert said([last], "nothing", [])[0] == sentence


def test_a_named_effect_comes_with_its_p_value_its_share_and_what_moves():
    ends = [Interval("E", 7e4, 6e4, 8e4, 6e3, True), Interval("nu", 0.3, 0.2, 0.4, 0.06, True)]
    after = a_round(held=FINE, errors=(Error(4.0, 2.0), Error(0.8, 2.0)), parameters=ends)
    found = said([a_round(POOR, POOR, LINEAR), after], "missing", ["LinearDrag"])
    # of an excess of 4 over noise 0.8 is left
    assert found[0] == "Linear drag is missing (p < 0.0001; adding it removes 80% of the held-out error beyond noise)."
    assert found[1] == "Young's modulus moves from 50 kPa to 70 kPa [60 kPa, 80 kPa]."  # and nu stays
    assert wording.REMAINDER not in found
    after.parameters = [*after.parameters, Interval("drag", 1.497, 1.482, 1.512, 0.01, True)]
    found = said([a_round(POOR, POOR, LINEAR), after], "missing", ["LinearDrag"])
    assert found[1] == "Drag rate 1.5 1/s [1.48 1/s, 1.51 1/s] (90 % interval)."
    given = SimpleNamespace(observes=False, effect=Reaching(depth=0.3))
    after.parameters = [*ends, Interval("push", 2.0, 1.5, 2.5, 0.3, True)]
    found = said([a_round(POOR, POOR, LINEAR, candidate=lambda name: given), after], "missing", ["LinearDrag"])
    assert found[1] == "Push 2 m/s² [1.5 m/s², 2.5 m/s²] (90 % interval, depth 0.3 as given)."
    after.held = check(4.0, POOR)
    assert wording.REMAINDER in said([a_round(POOR, POOR, LINEAR), after], "missing", ["LinearDrag"])


def test_a_share_says_of_which_data_it_is():
    first, after = a_round(POOR, FINE, LINEAR), a_round(errors=(Error(-0.1, 2.0), Error(-0.1, 1.0)))
    first.errors = (Error(-0.1, 2.0),)
    found = said([first, after], "missing", ["LinearDrag"])
    assert "removes 50% of the fitted error beyond noise" in found[0]
    after.errors = (Error(-0.1, 2.0), Error(-0.1, 3.0))
    assert "removes none of the fitted error" in said([first, after], "missing", ["LinearDrag"])[0]


def test_effects_that_the_recording_does_not_separate_are_a_choice_with_an_experiment():
    first = a_round(POOR, POOR, LINEAR, indistinguishable=["LinearDrag", "QuadraticDrag"])
    found = said([first, a_round()], "missing", ["LinearDrag"])
    assert found[0].startswith("Linear drag or quadratic drag is missing (")
    assert f"To separate linear drag from quadratic drag: {LinearDrag.separating_experiment}." in found


def test_a_removed_effect_is_reported():
    spin = SimpleNamespace(**{**vars(LINEAR), "name": "InitialSpin"})
    rounds = [a_round(POOR, POOR, spin), a_round(POOR, POOR, LINEAR), a_round(removed=["InitialSpin"])]
    found = said(rounds, "missing", ["LinearDrag"])
    assert "Initial spin, found at first, is not needed with the others in the model, and was removed." in found
    better = SimpleNamespace(**{**vars(LINEAR), "name": "QuadraticDrag"})
    rounds[-1] = a_round(POOR, POOR, better, removed=["InitialSpin"])
    found = said([*rounds, a_round()], "missing", ["LinearDrag", "QuadraticDrag"])
    assert "Initial spin, found at first, gives way to quadratic drag beside the others." in found


def test_notes_are_those_of_the_last_model():
    noted = SimpleNamespace(**{**vars(LINEAR), "notes": ("Drag rate: 50 1/s is a bound.",)})
    assert said([a_round(POOR, POOR, noted)], "missing", ["LinearDrag"])[-1] == "Drag rate: 50 1/s is a bound."


def test_an_unknown_cause_has_its_nearest_effects_in_the_right_number():
    found = said([a_round(POOR, POOR)], "unknown", ["LinearDrag"])
    assert found[1] == "The nearest known cause, linear drag, removes 80% of the held-out error beyond noise."
    found = said([a_round(POOR, POOR)], "unknown", ["LinearDrag", "InitialSpin"])
    assert found[1].startswith("The nearest known causes, linear drag and initial spin, remove 80%")


def test_a_force_is_not_estimated_from_noise():
    force = SimpleNamespace(explained=1.0, law=Law([DRAG], 0.8))
    assert wording.NO_FORCE in said([a_round(FINE, POOR, force=force)], "nothing", [])
    assert "would remove 100% of the excess error" in " ".join(said([a_round(POOR, POOR, force=force)], "nothing", []))


@pytest.mark.parametrize(
    ("law", "sentence"),
    [
        (Law([DRAG], 0.8), "It looks like -1.5 1/s times (velocity), which explains 80% of that force."),
        (Law([DRAG], 0.1), "No simple law describes that force; the nearest, -1.5 1/s times (velocity), explains 10%"),
        (Law([], 0.0), "No simple law describes that force: it follows neither position nor velocity."),
    ],
)
def test_a_force_is_said_to_look_like_a_law_only_where_that_explains_it(law: Law, sentence: str):
    found = wording.force(0.52, law)
    assert found[0] == "A smooth force on the body would remove 52% of the excess error in the fitted data."
    assert found[1].startswith(sentence)


def test_an_effect_whose_model_is_unstable_says_so_with_the_remedy():
    added, removed = (wording.unstable("LinearDrag", inside, "stopped in frame 3") for inside in (False, True))
    assert added.startswith("Linear drag explains what is missing, but the model with it is unstable on finer grids")
    assert removed.startswith("Linear drag may not be needed, but the model without it is unstable on finer grids")
    assert all(
        said.endswith("(stopped in frame 3); a larger physics.substep_rate may mend that.") for said in (added, removed)
    )
