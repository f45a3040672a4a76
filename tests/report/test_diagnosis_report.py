"""The page of a diagnosis: what each verdict says on the first screen, and that its parts work in a browser."""

from __future__ import annotations

import copy
import html
import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.report import diagnosis_sections as sections
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.diagnosis import RESULT, render_page, write_page
from pacnerf_lpo.report.tensorboard_images import excess_picture, log_diagnosis
from tests.report import diagnosis_example as example

KINDS = ("missing", "camera", "nothing", "unknown", "unfinished")


def result_of(kind):
    return example.missing() if kind == "missing" else example.other(kind)


@pytest.mark.parametrize("kind", KINDS)
def test_page_of_every_verdict_says_it_first_and_needs_no_network(kind, tmp_path):
    result = result_of(kind)
    page = write_page(example.write(tmp_path / kind, result)).read_text()
    body = page[page.index("<body>") :]
    assert f"<h1>{escape(result['verdict']['sentence'])}</h1>" in body[:900]
    assert words.LIGHTS[kind].caption in body[:900]
    assert not re.search(r"kept aside|\btwins?\b|misfit|matter", body)
    assert "$" not in re.sub(r"\$\{", "", page[: page.index('<script type="application/json"')])
    assert "drag_&lt;torus&gt;" in body and "<torus>" not in body[: body.index("<script")]
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", page)
    assert len(page) < 6_000_000


def test_a_result_of_an_earlier_version_is_not_read(tmp_path):
    (tmp_path / RESULT).write_text(json.dumps({**example.other("nothing"), "format": 2}))
    with pytest.raises(UserInputError, match="format 2, this version reads 3: run pacnerf-lpo diagnose again"):
        write_page(tmp_path)


def test_a_faulty_reconstruction_is_no_green_light():
    verdict = example.other("nothing")["verdict"]
    assert words.light(verdict).colour == "good"
    assert words.light({**verdict, "doubt": True}) == words.DOUBT and words.DOUBT.colour == "fair"


def test_a_cause_that_leaves_more_than_noise_is_not_all():
    verdict = example.missing()["verdict"]
    assert words.light(verdict).caption == "cause found"
    assert words.light({**verdict, "more_than_noise": True}) == words.PARTIAL


def test_first_screen_has_distances_in_pixels():
    found = words.distance_of(example.missing())
    assert (found.before, found.floor, found.after) == (1.0, 0.2, 0.4)
    assert "1.00 pixels from where they should be" in words.distance(example.missing())
    assert "5.0 times as far away as that, which is too much for chance" in words.distance(example.missing())
    assert words.distance(example.other("nothing")).endswith("the video is no farther away.")
    assert "falls from 1.00 to 0.40 pixels" in words.changes(example.missing())


def test_a_distance_that_chance_explains_is_not_called_too_large():
    result = example.missing()
    result["rounds"][0]["check_held"] = example.check(1.5, 0.2)
    said = words.distance(result)
    assert "5.0 times as far away as that, which chance explains." in said
    assert said.endswith("In the fitted data the residual is larger than chance explains.")
    result["rounds"][0]["check"] = example.check(1.0, 0.5)
    said = words.distance(result)  # an effect was named for its pattern
    assert said.endswith("Chance would explain that size, but not that the error looks like linear drag.")


def test_a_distance_that_rises_while_the_weighted_error_falls_is_explained():
    result = example.missing()
    result["stages"][1]["error"]["held"] = 1.2
    said = words.changes(result)
    assert "rises from 1.00 to 1.20 pixels" in said and "beyond noise falls by 64%" in said
    assert "falls by" not in words.changes(example.missing())


def test_points_alone_are_in_millimetres_and_of_no_camera(tmp_path: Path):
    result = {**example.missing(), "unit": "mm", "points": ["point 7", "point 9", "clouds 1", "clouds 2"]}
    for stage in result["stages"]:
        stage["by_point"], stage["point_floor"] = 4 * [1.0], 4 * [0.5]
    said = words.compared(result)
    assert "2 tracked points and point clouds in" in said and "Every third" in said and "camera" not in said
    said = words.compared({**result, "points": ["clouds 1", "clouds 2"]})
    assert "of point clouds in" in said and "Every third" not in said
    assert "the points are typically 1.00 mm from where" in words.distance(result)
    page = write_page(example.write(tmp_path, result)).read_text()
    assert "Distance over time [mm]" in page and "1.00 mm</b>" in page and " px" not in sections.first_screen(result)


def test_a_wrong_camera_is_judged_by_its_own_view():
    found = words.distance_of(example.other("camera"))
    assert (found.before, found.floor, found.after, found.where) == (3.0, 0.25, 0.5, "in camera 5")


def test_only_what_the_recording_does_not_separate_is_an_alternative():
    result = example.missing()
    assert "gravity" not in " ".join(words.missing(result)) and words.experiments(result) == []
    result["rounds"][0]["indistinguishable"] = ["LinearDrag", "GravityMagnitude"]
    assert words.missing(result)[0].startswith("Linear drag (or gravity magnitude: this recording does not separate")
    assert words.experiments(result) == [("linear drag and gravity magnitude", "the experiment for LinearDrag")]
    assert "linear drag and gravity magnitude: the odds of the added one" in words.indistinguishable(
        result["rounds"][0]
    )


def test_an_effect_that_was_removed_again_is_not_said_to_be_missing():
    result = example.missing()
    result["rounds"].append({**copy.deepcopy(result["rounds"][0]), "accepted": None, "removed": ["LinearDrag"]})
    assert words.refits_of(result) == []


@pytest.mark.parametrize(
    ("factor", "text"),
    [(math.log(67), "67 to 1"), (0.0, "1.0 to 1"), (-math.log(12), "1 to 12"), (40.0, "more than a million to 1")],
)
def test_odds_in_words(factor, text):
    assert words.odds(factor) == text


def test_without_an_effect_the_best_one_is_compared_with_chance():
    said = " ".join(words.missing(example.other("nothing")))
    assert "5 effects and camera faults were tried" in said
    assert "before any was fitted, linear drag, has odds of 7.4 to 1" in said  # exp(40 / 20)
    assert "chance alone would do this in about 1 of 4 recordings" in said
    said = words.missing(example.other("unknown"))[0]
    assert "a smooth force of unknown cause, for which the odds are more than a million to 1" in said


@pytest.mark.parametrize(
    ("p", "text"), [(0.7, "more often than not"), (0.013, "1 of 77 "), (0.0021, "1 of 500 "), (1e-9, "less than 1 of")]
)
def test_probabilities_in_words(p, text):
    assert text in words.chance(p)


def test_parameters_in_sentences_carry_their_labels():
    sentence = "raising Poisson's ratio while lowering Young's modulus changes nothing that this recording shows"
    assert words.undetermined(example.missing()) == [sentence]


def test_ranking_marks_threshold_cameras_discrepancies_and_refits():
    done = example.missing()["rounds"][0]
    done["refits"][0]["log_bayes_factor"] = 60.0  # in units of its own noise; its odds count
    text = sections.ranking(done)
    assert re.findall(r'<div class="rank ([a-z ]+)"', text) == [
        "physics passed",
        "physics passed",
        "discrepancy passed linear",
        "physics linear",
        "camera linear",
        "physics linear",
        "discrepancy linear",
    ]
    assert re.findall(r"<b>([^<]+)</b>", text) == ["44.0", "33.0", "25.0", "4.0", "2.0", "&minus;1.0", "&minus;2.0"]
    assert text.count("<em>added</em>") == 1
    most = 1.08 * 44.0  # the axis ends 8 % beyond the longest bar
    assert f'style="left:{100 * 5 / most:.1f}%"' in text
    assert "a trace &lt;of&gt; InitialSpin" in text
    assert "No effect has been tried" in sections.ranking(example.other("unfinished")["rounds"][0])


def test_a_round_without_candidates_still_shows_the_discrepancies():
    done = example.missing()["rounds"][0]
    done["screen"] |= {"candidates": [], "correlations": []}
    done |= {"refits": [], "accepted": None, "indistinguishable": []}
    assert sections.ranking(done).count("rank discrepancy") == 2
    assert "matrix" not in sections.confounding(done["screen"])


def test_refits_show_cost_evidence_coefficient_and_outcome_with_the_accepted_one_first():
    done = example.missing()["rounds"][0]
    done["refits"][0]["notes"] = ["Drag rate: 50 1/s is a bound of what is possible."]
    text = sections.refit_table(done)
    assert text.index("linear drag") < text.index("gravity magnitude")
    assert "900 → 300" in text and "<td>44.0</td>" in text and "&lt; 0.0001" in text
    assert "1.5 1/s" in text and "1.2 1/s … 1.8 1/s" in text and "70 kPa" not in text.replace("7e4", "")
    assert "is a bound of what is possible" in text
    assert sections.outcome(done["refits"][1], done) == "added"
    assert sections.outcome(done["refits"][0], done) == "60 000 to 1 for the added one"  # exp(44 - 33)
    assert sections.outcome({**done["refits"][0], "p_value": 0.3}, done) == "p above 1%: chance explains it"
    done["indistinguishable"].append("GravityMagnitude")
    assert sections.outcome(done["refits"][0], done) == "not separated from the added one"


def test_intervals_that_are_wider_than_the_noise_alone_would_make_them_are_said_to_be():
    result = example.missing()
    assert "times as wide" not in sections.parameter_table(result)
    result["rounds"][-1]["disagreement"] = 6.25
    assert "2.5 times as wide" in sections.parameter_table(result)


def test_effort_is_summed_over_the_steps():
    text = sections.effort_table(example.missing())
    assert "<td>compare (fit, null replicates)</td><td>40 s</td><td>60</td>" in text
    assert "<td>all</td><td>90 s</td><td>100</td>" in text


def test_a_parameter_at_its_bound_is_visible(tmp_path: Path):
    result = example.missing()
    result["rounds"][0]["refits"][1]["notes"] = ["Drag rate: 50 1/s is a bound of what is possible."]
    page = render_page(result, {})
    assert page.count("Drag rate: 50 1/s is a bound of what is possible.") == 2  # with the parameters and in the table


def test_parameters_before_and_after_with_intervals():
    text = sections.parameter_table(example.missing())
    assert "34 kPa" in text and "23.8 kPa … 44.2 kPa" in text and "70 kPa" in text
    assert "1.5 1/s" in text  # the effect's coefficient has no value before
    alone = sections.parameter_table(example.other("nothing"))
    assert "70 kPa" not in alone and "after" not in alone


def test_what_another_solver_does_is_in_the_intervals_of_a_body_that_deforms_and_drawn_apart():
    result = example.other("nothing")
    assert "thin lines" in sections.parameter_table(result)
    ((_, _, value, low, high, least, most),) = sections.interval_places(result["rounds"][0]["parameters"][0], None)
    assert least < low < value < high < most
    for done in result["rounds"]:
        for one in done["parameters"]:
            one |= {"solver": 0.0, "with_solver": [one["low"], one["high"]]}  # a rigid body
    assert "solver" not in sections.parameter_table(result)


def test_bounds_count_from_the_null_and_leave_out_non_local_effects():
    result = example.other("nothing")
    result["rounds"][0]["screen"]["candidates"][3]["coefficients"][0]["null"] = 1.0
    text = sections.bounds_table(result)
    assert "<td>gain</td><td>0.75</td><td>1.75</td>" in text
    assert "yield" not in text
    result["rounds"][0]["screen"]["candidates"][0]["one_sided"] = True
    assert "<td>drag rate</td><td>0 1/s</td><td>0.75 1/s</td>" in sections.bounds_table(result)


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


@pytest.mark.slow
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
    assert start == {"view": 2, "frame": 5}  # the worst picture of the held-out camera
    assert before > 2 * after  # the disc is 2.4 pixels off before, 0.4 after
    assert clicked == [1, 2, "2 (held out)"]  # six frames a row
    assert charts == 2 + 2 + 3  # heat maps, timeline and course, three parameters


def test_points_stand_before_and_after():
    result = example.missing()
    assert sections.points_table(result) == ""
    result["points"] = ["nose", "cloud"]
    for stage, errors in zip(result["stages"], ([12.0, None], [3.0, 1.25]), strict=True):
        stage |= {"by_point": errors, "point_floor": [0.5, 0.25]}
    table = sections.points_table(result)
    assert "<td>12.0</td><td>3.0</td><td>0.5</td>" in table and "<td>-</td><td>1.2</td><td>0.2</td>" in table
    assert table in render_page(result, {})
