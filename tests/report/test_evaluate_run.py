"""Evaluation of a whole run: what results.json says agrees with the images it was made from."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from pacnerf_lpo.diagnosis.posterior import take_over
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.evaluation.evaluate import evaluate_run, intersection_over_union
from pacnerf_lpo.evaluation.prediction import predict
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.evaluation.tables import markdown_table, result_phase
from pacnerf_lpo.manifest import INTERVALS_FILE
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.quantities import quantity
from pacnerf_lpo.report.html import found_values, is_evaluated, parameter_table
from tests.report.example_run import write_example_run


@pytest.fixture
def results(evaluated_run):
    return json.loads((evaluated_run / "results.json").read_text())


def test_every_phase_is_measured_and_the_static_one_on_its_frame_only(results):
    assert [phase["stem"] for phase in results["phases"]] == [
        "00_static",
        "01_velocity",
        "02_r1_physics",
        "03_r1_correction",
    ]
    static, last = results["phases"][0], results["phases"][-1]
    assert static["image_metrics"] == {"train": None, "test": None}
    assert static["first_frame_metrics"]["test"]["psnr"] == pytest.approx(last["first_frame_metrics"]["test"]["psnr"])
    assert np.array(static["images"]["psnr"]).shape == (4, 1)
    assert np.array(last["images"]["psnr"]).shape == (4, 5)


def test_metrics_of_a_set_are_the_means_over_its_views(results):
    last = results["phases"][-1]
    psnr = np.array(last["images"]["psnr"])  # rows: views 0, 2, 4, 8
    assert last["image_metrics"]["train"]["psnr"] == pytest.approx(psnr[[0, 2, 3]].mean(), rel=1e-6)
    assert last["image_metrics"]["test"]["psnr"] == pytest.approx(psnr[1].mean(), rel=1e-6)
    assert last["first_frame_metrics"]["test"]["psnr"] == pytest.approx(psnr[1, 0], rel=1e-6)


def test_metrics_agree_with_the_images_kept_on_disk(evaluated_run, results):
    run = Run(evaluated_run)
    images = predict(run, run.last).images[1].astype(np.float64) / 255
    measured = run.data.video.images[1].double().numpy()
    psnr = -10 * np.log10(((images - measured) ** 2).mean(axis=(1, 2, 3)))
    # the kept images are rounded to 1/255: at 15 to 25 dB (rms 0.05 to 0.2) that changes the mean square by < 1 %
    np.testing.assert_allclose(results["phases"][-1]["images"]["psnr"][1], psnr, atol=0.05)


def test_parameters_have_units_and_errors_only_when_the_truth_was_given(evaluated_run, results, tmp_path):
    last = results["phases"][-1]
    assert last["parameters"]["E"]["unit"] == "Pa"
    assert last["parameters"]["E"]["value"] == pytest.approx(9.7e4)
    assert last["truth_errors"]["nu"]["error"] == pytest.approx(0.01, abs=1e-6)
    assert last["velocity_error"]["error"] == pytest.approx(0.0, abs=1e-6)
    copy = tmp_path / "run"
    shutil.copytree(evaluated_run, copy)
    blind = evaluate_run(copy)
    assert "truth_errors" not in json.dumps(blind) and "velocity_error" not in json.dumps(blind)


def test_the_printed_table_says_why_lpips_is_missing(results):
    for phase in results["phases"]:
        for metrics in (*phase["image_metrics"].values(), *phase["first_frame_metrics"].values()):
            if metrics is not None:
                metrics["lpips"] = "n/a (torchvision is not installed: pip install 'pacnerf-lpo[lpips]')"
    table = markdown_table(results)
    assert "LPIPS: n/a (torchvision is not installed: pip install 'pacnerf-lpo[lpips]')" in table
    assert table.count("torchvision") == 1
    assert "| E | 3e+04 Pa | 9.7e+04 Pa | 1e+05 Pa | 0.013 in log10 |" in table


def test_predictions_are_reused_until_the_state_changes(evaluated_run, tmp_path, monkeypatch):
    copy = tmp_path / "run"
    shutil.copytree(evaluated_run, copy)
    run = Run(copy)
    calls = []
    monkeypatch.setattr(Physics, "simulate", lambda self, state, frames: calls.append(1) or state.positions[None])
    predict(run, run.last)
    assert calls == []
    run.last.state.save(run.last.state_path)
    predict(run, run.last)
    assert calls == [1]


def test_a_motion_that_cannot_be_simulated_is_reported_and_the_rest_is_kept(tmp_path, example_motion, monkeypatch):
    folder = write_example_run(tmp_path / "run", frames=2)

    def fail(self, state, frames):
        raise SimulationError(1, 7, "|v| dt > dx (v = 310 m/s)")

    monkeypatch.setattr(Physics, "simulate", fail)
    results = evaluate_run(folder)
    assert "frame 1, substep 7" in results["phases"][-1]["error"]
    assert results["phases"][0]["first_frame_metrics"]["train"]["psnr"] > 0
    assert "frame 1, substep 7" in markdown_table(results)


def test_what_is_no_run_directory_is_refused(tmp_path):
    with pytest.raises(UserInputError, match="not a run directory"):
        evaluate_run(tmp_path)


def test_an_unknown_phase_or_view_names_the_known_ones(evaluated_run):
    run = Run(evaluated_run)
    with pytest.raises(UserInputError, match="no finished phase '07_lpo'; there are 00_static, "):
        run.stage("07_lpo")
    with pytest.raises(UserInputError, match=r"no view 7; it has \[0, 2, 4, 8\]"):
        run.view_index(7)


def test_intersection_over_union():
    one = torch.tensor([True, True, False, False])
    assert intersection_over_union(one, torch.tensor([True, False, True, False])) == pytest.approx(1 / 3)
    assert intersection_over_union(~one & one, ~one & one) == 1


def test_every_key_of_the_results_is_documented(results):
    text = (Path(__file__).parents[2] / "docs" / "formats.md").read_text()
    told = set(re.findall(r"`([\w\[\].]+)`", text[text.index("### results.json") : text.index("### diagnosis.json")]))
    told |= {name.removeprefix("phases[].") for name in told}
    assert set(results) | {key for phase in results["phases"] for key in phase} <= told


def test_intervals_are_in_results_table_and_report(evaluated_run, results, tmp_path):
    copied = tmp_path / "run"
    shutil.copytree(evaluated_run, copied)
    names = list(results["free"])
    parameters = {
        name: {"value": 2e5, "low": 1e5, "high": 3e5, "determined": index == 0, "with_solver": [0.9e5, 3.1e5]}
        for index, name in enumerate(names)
    }
    content = {"phase": "02_r1_physics", "level": 0.9, "parameters": parameters, "undetermined": []}
    assert is_evaluated(Run(copied))
    (copied / INTERVALS_FILE).write_text(json.dumps(content))
    os.utime(copied / INTERVALS_FILE, (time.time() + 10, time.time() + 10))
    assert not is_evaluated(Run(copied))
    again = evaluate_run(copied)
    assert again["intervals"] == content
    table = markdown_table(again)
    assert "| parameter | guess | identified | 90 % interval |" in table and "[9e+04, 3.1e+05] Pa |" in table
    assert table.count("not determined") == len(names) - 1
    page = parameter_table(again)
    assert "<th>90 % interval</th>" in page and page.count("not determined") == len(names) - 1
    assert "<th>of this solver alone</th>" in page and "90 kPa to 310 kPa" in page and "100 kPa to 300 kPa" in page
    found = {name: (value, between) for name, value, between in found_values(again)}
    assert found[names[0]][1] == "90 %: 90 kPa to 310 kPa" and found[names[1]][0] == "?"
    for one in again["intervals"]["parameters"].values():
        del one["with_solver"]  # an older run
    assert "solver" not in parameter_table(again)


def test_the_fit_of_the_intervals_is_the_result_and_what_the_phase_had_is_said(evaluated_run, tmp_path):
    copied = tmp_path / "run"
    shutil.copytree(evaluated_run, copied)
    run = Run(copied)
    stage, names = run.uncorrected, ("v_x", "v_y", "v_z")
    had = {**stage.state.physics, **dict(zip(names, stage.state.velocity.mean(0).tolist(), strict=True))}
    known = {name: 1.25 * value for name, value in had.items()}
    take_over(run, stage, known)
    again = Run(copied)
    assert not is_evaluated(again)
    state = again.uncorrected.state
    assert state.physics == {name: known[name] for name in stage.state.physics}
    spread = (state.velocity - state.velocity.mean(0)) - (stage.state.velocity - stage.state.velocity.mean(0))
    assert (
        state.velocity.mean(0).tolist() == pytest.approx([known[name] for name in names]) and spread.abs().max() < 1e-5
    )
    fit = {name: {"value": known[name], "low": 0.0, "high": 1.0, "determined": True} for name in known}
    results = {
        **evaluate_run(copied),
        "result": stage.stem,
        "intervals": {"phase": stage.stem, "level": 0.9, "parameters": fit},
    }
    phase = result_phase(results)
    assert phase["before"] == had and phase["parameters"]["E"]["value"] == known["E"]
    said = f"Before it the phase had E = {quantity(had['E'], 'Pa')}"
    assert said in markdown_table(results) and said in parameter_table(results)
