"""What a person does on the page, in a headless Chromium: sees, asks, ticks, fits, saves; and presses everything."""

from __future__ import annotations

import math
import random
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from pacnerf_lpo.explore import Session
from pacnerf_lpo.explore.page import open_page
from pacnerf_lpo.mpm.physics import Physics
from tests.diagnosis.falling import FRAMES, install
from tests.explore.dropped import DRAG
from tests.explore.falling import study_of
from tests.explore.hand import Hand, browser
from tests.test_effects_overlay import ROOT, configured

pytestmark = pytest.mark.slow

ACTS, LONGEST = 60, 40.0
"""Acts of random hands, and the seconds after which a slow machine has done enough of them."""
GROWTH = 150e6
"""Bytes that random hands may cost: six remembered rollouts and the pictures of a step; a leak costs more."""
PRESSED = ("play", "pause", "look through", "undo", "redo", "compare", "Add", "Set", "Save session", "Save overlay")
DRAGGED = ("frame", "camera", "E =", "v_x", "v_y", "v_z", "h [m]", "step", "compare with")
DRAWN = "[...document.body.children].filter(node => node.tagName !== 'SCRIPT').map(node => node.outerHTML).join(' ')"
TABS = ("See", "Show", "Steps", "Camera, frame", "Time and body", "Change", "Ask", "Keep")


@pytest.fixture
def session(dropped: Path) -> Iterator[Session]:
    with Session.open(dropped, jobs=1) as found:
        yield found


def lower_edge(opacity: np.ndarray) -> int:
    """Lowest row of an image in which the body is."""
    return int(np.nonzero((opacity > 0.5).any(1))[0].max())


@pytest.mark.end_to_end
def test_a_person_finds_the_drag_that_the_model_lacks(session: Session, tmp_path: Path):
    with browser() as pages:
        page = open_page(session, port=0)
        hand = pages()
        hand.open(page.url)
        seen = session.outlines(0, 6)
        assert lower_edge(seen.model) > lower_edge(seen.measured)  # the measured ball falls late
        before = hand.steps()[-1]
        hand.tab("Ask")
        hand.press("What would help?")
        hand.until(lambda: "Suggestions for step" in hand.text(), 600)
        assert "Linear drag" in hand.text()
        hand.tick("Linear drag")
        hand.until(lambda: any(name.startswith("+ LinearDrag") for name, *_ in hand.steps()))
        hand.tick("material")
        hand.press("Fit")
        hand.until(lambda: any(name.startswith("fit") for name, *_ in hand.steps()), 600)
        assert hand.steps()[-1][2] < 0.5 * before[2]
        hand.tab("Keep")
        hand.type("folder", str(tmp_path))
        hand.press("Save overlay")
        hand.until(lambda: "Overlay saved" in hand.text())
        page.close()
    assert hand.wrong == []
    found = configured(ROOT / "configs/fit.yaml", ROOT / "configs/demo.yaml", tmp_path / "effects.yaml").physics
    assert isinstance(found, Physics)
    assert found.guess["drag"] == pytest.approx(DRAG, rel=0.2)  # images of 64 pixels, a grid as coarse as a third


def test_two_pages_show_the_same_and_one_can_be_closed_and_opened_again(falling: Session):
    with browser() as pages:
        page = open_page(falling, port=0)
        first, second = pages(), pages(1000, 700)
        first.open(page.url)
        second.open(page.url)
        first.drag("v_y", 0.9)
        second.until(lambda: any(name.startswith("v_y") for name, *_ in second.steps()))
        first.until(lambda: [name for name, *_ in first.steps()] == [name for name, *_ in second.steps()])
        second.page.close()
        third = pages(1000, 700)
        third.open(page.url)
        assert [name for name, *_ in third.steps()] == [name for name, *_ in first.steps()]
        first.tab("Camera, frame")
        first.page.locator(".cell").nth(FRAMES + 3).click()
        first.until(lambda: (page.camera, page.frame) == (1, 3))
        page.close()


def random_act(hand: Hand, dice: random.Random) -> None:
    """One of the things that hands do; what is hidden at the moment is left."""
    kind, visible = dice.random(), hand.page.locator(".mantine-Slider-root:visible")
    if kind < 0.25:
        hand.tab(dice.choice(TABS))
    elif kind < 0.6:
        name = dice.choice(DRAGGED)
        if visible.count() and hand.row(name).is_visible():
            hand.drag(name, dice.random(), steps=2)
    elif kind < 0.85:
        button = hand.page.get_by_role("button", name=dice.choice(PRESSED), exact=True)
        if button.is_visible() and button.is_enabled():
            button.click()
    else:
        boxes = hand.page.locator("input[type=checkbox]:visible")
        if boxes.count():
            boxes.nth(dice.randrange(boxes.count())).click()


def test_recordings_of_a_study_stand_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_threads: None):
    install(monkeypatch)
    with browser() as pages:
        page = open_page(study_of(tmp_path), port=0)
        hand = pages()
        hand.open(page.url)
        bodies = [page.server.scene.get_handle_by_name(f"/body {name}") for name in ("low", "high")]
        apart = bodies[1].position[0] - bodies[0].position[0]
        assert apart > np.ptp(bodies[0].points[:, 0])
        hand.row("recording").get_by_role("combobox").click()
        hand.page.get_by_role("option", name="high").click()
        hand.until(lambda: page.recording == "high")
        hand.press("look through")
        assert hand.wrong == []
        page.close()


def test_whatever_hands_press_is_explained_and_costs_no_memory(falling: Session):
    dice = random.Random(1)
    with browser() as pages:
        page = open_page(falling, port=0)
        hand = pages()
        hand.open(page.url)
        hand.page.set_default_timeout(20000)
        end, grown, acts = time.monotonic() + LONGEST, 0.0, 0
        start = math.nan
        while acts < ACTS and time.monotonic() < end:
            hand.dismiss()
            random_act(hand, dice)
            acts += 1
            said = hand.page.evaluate(DRAWN)
            assert not re.search(r".{200}\b(NaN|nan)\b", said)
            assert "mistake of the program" not in said
            memory = psutil.Process().memory_info().rss
            if acts == 10:
                start = memory
            grown = memory - start
        page.playing.clear()
        assert acts > 10
        assert grown < GROWTH
        assert hand.wrong == []
        page.close()
