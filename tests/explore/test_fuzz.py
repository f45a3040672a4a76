"""Random clicks: no unexplained error, no NaN, and a memory that stays flat."""

from __future__ import annotations

import gc
import threading
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pacnerf_lpo.errors import SimulationError, Stopped, UserInputError
from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.stepping import KEPT
from pacnerf_lpo.mpm import runtime
from tests.diagnosis.falling import FRAMES, VIEWS, install, motion
from tests.explore.falling import session_of

CLICKS, WARM = 300, 60
MOST_PER_STEP = 20_000
"""Bytes that a step may keep: its numbers and its table of errors. A motion of this ball is ten times that."""


def clicks(session: Session, random: np.random.Generator) -> list[Callable[[], object]]:
    """What a person could do next, sensible and not."""
    settings = session.settings
    setting = settings[random.integers(len(settings))]
    low, high = setting.slider
    value = float(random.choice([random.uniform(low, high), low, high, random.normal() * 1e3, np.nan, np.inf, 0.0]))
    effects = session.effects
    effect = effects[random.integers(len(effects))].name
    step = int(random.integers(-1, len(session.steps) + 1))
    usual = [name for name in ("E", "nu", "v_x", "v_y", "drag", "push_x") if random.random() < 0.3]
    return [
        *[lambda: session.set(setting.name, value)] * 4,
        lambda: session.set(setting.name, value, dragging=True),
        lambda: session.set({name: value for name in usual}),
        lambda: session.add(effect),
        lambda: session.remove(effect),
        session.undo,
        session.redo,
        lambda: session.go_to(step),
        lambda: session.refine(step),
        lambda: session.compare(step, 0),
        lambda: session.error(step),
        lambda: session.motion(step),
        lambda: session.stretch(),
        lambda: session.regions(),
        lambda: session.outlines(int(random.integers(VIEWS + 1)), int(random.integers(FRAMES + 1)), step),
        lambda: session.measured(int(random.integers(FRAMES + 1))),
        lambda: session.overlay(step),
    ]


def drawn(found: object) -> list[np.ndarray]:
    """Numbers of a result that a page would draw; a NaN in a table of errors is a gap there."""
    if isinstance(found, (dict, np.ndarray)):
        return list(found.values()) if isinstance(found, dict) else [found]
    values = vars(found) if hasattr(found, "__dict__") else {}
    gaps = ("table", "change", "by_frame_fitted", "by_frame_held_out")
    arrays = [value for name, value in values.items() if isinstance(value, np.ndarray) and name not in gaps]
    numbers = [value for value in values.values() if isinstance(value, float)]
    return [*arrays, np.array(numbers), np.array(list(values.get("values", {}).values()), float)]


@pytest.mark.slow
def test_an_hour_of_random_clicks_in_a_minute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_threads: None):
    install(monkeypatch, lambda model, free: model.physical(free).get("drag", 0.0) > 50)
    session, random = session_of(tmp_path), np.random.default_rng(0)
    session.prepare()
    for frame in range(FRAMES):
        session.measured(frame)
    tracemalloc.start()
    for click in range(CLICKS):
        if click == WARM:
            gc.collect()
            warm, steps = tracemalloc.get_traced_memory()[0], len(session.steps)
        options = clicks(session, random)
        if random.random() < 0.01:
            options = [lambda: session.fit(["v_y"]), lambda: session.fit(["drag", "E"])]
        try:
            found = options[random.integers(len(options))]()
        except (UserInputError, SimulationError, Stopped) as error:
            assert str(error) and "\n" not in str(error)
            continue
        for numbers in drawn(found):
            assert numbers.dtype.kind != "f" or np.isfinite(numbers).all(), (click, found)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - warm
    tracemalloc.stop()
    assert len(session.steps) > 3 * steps > 20
    assert grown < MOST_PER_STEP * (len(session.steps) - steps), f"{grown} bytes"
    assert len(session.stepper._rolled) <= KEPT
    session.save(tmp_path / "kept")


def test_two_pages_at_once(falling: Session):
    """Every change of both is in the history, and the last state has the last change of each."""
    errors: list[BaseException] = []

    def page(name: str) -> None:
        try:
            for value in np.linspace(0.1, 1.0, 15):
                falling.set(name, float(value))
                falling.refine()
                assert np.isfinite(falling.motion().positions).all()
                falling.outlines(1, 4)
        except BaseException as error:
            errors.append(error)

    pages = [threading.Thread(target=page, args=(name,)) for name in ("drag", "push_x")]
    for thread in pages:
        thread.start()
    for thread in pages:
        thread.join(120)
    assert not errors
    assert [step.number for step in falling.steps] == list(range(31))
    assert falling.current.values["drag"] == falling.current.values["push_x"] == 1.0


def test_a_change_does_not_wait_for_a_refinement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    install(monkeypatch)
    session = session_of(tmp_path)
    fine, go_on = threading.Event(), threading.Event()
    body = session.problem.body

    def path(model, free):
        if model.body is body:
            fine.set()
            assert go_on.wait(60)
            runtime.heed()
        return motion(model, free)

    monkeypatch.setattr("pacnerf_lpo.identification.forward_model.BodyModel.path", path)
    found = []
    refining = threading.Thread(target=lambda: found.append(session.refine()))
    refining.start()
    assert fine.wait(60)
    changed = session.set("E", 5e4)
    go_on.set()
    refining.join(60)
    assert found == [session.steps[0]] and found[0].resolution == "coarse" and session.current == changed
