"""The parts of the page without a browser: who waits for whom, what is drawn, what is told."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.commands import explore
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.explore import Session, pictures
from pacnerf_lpo.explore.page import charts, open_page
from pacnerf_lpo.explore.page.charts import between, short
from pacnerf_lpo.explore.page.story_page import STORY, write_story
from pacnerf_lpo.explore.page.worker import Worker, guarded, one_line
from pacnerf_lpo.explore.records import Camera, Outlines, Setting, Step
from tests.data.trajectories.throws import BALL, write_drops
from tests.report.browser import dom

viser = pytest.importorskip("viser", reason="the extra explore is not installed")


def test_the_newest_wish_of_a_kind_is_done_and_refined_when_the_hand_rests():
    done, complaints, open_ = [], [], threading.Event()
    worker = Worker(complaints.append, lambda: done.append("refined"), 0.05)
    worker.ask("first", open_.wait)
    for number in range(5):
        worker.ask("drag", lambda number=number: done.append(number), refined_later=True)
    worker.ask("other", lambda: done.append("other"))
    open_.set()
    assert worker.wait(10.0)
    worker.end()
    assert done == [4, "other", "refined"]
    assert complaints == []


def test_every_error_is_told_in_one_line_and_ends_nothing(capsys: pytest.CaptureFixture):
    complaints: list[str] = []
    worker = Worker(complaints.append, lambda: None, 0.05)

    def fail(error: Exception) -> None:
        raise error

    errors = (UserInputError("drag = x;\n give a number"), SimulationError(3, 2, "NaN"), KeyError("forgotten"))
    for number, error in enumerate(errors):
        worker.ask(str(number), lambda error=error: fail(error))
    assert worker.wait(10.0)
    worker.end()
    assert complaints[0] == "drag = x; give a number"
    assert "frame 3" in complaints[1]
    assert "mistake of the program" in complaints[2] and "KeyError" in complaints[2]
    assert "KeyError" in capsys.readouterr().err
    assert all("\n" not in text for text in complaints)
    assert one_line(UserInputError("")) == "UserInputError"


def test_charts_draw_no_nan_and_mark_what_is_held_out():
    values = np.array([[0.1, np.nan, 0.3], [np.nan, np.nan, np.nan]])
    held = np.array([[False, False, True], [False, True, False]])
    table = SimpleNamespace(table=values, held=held, rows=("view 0", "view <1>"), unit="px")
    over = partial(SimpleNamespace, times=np.arange(3.0), by_frame_held_out=values[1], unit="px")
    line, nothing = (charts.over_time(over(by_frame_fitted=fitted), 1) for fitted in values)
    steps = [Step(0, None, "<b>", "open", {}, ()), Step(1, 0, "fit", "fit", {}, (), fitted=0.5, held_out=1.0)]
    bars = charts.history(steps, 1, "px", "slider")
    cells = charts.heat_map(table, (0, 1), ("camera", "frame"))
    heights = np.array([[np.nan, 3.0, np.nan], [np.nan, np.nan, np.nan], [np.nan, 1.0, np.nan]])
    flight = charts.path(np.arange(3.0), heights, np.ones((3, 3)), held[0], 2)
    assert flight.count("<circle") == 2 and flight.count("<polyline") == 1  # only heights were measured, one is missing
    assert f'r="4" fill="{charts.HELD}"' in flight
    assert (charts.figure(3082.4, "mm"), charts.figure(0.01234)) == ("3082 mm", "0.0123")
    for text in (line, nothing, bars, cells, flight, charts.by_name({"top": np.nan, "left": 2.0}, "px")):
        assert not re.search("nan", text, re.I)
    assert cells.count(charts.HELD) >= 2 and "view &lt;1&gt;" in cells and 'data-go="camera=0 frame=2"' in cells
    assert "&lt;b&gt;" in bars and 'class="now" data-go="slider=1"' in bars


def test_a_picture_shows_where_the_model_is_and_the_video_not():
    pose = np.hstack((np.eye(3), [[0.0], [0.0], [2.0]]))
    camera = Camera(0, "view 0", "ball", False, pose, np.array([[40.0, 0, 20], [0, 40, 20], [0, 0, 1]]), 40, 40)
    points = np.array([[0.2, 0.0, 0.0], [0.3, 0.0, 0.5], [np.nan, 0, 0], [0.0, 0.0, 5.0]])
    colours = np.array([[0, 1.0, 0], [1.0, 0, 0], [0, 0, 1.0], [0, 0, 1.0]])
    model, measured = np.zeros((40, 40)), np.zeros((40, 40))
    model[17:23, 20:30], measured[17:23, 10:20] = 1.0, 1.0
    drawn = pictures.drawing(points, colours, 0.05, model, camera)
    # 0.2 m to the right at 2 m, and 0.3 m at 1.5 m, with 40 pixels of focal length
    np.testing.assert_allclose(drawn[20, 24], [0, 1, 0])
    np.testing.assert_allclose(drawn[20, 28], [1, 0, 0])
    assert drawn[0, 0].tolist() == [1, 1, 1]
    seen = Outlines(1 - 0.5 * np.repeat(measured[..., None], 3, -1), measured, model)
    image = pictures.triptych(seen, drawn, 200)
    assert image.shape[0] == 200 and image.dtype == np.uint8
    residual = image[100:, 200:].reshape(-1, 3).astype(int)
    orange, blue = (np.abs(residual - colour).sum(1).min() for colour in (pictures.MODEL, pictures.MEASURED))
    assert orange < 40 and blue < 40
    left, _, wide, high = pictures.around(seen)
    assert left < 10 and left + wide > 20 and wide == high
    assert pictures.around(Outlines(seen.image, 0 * model, 0 * model)) == (0, 0, 40, 40)


def test_a_frame_that_is_played_does_not_meet_one_that_a_hand_chose(falling: Session, monkeypatch: pytest.MonkeyPatch):
    """Hulls have another number of points at every frame: their clouds are made anew while others move them."""
    page, complaints = open_page(falling, port=0), []
    monkeypatch.setattr(page, "complain", complaints.append)
    page.changes.ask("begin", lambda: None)
    assert page.changes.wait(60.0)
    page.see.measured.value = True
    page.changes.ask("measured", page.see._measure)
    assert page.changes.wait(60.0)
    ended = threading.Event()

    def hand(job: Callable[[], None]) -> None:
        while not ended.is_set():
            guarded(job, complaints.append)

    jobs = (page.see.next_frame, lambda: page.look(frame=1), lambda: page.look(frame=4), page.see.take)
    hands = [threading.Thread(target=hand, args=(job,)) for job in jobs]
    for thread in hands:
        thread.start()
    ended.wait(3.0)
    ended.set()
    for thread in hands:
        thread.join(60.0)
    page.close()
    assert complaints == []


def test_a_flight_that_was_measured_is_drawn_as_a_path(tmp_path: Path):
    scenes = tmp_path / "scenes"
    assert main(["init", str(write_drops(tmp_path / "ball.csv", 0.02)), str(scenes), *BALL]) == 0
    with Session.open(scenes, jobs=1) as session:
        page = open_page(session, port=0)
        assert page.changes.wait(60.0)
        tracks, path = (
            page.server.scene.get_handle_by_name(f"/{kind} {page.recording}") for kind in ("tracks", "path")
        )
        assert len(tracks.points) == len(path.points) == len(session.times())
        assert page.see.path.visible and page.see.path.content.count("<circle") == len(session.times())
        assert "look through" not in page.see.buttons.options
        page.close()


def test_settings_are_written_in_units_that_people_use():
    ends = (1e3, 1e7)
    E = Setting("E", "Young's modulus", "Pa", "material", 9.66e4, None, 0, 1e12, ends, True, None, True, True, None)
    v = Setting("v_x@low", "velocity", "m/s", "motion", 1.0, None, -9, 9, (-1, 1), False, None, True, True, "low")
    assert (short(E), short(v)) == ("E = 96.6 kPa", "v_x low [m/s]")
    assert between((1e4, 2e4), "Pa") == "[10 kPa, 20 kPa]"


@pytest.mark.parametrize(("host", "port", "says"), [("203.0.113.7", 0, "--host"), ("127.0.0.1", 99999, "--port")])
def test_an_address_that_cannot_be_listened_on_is_one_line(host: str, port: int, says: str):
    with pytest.raises(UserInputError, match=says):
        open_page(None, host, port)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_page_to_share_opens_without_a_server(dropped: Path, tmp_path: Path):
    with Session.open(dropped, jobs=1) as session:
        session.set("drag", 3.0)
        path = write_story(session, tmp_path / STORY)
    text = path.read_text()
    assert "http" not in re.sub(r"http://www.w3.org/\S+", "", text.split("<script")[0])
    assert path.stat().st_size < 4e6
    probe = "<script>document.title = byId('name').textContent + '|' + byId('time').max + '|' + byId('shown').innerText"
    found = dom(text, f"{probe}</script></body>", tmp_path)
    assert "Step 1: LinearDrag 3 1/s|9|" in found
    assert "drag" in found.partition("<title>")[2].partition("</title>")[0]


def test_what_was_tried_is_kept_when_the_command_ends(
    dropped: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def opened(session: Session, host: str, port: int, dark: bool) -> SimpleNamespace:
        session.set("drag", 1.0)
        return SimpleNamespace(url=f"http://{host}:{port + 1}", port=port + 1, close=lambda: None, wait=lambda: None)

    monkeypatch.setattr(explore, "open_page", opened)
    monkeypatch.setattr(explore, "wait_for_signal", lambda: None)
    explore.run(str(dropped), jobs=1)
    said = capsys.readouterr().out
    assert "(port 8080 is taken)" in said
    with Session.open(said.split("pacnerf-lpo explore ")[1].split()[0], jobs=1) as again:
        assert [step.name for step in again.steps][1:] == ["LinearDrag 1 1/s"]


@pytest.mark.end_to_end
def test_the_command_says_where_the_page_is_and_ends_cleanly(dropped: Path):
    command = [sys.executable, "-m", "pacnerf_lpo", "explore", str(dropped), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = re.search(r"http://127.0.0.1:\d+", process.stdout.readline())
        assert url is not None
        assert urllib.request.urlopen(url[0], timeout=10).status == 200
        process.send_signal(signal.SIGINT)
        rest, wrong = process.communicate(timeout=60)
    assert process.returncode == 0, wrong
    assert "ended" in rest and "Traceback" not in wrong
