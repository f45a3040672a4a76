"""The page of a diagnosis: what each verdict says on the first screen, and that its parts work in a browser."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pacnerf_lpo.report import diagnosis_sections as sections
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.diagnosis import render_page, write_page
from pacnerf_lpo.report.diagnosis_tensorboard import excess_picture, log_diagnosis
from tests.report import diagnosis_example as example

KINDS = ("missing", "camera", "nothing", "unknown", "unfinished")


def result_of(kind):
    return example.missing() if kind == "missing" else example.other(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_page_of_every_verdict_says_it_first_and_needs_no_network(kind, tmp_path):
    result = result_of(kind)
    page = write_page(example.write(tmp_path / kind, result)).read_text()
    body = page[page.index("<body>") :]
    assert f"<h1>{html.escape(result['verdict']['sentence'])}</h1>" in body[:900]
    assert words.LIGHTS[kind].caption in body[:900]
    assert "$" not in re.sub(r"\$\{", "", page[: page.index('<script type="application/json"')])
    assert "drag_&lt;torus&gt;" in body and "<torus>" not in body[: body.index("<script")]
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", page)
    assert len(page) < 6_000_000


def test_a_faulty_reconstruction_is_no_green_light():
    verdict = example.other("nothing")["verdict"]
    assert words.light(verdict).colour == "good"
    assert words.light({**verdict, "rest": True}) == words.DOUBT and words.DOUBT.colour == "fair"


def test_first_screen_tells_distances_in_pixels():
    found = words.misfit(example.missing())
    assert (found.before, found.floor, found.after) == (1.0, 0.2, 0.4)
    assert "1.00 pixels from where they should be" in words.distance(example.missing())
    assert "5.0 times as far away" in words.distance(example.missing())  # 1.0 / 0.2
    assert "no farther away" in words.distance(example.other("nothing"))
    fails_aside = example.missing()
    fails_aside["rounds"][0]["omnibus"]["p_value"] = 0.4
    assert "5.0 times as far away" in words.distance(fails_aside)
    assert "falls from 1.00 to 0.40 pixels" in words.changes(example.missing())


def test_points_alone_are_told_in_millimetres_and_by_no_camera(tmp_path: Path):
    result = {**example.missing(), "unit": "mm", "points": ["point 7", "point 9", "clouds 1", "clouds 2"]}
    for stage in result["stages"]:
        stage["by_point"], stage["point_floor"] = 4 * [1.0], 4 * [0.5]
    told = words.compared(result)
    assert "2 tracked points and point clouds in" in told and "Every third" in told and "camera" not in told
    told = words.compared({**result, "points": ["clouds 1", "clouds 2"]})
    assert "of point clouds in" in told and "Every third" not in told
    assert "the points are typically 1.00 mm from where" in words.distance(result)
    page = write_page(example.write(tmp_path, result)).read_text()
    assert "Distance over time [mm]" in page and "1.00 mm</b>" in page and " px" not in sections.first_screen(result)


def test_a_wrong_camera_is_judged_by_its_own_view():
    found = words.misfit(example.other("camera"))
    assert (found.before, found.floor, found.after, found.where) == (3.0, 0.25, 0.5, "in camera 5")


def test_what_was_rejected_in_a_refit_is_not_named_as_an_alternative():
    result = example.missing()
    assert "gravity" not in words.missing(result)
    result["rounds"][0]["refits"] = result["rounds"][0]["refits"][1:]
    assert "(or gravity: this recording cannot tell)" in words.missing(result)


@pytest.mark.parametrize(
    ("p", "text"), [(0.7, "more often than not"), (0.013, "1 of 77 "), (0.0021, "1 of 500 "), (1e-9, "less than 1 of")]
)
def test_probabilities_in_words(p, text):
    assert text in words.chance(p)


def test_parameters_in_sentences_carry_their_labels():
    sentence = "raising Poisson's ratio while lowering Young's modulus changes nothing that this recording shows"
    assert words.undetermined(example.missing()) == [sentence]


def test_ranking_marks_threshold_cameras_and_groups():
    text = sections.ranking(example.screen())
    rows = re.findall(r'<div class="rank ([a-z ]+)"', text)
    assert rows == ["physics passed", "physics passed", "physics", "camera", "physics"]
    assert text.count(">A</em>") == 3  # two members and the note
    most = 1.08 * 40.0  # the axis ends 8 % beyond the longest bar
    assert f'style="left:{100 * 5 / most:.1f}%"' in text
    assert "a trace &lt;of&gt; Spin" in text


def test_refits_show_ticks_and_crosses_and_the_accepted_one_first():
    text = sections.refit_table(example.missing()["rounds"][0], "px")
    assert text.index("linear drag") < text.index("gravity")
    assert text.count("✓") == 3 and text.count("✗") == 1
    assert "removes 64%" in text and "removes nothing" in text


def test_parameters_before_and_after_with_intervals():
    text = sections.parameter_table(example.missing())
    assert "34 kPa" in text and "27.2 kPa … 40.8 kPa" in text and "70 kPa" in text
    assert "1.5 1/s" in text  # the effect's coefficient has no value before
    alone = sections.parameter_table(example.other("nothing"))
    assert "70 kPa" not in alone and "after" not in alone


def test_bounds_count_from_the_null_and_leave_out_alternatives_of_kind():
    result = example.other("nothing")
    result["rounds"][0]["screen"]["candidates"][3]["coefficients"][0]["null"] = 1.0
    text = sections.bounds_table(result)
    assert "<td>gain</td><td>0.75</td><td>1.75</td>" in text
    assert "yield" not in text


def test_errors_appear_in_tensorboard_by_view_and_frame(tmp_path):
    example.write(tmp_path / "diagnosis", example.missing())
    log_diagnosis(tmp_path)
    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    assert [e.value for e in events.Scalars("diagnosis/error, held data [px]")] == pytest.approx([1.0, 0.4])
    assert [e.value for e in events.Scalars("diagnosis/error by view/5 [px]")] == pytest.approx([1.0, 0.4])
    frames = events.Scalars("diagnosis/error by frame/1 + linear drag [px]")
    assert [e.step for e in frames] == example.FRAMES
    assert len(events.Tags()["images"]) == 1


def test_excess_picture_is_white_where_nothing_exceeds_and_full_at_the_worst():
    picture = excess_picture(example.missing())
    assert picture.shape == (2 * 4 * 14 + 6, 6 * 14, 3)
    assert np.allclose(picture[0, 0], 1.0)
    assert np.allclose(picture[4 * 14 - 1, -1], (0.80, 0.36, 0.0), atol=1e-5)


PROBE = """<script>
const seen = [];
addEventListener("error", (event) => seen.push(event.message));
addEventListener("unhandledrejection", (event) => seen.push(String(event.reason)));
function put(id, value, name) { const e = byId(id); e.value = value; e.dispatchEvent(new Event(name)); }
function ink(id) {
  const data = byId(id).getContext("2d").getImageData(0, 0, DATA.images.width, DATA.images.height).data;
  let sum = 0;
  for (let i = 0; i < data.length; i += 4) if (Math.abs(data[i] - data[i + 2]) > 60) sum++;
  return sum;
}
setTimeout(() => {
  const start = { view: DATA.views[shared.view], frame: shared.frame };
  put("frame", 4, "input"); put("stage", 0, "change");
  setTimeout(() => {
    const before = ink("difference");
    put("stage", 1, "change");
    setTimeout(() => {
      const after = ink("difference");
      document.querySelectorAll("#heatmaps .cell")[8].dispatchEvent(new Event("click"));
      byId("theme").click();
      const clicked = [shared.view, shared.frame, byId("view-value").textContent];
      const charts = document.querySelectorAll("svg").length;
      document.body.dataset.seen = JSON.stringify([seen, start, before, after, clicked, charts]);
    }, 300);
  }, 300);
}, 500);
</script></body>"""


def test_sliders_and_heat_maps_work_in_a_browser(tmp_path):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no chromium here")
    path = write_page(example.write(tmp_path, example.missing()))
    path.write_text(path.read_text().replace("</body>", PROBE))
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=6000", "--dump-dom"]
    dom = subprocess.run([*command, path.as_uri()], capture_output=True, text=True, timeout=120).stdout
    errors, start, before, after, clicked, charts = json.loads(
        html.unescape(re.search(r'data-seen="([^"]*)"', dom).group(1))
    )
    assert errors == []
    assert start == {"view": 2, "frame": 5}  # the worst picture of the camera that was kept aside
    assert before > 2 * after  # the disc is 2.4 pixels off before, 0.4 after
    assert clicked == [1, 2, "2 (kept aside)"]  # six frames a row
    assert charts == 2 + 2 + 3  # heat maps, timeline and course, three parameters


def test_points_are_told_before_and_after():
    result = example.missing()
    assert sections.points_table(result) == ""
    result["points"] = ["nose", "cloud"]
    for stage, errors in zip(result["stages"], ([12.0, None], [3.0, 1.25]), strict=True):
        stage |= {"by_point": errors, "point_floor": [0.5, 0.25]}
    table = sections.points_table(result)
    assert "<td>12.0</td><td>3.0</td><td>0.5</td>" in table and "<td>-</td><td>1.2</td><td>0.2</td>" in table
    assert table in render_page(result, {})
