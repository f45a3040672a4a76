"""What would help, and fits: a scene with hidden drag, from the first look to an overlay that `fit` takes."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml

from pacnerf_lpo.diagnosis.catalogue import read_effects
from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.errors import Stopped, UserInputError
from pacnerf_lpo.explore import Session, saving
from tests.diagnosis.falling import TRUTH, install, listed
from tests.explore.falling import DRAG, seen, session_of, source_of

FREE = ["drag", "E", "v_x", "v_y", "v_z", "ground_height"]


@pytest.fixture(scope="module")
def asked_once(tmp_path_factory: pytest.TempPathFactory):
    """The script: ask, add the best, fit; a session that has been through it, and what it suggested."""
    with pytest.MonkeyPatch.context() as patch:
        install(patch)
        session = session_of(tmp_path_factory.mktemp("falling"))
        suggestions = session.suggest(most=60)
        session.add(suggestions[0].effect, suggestions[0].values)
        session.fit(FREE)
        yield session, suggestions


@pytest.fixture
def asked(asked_once):
    """At the step of the fit, wherever the test before went."""
    session, suggestions = asked_once
    session.go_to(next(n for n, step in enumerate(session.steps) if step.name == f"fit of {', '.join(FREE)}"))
    return session, suggestions


def test_the_drag_comes_first_with_its_evidence(asked):
    best, *others = asked[1]
    assert best.effect == "LinearDrag" and best.readable == "linear drag" and best.fitted and best.stands_out
    assert best.p_value < 0.01 and best.log_bayes_factor > others[0].log_bayes_factor
    assert best.values["drag"] == pytest.approx(DRAG, rel=0.2) and best.units == {"drag": "1/s"}
    assert "late" in best.signature and "QuadraticDrag" in best.confused_with
    assert all(np.isfinite([one.log_bayes_factor, one.p_value, *one.values.values()]).all() for one in asked[1])


def test_the_fit_halves_the_held_out_error_and_knows_how_sure_it_is(asked):
    session = asked[0]
    first, fitted = session.steps[0], session.current
    assert fitted.kind == "fit" and fitted.name == f"fit of {', '.join(FREE)}" and fitted.resolution == "refined"
    assert fitted.held_out < first.held_out / 2 and fitted.fitted < first.fitted / 2
    for name, true in (("drag", DRAG), ("v_y", TRUTH["v_y"])):
        low, high = fitted.intervals[name]
        assert low < fitted.values[name] < high and low - (high - low) < true < high + (high - low)
    assert session.error().floor is not None and session.error().held_out < 3 * session.error().floor[1]
    assert {s.name: s.interval for s in session.settings}["drag"] == fitted.intervals["drag"]


def test_with_the_drag_in_it_nothing_stands_out(asked):
    session = asked[0]
    assert not any(one.stands_out and not one.effect.count("@") for one in session.suggest())


def test_what_is_not_ticked_is_held(asked):
    session = asked[0]
    session.go_to(0)
    step = session.fit(["v_y"])
    assert {name for name, value in step.values.items() if value != session.steps[0].values[name]} == {"v_y"}
    assert step.parent == 0 and set(step.intervals) == {"v_y"}


def test_an_effect_without_a_gradient_starts_at_its_probes(asked):
    session = asked[0]
    session.go_to(0)
    session.add("GroundFriction")
    assert session.fit(["ground_friction"]).values["ground_friction"] < 10


def test_a_stopped_fit_keeps_its_best(asked):
    session = asked[0]
    session.go_to(0)
    told: list[str] = []
    with pytest.raises(Stopped):
        session.fit(["v_y", "E"], progress=told.append, stop=lambda: any("iteration 0" in text for text in told))
    assert session.current.name == "fit of v_y, E, stopped" and session.current.held_out < session.steps[0].held_out
    assert not session.busy


def test_one_question_at_a_time_and_changes_meanwhile(asked):
    session = asked[0]
    session.go_to(0)
    inside, go_on = threading.Event(), threading.Event()

    def wait(_: str) -> None:
        inside.set()
        assert go_on.wait(60)

    thread = threading.Thread(target=session.fit, args=(["v_y"], wait))
    thread.start()
    assert inside.wait(60) and session.busy
    with pytest.raises(UserInputError, match="another question is being answered"):
        session.suggest()
    changed = session.set("E", 7e4)
    assert session.error().held_out == pytest.approx(changed.held_out)
    go_on.set()
    thread.join(60)
    assert session.current.name == "fit of v_y" and session.current.parent == 0 and changed in session.steps


def test_the_overlay_is_a_configuration(asked, tmp_path: Path):
    session = asked[0]
    step = next(step for step in session.steps if step.kind == "fit" and "LinearDrag" in step.effects)
    path = session.save_overlay(tmp_path / "effects.yaml", step.number)
    section = yaml.safe_load(path.read_text())["physics"]
    (effect,) = read_effects(path, section["effects"])
    assert effect.guess["drag"] == pytest.approx(step.values["drag"], rel=1e-5)
    assert section["material"]["init_args"]["E"] == pytest.approx(step.values["E"], rel=1e-5)


def test_a_step_is_a_page_beside_the_first(asked, tmp_path: Path):
    session = asked[0]
    step = next(step for step in session.steps if step.kind == "fit" and "LinearDrag" in step.effects)
    page = session.report(tmp_path / "page", step.number)
    text = page.read_text()
    assert f"Step {step.number}, {step.name}: error of the fitted data" in text and "has not judged it" in text
    result = json.loads((page.parent / "diagnosis.json").read_text())
    assert [stage["readable"] for stage in result["stages"]] == ["as the run has it", step.name]
    assert result["stages"][1]["error"]["held"] < result["stages"][0]["error"]["held"] / 2
    drag = next(one for one in result["rounds"][1]["parameters"] if one["name"] == "drag")
    assert (drag["low"], drag["high"]) == pytest.approx(step.intervals["drag"])


def test_a_session_is_closed_and_opened_again(asked, monkeypatch: pytest.MonkeyPatch):
    session = asked[0]
    session.save(session.folder)
    monkeypatch.setattr(saving, "open_source", lambda *_: source_of(seen({"drag": DRAG}), session.folder.parent))
    again = Session.open(session.folder, jobs=1)
    assert again.steps == session.steps and again.current == session.current
    assert again.compare(0, 2).held_out == session.compare(0, 2).held_out
    np.testing.assert_allclose(again.compare(0, 2).change, session.compare(0, 2).change, atol=1e-4)
    assert again.set("drag", 1.0).number == len(session.steps)
    (session.folder / "session.json").write_text('{"format": 1}')
    with pytest.raises(UserInputError, match="no session that `save` has written"):
        Session.open(session.folder)


@pytest.mark.slow
def test_the_whole_diagnosis_is_a_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_threads: None):
    install(monkeypatch)
    source = source_of(seen({"drag": DRAG}), tmp_path)
    options = Options(candidates=listed(tmp_path), replicates=6, effects=1)
    session = Session.of(type(source)(source.problem, source.store, source.runs, None, options), jobs=1)
    told: list[str] = []
    step, verdict = session.diagnose(progress=told.append)
    assert (
        step.effects == ("LinearDrag",) and step.kind == "diagnose" and verdict[0].startswith("Linear drag is missing")
    )
    assert step.values["drag"] == pytest.approx(DRAG, rel=0.15) and "drag" in step.intervals
    assert (tmp_path / "diagnosis" / "effects.yaml").is_file() and step.held_out < session.steps[0].held_out / 2
    again = Session.of(session.source, jobs=1)
    assert [step.name for step in again.steps] == ["as the run has it", "as diagnose fitted it"]
    assert again.current.intervals and again.error().floor is not None
    with pytest.raises(UserInputError, match="nothing is left to separate"):
        again.plan()
