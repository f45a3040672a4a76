"""From a drawn scene to a verdict, with the commands that a user gives. Minutes: deselect it with
``-m "not end_to_end"``.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from markupsafe import escape

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.commands import diagnose
from pacnerf_lpo.diagnosis.catalogue import read_candidates
from pacnerf_lpo.diagnosis.posterior import keep_intervals
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.manifest import INTERVALS_FILE
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.report import diagnosis_result, wording

pytestmark = pytest.mark.end_to_end
ROOT = Path(__file__).resolve().parents[1]
DRAG = 2.5
SCENE = (
    "--shape Ball --shape.radius 0.18 --material NeoHookean --material.E 1e5 --effects+=LinearDrag "
    f"--effects.drag {DRAG} --height 0.8 --velocity [0.6,-0.5,0.0] --frames 11 --views 6 --image_size 96 --dx 0.055 "
    "--substep_rate 1920"
)
CANDIDATES = "- class_path: LinearDrag\n- class_path: UniformForce\n"


def settings(scene: Path) -> dict:
    """What differs from configs/demo_missing.yaml."""
    length = {"steps": 200, "scaling_steps": [80, 140], "halvings": 1}
    static = {
        "base_spacing": 0.08,
        "rays_per_step": 512,
        "length": {"class_path": "TrainingLength", "init_args": length},
    }
    return {
        "data": {
            "root": str(scene),
            "train_views": [0, 1, 2, 3, 4],
            "box_lower": [-0.3, 0.5, -0.3],
            "box_upper": [0.3, 1.1, 0.3],
            "fit_box": False,
        },
        "physics": {"substep_rate": 1440.0},
        "phases": {
            "static": {"class_path": "StaticGridModule", "init_args": static},
            "velocity": {"class_path": "VelocityModule", "init_args": {"hit_frame": 6}},
        },
    }


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the diagnosis of a ball that falls with a hidden drag; 500 particles, two candidates."""
    folder = tmp_path_factory.mktemp("end_to_end")
    scene, run_dir, candidates, small = (folder / name for name in ("scene", "run", "candidates.yaml", "small.yaml"))
    assert main(["synthesize", str(scene), *SCENE.split()]) == 0
    small.write_text(yaml.safe_dump(settings(scene)))
    candidates.write_text(CANDIDATES)
    configs = [ROOT / "configs/fit.yaml", ROOT / "configs/demo_missing.yaml", small]
    words = [word for config in configs for word in ("--config", str(config))]
    assert main(["fit", *words, "--outer_loop.run_dir", str(run_dir)]) == 0
    diagnose.run(str(run_dir), candidates=str(candidates), particles=500, replicates=6, effects=1, jobs=1)
    return run_dir / "diagnosis"


def test_the_hidden_drag_is_named_with_its_size(diagnosed: Path):
    result = json.loads((diagnosed / "diagnosis.json").read_text())
    verdict = result["verdict"]
    assert (verdict["kind"], verdict["effects"]) == ("missing", ["LinearDrag"])
    assert verdict["p_value"] < 0.01 and verdict["removed"] > 0.5
    assert result["rounds"][0]["accepted"] == "LinearDrag"
    (drag,) = (entry for entry in result["rounds"][-1]["parameters"] if entry["name"] == "drag")
    assert drag["value"] == pytest.approx(DRAG, rel=0.1)  # bodies of 500 particles, known from 200 steps of training
    assert drag["low"] > 0


def test_the_page_says_so(diagnosed: Path):
    page = (diagnosed / "diagnosis.html").read_text()
    sentence = json.loads((diagnosed / "diagnosis.json").read_text())["verdict"]["sentence"]
    assert "linear drag" in sentence.lower() and escape(sentence) in page


def test_the_overlay_adds_the_drag_and_lets_the_next_fit_identify_it(diagnosed: Path, tmp_path: Path):
    content = yaml.safe_load((diagnosed / "effects.yaml").read_text())
    assert content["outer_loop"] == {"rounds": 1}  # the run has none: it was only made to be diagnosed
    overlay = content["physics"]
    path = tmp_path / "effects.yaml"
    path.write_text(yaml.safe_dump(overlay["effects"]))
    (found,) = read_candidates(path, NeoHookean(), ())
    assert found.name == "LinearDrag" and found.effect.guess["drag"] == pytest.approx(DRAG, rel=0.1)


def test_nothing_is_simulated_again(diagnosed: Path, monkeypatch):
    """All steps are on disk."""
    monkeypatch.setattr("pacnerf_lpo.diagnosis.store.packed", None)  # what a step that is done again would call
    kept: list[dict] = []
    written = diagnosis_result.write

    def write(problem, folder, rounds, finished):
        written(problem, folder, rounds, finished)
        kept.append(json.loads((folder / "diagnosis.json").read_text())["verdict"])

    monkeypatch.setattr("pacnerf_lpo.commands.diagnose.write", write)
    run_dir, before = diagnosed.parent, (diagnosed / "diagnosis.json").read_text()
    candidates = str(run_dir.parent / "candidates.yaml")
    diagnose.run(str(run_dir), candidates=candidates, particles=500, replicates=6, effects=1, jobs=1)
    after = (diagnosed / "diagnosis.json").read_text()
    verdicts = [json.loads(text)["verdict"] for text in (before, after)]
    assert verdicts[0] == verdicts[1]
    *stopped, ended = kept  # what a diagnosis that is stopped after a round leaves, and one that is not
    assert ended["finished"] and wording.GOES_ON not in ended["details"]
    assert stopped and not any(one["finished"] for one in stopped)
    assert all(wording.GOES_ON in one["details"] for one in stopped if one["kind"] != "unfinished")


def test_the_fit_of_the_intervals_takes_the_place_of_the_phase_once(diagnosed: Path, tmp_path: Path, monkeypatch):
    copied = tmp_path / "run"
    shutil.copytree(diagnosed.parent, copied)
    monkeypatch.setattr(Run, "by_outlines", True)
    had = Run(copied).uncorrected.state
    keep_intervals(Run(copied), lambda _: None, particles=500)
    stage = Run(copied).uncorrected
    content = json.loads((copied / INTERVALS_FILE).read_text())
    found = content["parameters"]
    assert content["phase"] == stage.stem and stage.record.before is not None
    for one in found.values():
        low, high = one["with_solver"]
        assert low <= one["low"] <= one["value"] <= one["high"] <= high
    assert stage.state.physics["E"] == pytest.approx(found["E"]["value"], rel=1e-6)
    assert stage.state.velocity.mean(0).tolist() == pytest.approx([found[f"v_{k}"]["value"] for k in "xyz"], abs=1e-5)
    assert stage.record.before["v_x"] == pytest.approx(float(had.velocity.mean(0)[0]))
    files = [stage.state_path, copied / INTERVALS_FILE]
    before = [path.read_bytes() for path in files]
    keep_intervals(Run(copied), lambda _: None, particles=500)
    assert [path.read_bytes() for path in files] == before


def test_after_images_the_fit_of_the_intervals_searches(diagnosed: Path, tmp_path: Path):
    """What images say may lie in another valley of the outlines than the best one. What was corrected with it stays."""
    copied, said = tmp_path / "run", list[str]()
    shutil.copytree(diagnosed.parent, copied)
    run = Run(copied)
    had, corrected = run.uncorrected, run.manifest.done[-1]
    path = f"states/{corrected.index + 1:02d}_r1_correction.pt"
    had.state.with_(corrected=True).save(copied / path)
    run.manifest.phases.append(replace(corrected, index=corrected.index + 1, phase="correction", state=path))
    run.manifest.save()
    keep_intervals(Run(copied), said.append, particles=500)
    stage = Run(copied).uncorrected
    assert any("on a coarse body" in line for line in said)
    assert stage.stem == had.stem and stage.state.physics == had.state.physics and stage.record.before is None
