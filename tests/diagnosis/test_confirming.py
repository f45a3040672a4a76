"""An effect that has won beside the errors of the model without it is needed in its own model, too, or taken back."""

from __future__ import annotations

from pathlib import Path

import pytest

from pacnerf_lpo.diagnosis import diagnose
from pacnerf_lpo.diagnosis.diagnose import Options, _Diagnosis
from pacnerf_lpo.diagnosis.refitting import refit
from pacnerf_lpo.diagnosis.rounds import Round, verdict
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.report import wording
from tests.diagnosis import falling


def added(folder: Path, hidden: dict[str, float], name: str) -> tuple[_Diagnosis, Round]:
    """A diagnosis whose first round has taken over an effect, whatever it is worth, and the beginning of its next."""
    problem = falling.Falling(hidden)
    options = Options(falling.listed(folder), replicates=8)
    found = _Diagnosis(problem, Store(folder, b"falling", {}), options, lambda _: None, lambda _: None)
    first = found._round((), problem.first_guess, found.progress, 0)
    candidate = first.candidate(name)
    assert first.screening is not None
    first.accepted = refit(problem, (), first.comparison, candidate, first.screening, found.progress)
    assert first.accepted is not None
    found.rounds.append(first)
    after = found._compared((candidate.effect,), first.accepted.known, found.progress, 0, "", found.rounds)
    return found, after


@pytest.mark.parametrize(
    ("hidden", "name", "needed"),
    [
        ({"push_x": 2.5, "push_z": -1.0}, "UniformForce", True),
        ({"drag": 2.0}, "LinearDrag", True),
        ({}, "LinearDrag", False),
    ],
)
def test_what_is_there_is_confirmed(tmp_path, monkeypatch, small_threads, hidden, name: str, needed: bool):
    falling.install(monkeypatch)
    found, after = added(tmp_path, hidden, name)
    assert found._confirmed(after, found.progress) is needed
    assert needed or after.effort["confirm"]["simulations"] > 0, "what is not clear by a line is fitted"


def test_what_is_not_needed_is_taken_back_and_said_to_be(tmp_path, monkeypatch, small_threads):
    """Nothing is hidden: where the drag is taken back, no other effect takes its place."""
    falling.install(monkeypatch)
    found, after = added(tmp_path, {}, "LinearDrag")
    seconds = after.effort["compare"]["seconds"]
    found._take_back(after, found.progress)
    (first,) = found.rounds
    assert (first.unconfirmed, first.accepted) == (["LinearDrag"], None)
    assert "LinearDrag" not in [again.name for again in first.refits]
    assert first.effort["compare"]["seconds"] >= seconds
    assert verdict(found.rounds).kind == "nothing"
    assert wording.unconfirmed("LinearDrag").startswith("Linear drag seemed to be missing.")


def test_the_next_best_takes_the_place_of_what_is_taken_back(tmp_path, monkeypatch, small_threads):
    """Drag and a push are hidden. Taken back in a round, the drag does not compete there any more, also where that goes
    on from what was stored.
    """
    falling.install(monkeypatch)
    asked: list[str] = []

    def needed(_: falling.Falling, before: Round, found: Round) -> tuple[bool, int]:
        asked.append(before.accepted.name if before.accepted else "")
        return asked[-1] != "LinearDrag", 7

    monkeypatch.setattr(diagnose, "newest_is_needed", needed)
    problem, told = falling.Falling({"drag": 4.0, "push_x": 2.5, "push_z": -1.0}), list[str]()
    options = Options(falling.listed(tmp_path), replicates=5, effects=2)
    rounds = diagnose.investigate(problem, Store(tmp_path, b"falling", {}), options, told.append)
    assert rounds[0].unconfirmed == ["LinearDrag"] and rounds[0].effort["confirm"]["simulations"] == 7
    assert rounds[0].accepted is not None and asked[:2] == ["LinearDrag", rounds[0].accepted.name]
    assert "LinearDrag" not in [again.name for again in rounds[0].refits]
    count = len(asked)
    again = diagnose.investigate(problem, Store(tmp_path, b"falling", {}), options, told.append)
    assert (verdict(again), again[0].unconfirmed) == (verdict(rounds), ["LinearDrag"])
    assert len(asked) == count, "what was asked once is stored"
