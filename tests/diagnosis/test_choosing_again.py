"""No effect wins because it came first: not by where its fit begins, nor by what was not yet in the model."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis import competition, diagnose
from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.diagnose import Options, _Diagnosis
from pacnerf_lpo.diagnosis.refitting import refit
from pacnerf_lpo.diagnosis.removal import without_each
from pacnerf_lpo.diagnosis.rounds import accepted_names, verdict
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.mpm.effects import KelvinVoigt, LinearDrag, UniformForce
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.render.camera_faults import CameraShift
from tests.diagnosis import falling
from tests.diagnosis.examples import round_of, screening

ORDER = ["UniformForce", "LinearDrag"]
HIDDEN = {"push_x": 2.5, "push_z": -1.0, "ground_friction": 0.2}


def begun(folder, order: Sequence[str]) -> _Diagnosis:
    """A diagnosis in whose rounds these effects were added, whatever won."""
    problem = falling.Falling(HIDDEN)
    options = Options(falling.listed(folder), replicates=8)
    found = _Diagnosis(problem, Store(folder, b"falling", {}), options, lambda _: None, lambda _: None)
    effects, known = (), problem.first_guess
    for name in order:
        done = found._round(effects, known, found.progress, 0)
        done.accepted = refit(problem, effects, done.comparison, done.candidate(name), done.screening, found.progress)
        done.indistinguishable = [name]
        effects, known = (*effects, done.candidate(name).effect), done.accepted.known
        found.rounds.append(done)
    found.rounds.append(found._round(effects, known, found.progress, 0, compete=False))
    return found


def test_an_effect_that_stood_for_another_one_gives_way_to_it(tmp_path, monkeypatch, small_threads):
    """Drag was taken for the wind while nothing else was in the model."""
    falling.install(monkeypatch)
    found = begun(tmp_path, ("LinearDrag", "GroundFriction"))
    found._choose_again(without_each(found.problem, found.rounds[-1]))
    assert [done.removed for done in found.rounds] == [[], [], [], ["LinearDrag"], []]
    said = verdict(found.rounds)
    assert (said.kind, sorted(said.names)) == ("missing", ["GroundFriction", "UniformForce"])


def test_an_effect_that_wins_again_stays(tmp_path, monkeypatch, small_threads):
    falling.install(monkeypatch)
    found = begun(tmp_path, ("UniformForce", "GroundFriction"))
    before = list(found.rounds)
    found._choose_again(without_each(found.problem, before[-1]))
    assert found.rounds == before and accepted_names(before) == ["UniformForce", "GroundFriction"]
    assert before[0].indistinguishable == ["UniformForce"]
    again = before[0].second
    assert again is not None and again.accepted is not None and again.accepted.name == "UniformForce"
    assert before[1].second is None, "the last one was chosen beside all others"


def test_what_was_fitted_before_the_best_is_fitted_once_more_from_where_that_ended(
    tmp_path, monkeypatch, small_threads
):
    falling.install(monkeypatch)
    monkeypatch.setattr(competition, "worth_refitting", lambda scores, *_: ORDER if scores else [])
    told: list[str] = []
    options = Options(falling.listed(tmp_path), replicates=5, effects=1)
    problem = falling.Falling({"drag": 2.0})
    rounds = diagnose.investigate(problem, Store(tmp_path, b"falling", {}), options, told.append)
    assert verdict(rounds).names == ["LinearDrag"]
    tried = {path.stem.partition("refit_")[2] for path in (tmp_path / "steps").glob("*_refit_*")}
    assert tried == {"thoroughly_UniformForce", "thoroughly_LinearDrag", "beside_UniformForce"}
    best = next(again for again in rounds[0].refits if again.name == "LinearDrag")
    begins = [line for line in told if "refit with UniformForce: iteration 0" in line]
    young = NeoHookean.parameters["E"]
    assert young.show(best.known["E"]) in begins[-1]
    assert young.show(rounds[0].comparison.known["E"]) in begins[0]


def test_what_a_promise_held_back_is_fitted_when_the_promise_is_not_kept(monkeypatch):
    """A straight line gives the first a score so high that the second seems to have no chance; the fit takes it back.
    A fit that is better than its line says nothing against the others.
    """
    kept = {"First": -5.0, "Second": 9.0, "Third": 4.0}
    fitted: list[str] = []

    def attempt(self: competition.Competition, candidate: SimpleNamespace, how: str = "thoroughly") -> None:
        fitted.append(candidate.name)
        self.refits.append(SimpleNamespace(name=candidate.name, log_bayes_factor=kept[candidate.name], cost=1.0))

    monkeypatch.setattr(competition.Competition, "_attempt", attempt)
    monkeypatch.setattr(competition, "bent", lambda _: False)
    monkeypatch.setattr(competition, "against_the_best", lambda refits, _: refits)
    for first, expected in ((-5.0, ["First", "Second"]), (30.0, ["First"])):
        kept["First"] = first
        fitted.clear()
        lines = {"First": 23.0, "Second": 7.0, "Third": 1.0}
        scores = [SimpleNamespace(name=name, log_bayes_factor=score) for name, score in lines.items()]
        screening = SimpleNamespace(scores=scores, threshold=6.0, outside=())
        candidates = [SimpleNamespace(name=name, discrete=False, observes=False) for name in lines]
        comparison = SimpleNamespace(cost=100.0, fitted=np.ones(3, bool))
        found = SimpleNamespace(
            screening=screening,
            candidates=candidates,
            left_out={},
            unconfirmed=[],
            widened=False,
            beside="",
            comparison=comparison,
        )
        competition.Competition(None, None, "1", found, print).run()  # type: ignore[arg-type]
        assert list(dict.fromkeys(fitted)) == expected


@pytest.mark.parametrize(
    ("force", "widened", "moved", "expected"),
    [
        (25.0, True, False, {"UniformForce", "LinearDrag"}),
        (25.0, False, False, set()),
        (-1.0, True, False, set()),
        (-1.0, True, True, {"UniformForce", "LinearDrag", "KelvinVoigt"}),
    ],
)
def test_every_force_is_fitted_where_only_an_unknown_one_explains_the_recording(
    monkeypatch, force: float, widened: bool, moved: bool, expected: set[str]
):
    """Straight lines speak against all effects, and the rounds would end with an unknown cause."""
    fitted: list[str] = []
    monkeypatch.setattr(competition.Competition, "_attempt", lambda _, candidate, *__: fitted.append(candidate.name))
    monkeypatch.setattr(competition, "bent", lambda _: moved)
    effects = UniformForce(), LinearDrag(), KelvinVoigt(), CameraShift(view=1)
    lines = {name_of(effect): -0.1 - number for number, effect in enumerate(effects)}
    found = round_of(effects, screened=screening(**lines, UnknownForce=force, WrongShape=-3.0), widened=widened)
    competition.Competition(None, None, "1", found, print).run()  # type: ignore[arg-type]
    assert set(fitted) == expected
