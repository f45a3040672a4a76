"""The HTML page: self-contained, honest, small, and its parts agree with the results."""

from __future__ import annotations

import base64
import html
import io
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
from markupsafe import escape
from PIL import Image

from pacnerf_lpo.evaluation.prediction import contact_frame, predict
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.quantities import duration, quantity
from pacnerf_lpo.report.html import judge, write_report
from pacnerf_lpo.report.page import atlas, atlas_columns, parts, quantised
from pacnerf_lpo.report.payload import Curve, read_curves, split_unit, with_weighted_fits
from tests.report.browser import dom


@pytest.fixture(scope="module")
def page(evaluated_run) -> str:
    return write_report(evaluated_run).read_text()


@pytest.fixture(scope="module")
def data(page) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S).group(1))


class Balance(HTMLParser):
    """Collects what is opened and closed, and every address."""

    VOID = frozenset({"meta", "input", "br"})

    def __init__(self):
        super().__init__()
        self.open, self.addresses = [], []

    def handle_starttag(self, tag, attributes):
        self.addresses += [value for name, value in attributes if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_well_formed_self_contained_and_small(page):
    parser = Balance()
    parser.feed(page)
    assert parser.open == []
    assert parser.addresses == []
    assert "http://www.w3.org/2000/svg" in page  # the SVG name space, the only address in the page
    assert set(re.findall(r"https?://[\w./]+", page)) == {"http://www.w3.org/2000/svg"}
    assert len(page) < 10e6


def test_first_screen_says_what_was_recovered_and_how_good_it_is(page):
    head = page[: page.index('id="comparison"')]
    for text in (
        "97 kPa",
        "0.31",
        "30 kPa",
        "100 kPa",
        "0.013 in log10",
        "(0.00, \N{MINUS SIGN}0.50, 0.00)",
        "PSNR, held-out views",
    ):
        assert text in head


def test_atlases_hold_the_frames_of_each_view(data, evaluated_run):
    run = Run(evaluated_run)
    images, width = data["images"], data["images"]["width"]
    assert [view["set"] for view in data["views"]] == ["train", "test", "train", "train"]
    assert len(images["measured"]) == 4 and len(images["model"]) == len(images["stages"]) == 3
    sheet = np.asarray(Image.open(io.BytesIO(base64.b64decode(images["model"][-1][1].split(",")[1]))).convert("RGB"))
    row, column = divmod(3, images["columns"])
    shown = sheet[row * width : (row + 1) * width, column * width : (column + 1) * width]
    predicted = predict(run, run.last).images[1, 3]
    assert np.abs(shown.astype(int) - predicted).mean() < 6  # WebP, quality 85


def test_particles_decode_to_their_positions(data, evaluated_run):
    cloud = data["particles"]
    packed = np.frombuffer(base64.b64decode(cloud["positions"]), "<u2").reshape(cloud["frames"], cloud["count"], 3)
    positions = np.array(cloud["lower"]) + packed / 65535 * np.array(cloud["extent"])
    run = Run(evaluated_run)
    expected = predict(run, run.last).positions
    assert cloud["of"] == cloud["count"] == expected.shape[1]
    order = np.lexsort(np.round(positions[0], 3).T), np.lexsort(np.round(expected[0], 3).T)
    # half a step of 16 bits within an extent of about 1 m
    np.testing.assert_allclose(positions[4][order[0]], expected[4][order[1]], atol=2e-5)


def test_curves_of_parameters_and_losses(data):
    assert [chart["title"] for chart in data["curves"]["parameters"]] == [
        "E",
        "\N{GREEK SMALL LETTER NU}",
        "initial velocity",
    ]
    young = data["curves"]["parameters"][0]
    assert (young["unit"], young["log"], young["truth"]) == ("Pa", True, 1e5)
    assert [part[0] for part in young["lines"][0]["parts"]] == ["physics, round 1"]
    assert young["lines"][0]["parts"][0][1][:3] == [0, 1, 2]
    assert [chart["title"] for chart in data["curves"]["loss"]] == [
        "static",
        "velocity",
        "physics, round 1",
        "correction, round 1",
    ]


def test_curves_are_empty_without_events(evaluated_run, tmp_path):
    assert read_curves(tmp_path, Run(evaluated_run).stages) == {}


def test_what_a_weighted_fit_found_follows_the_phase_that_it_took_the_place_of():
    course = [("velocity", [0, 1], [0.1, 0.2]), ("physics, round 1", [0, 10, 40], [0.2, 0.3, 0.4])]
    curves = {"E": Curve("Pa", [("physics, round 1", [0, 40], [1e4, 2e4])]), "v_x": Curve("m/s", course)}
    physics = {"label": "physics, round 1", "velocity": [0.5, 0.0, 0.0], "parameters": {"E": {"value": 3e4}}}
    velocity = {"label": "velocity", "velocity": [0.2, 0.0, 0.0], "parameters": {"E": {"value": 1e4}}}
    assert with_weighted_fits(curves, [velocity, physics]) == curves
    found = with_weighted_fits(curves, [velocity, {**physics, "before": {"E": 2e4, "v_x": 0.4}}])
    assert found["E"].parts == [*curves["E"].parts, ("weighted fit", [0, 4], [3e4, 3e4])]
    assert found["v_x"].parts == [*course, ("weighted fit", [0, 4], [0.5, 0.5])]


def test_report_evaluates_a_run_that_has_not_been(evaluated_run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(evaluated_run, copy, ignore=shutil.ignore_patterns("results.json"))
    text = write_report(copy).read_text()
    assert (copy / "results.json").is_file()
    assert "0.013 in log10" not in text  # no truth was given


def test_report_of_an_unfinished_run_says_so(evaluated_run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(evaluated_run, copy)
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["status"] = "interrupted"
    manifest["phases"] = manifest["phases"][:1]
    (copy / "manifest.json").write_text(json.dumps(manifest))
    text = write_report(copy).read_text()
    assert "This run is interrupted: what follows is the state after static." in text


PROBE = """<script>
const seen = [];
addEventListener("error", (event) => seen.push(event.message));
function put(id, value, name) { const e = byId(id); e.value = value; e.dispatchEvent(new Event(name)); }
setTimeout(() => {
  put("frame", 3, "input"); put("view", 2, "input"); put("stage", 0, "change");
  put("time", 4, "input"); put("paint", "speed", "change");
  byId("particles").onpointermove({ buttons: 1, movementX: 60, movementY: 20 });
  byId("theme").click();
  const first = { view: shared.view, frame: shared.frame, label: byId("view-value").textContent };
  document.querySelectorAll("#heatmap .cell")[7].dispatchEvent(new Event("click"));
  const second = { view: shared.view, frame: shared.frame, charts: document.querySelectorAll("svg").length };
  document.body.dataset.seen = JSON.stringify([seen, first, second]);
}, 300);
</script></body>"""


@pytest.mark.slow
def test_sliders_heat_map_and_viewer_work_in_a_browser(page, tmp_path):
    seen = re.search(r'data-seen="([^"]*)"', dom(page, PROBE, tmp_path)).group(1)
    errors, first, second = json.loads(html.unescape(seen))
    assert errors == []
    assert first == {"view": 2, "frame": 3, "label": "training 4"}
    # five frames a row: cell 7 is the second view's third frame; 4 losses, 2 parameters, velocity, heat map, timeline
    assert second == {"view": 1, "frame": 2, "charts": 9}


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (103.2e3, "Pa", "103 kPa"),
        (999.96e3, "Pa", "1 MPa"),
        (1.54e4, "Pa", "15.4 kPa"),
        (212.0, "Pa s", "212 Pa s"),
        (0.2963, "1", "0.296"),
        (39.84, "deg", "39.8°"),
        (0.0123, "m", "0.0123 m"),
        (0.0, "Pa", "0 Pa"),
    ],
)
def test_quantities_are_written_as_people_write_them(value, unit, text):
    assert quantity(value, unit) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(4.24, "4.2 s"), (42.4, "42 s"), (185, "3 min 05 s"), (7.2e3, "2 h 00 min")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_units_in_tags():
    assert split_unit("E [Pa]") == ("E", "Pa")
    assert split_unit("v_x [m|s]") == ("v_x", "m/s")
    assert split_unit("loss") == ("loss", "1")


def test_contact_begins_where_the_kernel_reaches_the_ground():
    lowest = np.array([0.5, 0.2, 0.149, 0.3])
    assert contact_frame(lowest, 0.1) == 2
    assert contact_frame(lowest, 0.1, ground=-0.1) is None
    assert contact_frame(lowest, 0.1, ground=0.1) == 1


def test_atlas_and_quantisation():
    frames = np.zeros((5, 8, 8, 3), np.uint8)
    frames[4] = 200
    sheet = np.asarray(Image.open(io.BytesIO(base64.b64decode(atlas(frames, (4, 4), 90).split(",")[1]))).convert("RGB"))
    assert sheet.shape == (8, 12, 3) and atlas_columns(5) == 3
    assert abs(int(sheet[6, 6, 0]) - 200) < 12
    points = np.array([[[0.0, 1.0, 2.0], [1.0, 3.0, 2.0]]])
    integers, lower, extent = quantised(points)
    np.testing.assert_allclose(np.array(lower) + integers / 65535 * np.array(extent), points, atol=1e-4)


def verdict_of(test: float, worst: float):
    rms = np.array([[0.02] * 6, [0.02] * 6, [test] * 6])
    phase = {
        "images": {
            "rms": rms.tolist(),
            "blank_rms": np.full((3, 6), 0.2).tolist(),
            "silhouette_iou": [[0.1] * 6, [0.1] * 6, [0.9] * 5 + [worst]],
        }
    }
    return judge({"views": {"train": [0, 4], "test": [7]}}, phase)


def test_verdict_grades_by_the_worst_frame_of_the_held_out_views():
    assert [verdict_of(0.02, worst).grade for worst in (0.8, 0.6, 0.4)] == ["good", "fair", "poor"]
    said = verdict_of(0.02, 0.6).headline  # 1 - 0.01; (5 * 0.9 + 0.6) / 6
    assert "99.0 % of the image in 1 views it never saw" in said and "by 85 %, in the worst frame by 60 %" in said
    hopeless = verdict_of(0.3, 0.8)
    assert hopeless.grade == "poor" and "farther from the video than an empty scene" in hopeless.headline


def test_doubts_stand_under_the_verdict_with_cause_and_remedy(evaluated_run, page):
    doubts = json.loads((evaluated_run / "results.json").read_text())["doubts"]
    assert "no_contact" not in [doubt["name"] for doubt in doubts]  # its phases say nothing about a contact frame
    head = page[: page.index('id="comparison"')]
    assert (doubts and f"{len(doubts)} reason" in head) or "One reason" in head
    for doubt in doubts:
        assert all(escape(doubt[field]) in head for field in ("what", "cause", "remedy"))


def test_a_page_without_doubts_says_nothing_of_them():
    assert parts("report").doubts([]) == ""
