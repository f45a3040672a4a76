"""From a recording to a fit: ``init`` and ``fit SCENE``, stopped and gone on with, and what the other commands make of
the scene folder."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.commands import diagnose
from pacnerf_lpo.commands import fit as fit_command
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.outer_loop import OuterLoop
from tests.data.recordings.studio import CONTACT

pytestmark = pytest.mark.slow

SMOKE = Path(__file__).parents[2] / "smoke.yaml"
ELASTIC = ("--physics.material=NeoHookean", "--physics.material.E=1e5", "--physics.material.nu=0.3")
TINY = ("--config", str(SMOKE), "--phases.correction=null", *ELASTIC)


@pytest.fixture
def scene(made, tmp_path: Path, small_threads: None) -> Path:
    """A scene that init wrote, moved since then."""
    return Path(shutil.copytree(made("opencv_plates").scene, tmp_path / "drop"))


def fit(scene: Path, *words: str) -> int:
    return main(["fit", str(scene), *words])


def moved_from(scene: Path, made) -> None:
    """Let the scene be where its file says it is."""
    file = scene / "scene.yaml"
    file.write_text(file.read_text().replace(str(made("opencv_plates").scene.resolve()), str(scene)))


def test_init_names_the_next_command(made, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["init", str(made("opencv_plates").source), str(tmp_path / "again")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"pacnerf-lpo fit {tmp_path / 'again'}"


def test_fit_stops_goes_on_and_ends(scene: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    begin = OuterLoop.begin

    def cut(loop: OuterLoop, step) -> None:
        if step.role == "physics":
            raise KeyboardInterrupt
        begin(loop, step)

    with monkeypatch.context() as patched:
        patched.setattr(OuterLoop, "begin", cut)
        assert fit(scene, "--preset", "cpu", *TINY) == 130
    first = capsys.readouterr().out.splitlines()
    said = next(line for line in first if "particles" in line)
    assert re.fullmatch(r"about [\d,]+ particles, about [\d.]+ GiB of memory, about .* on this machine .*", said)
    spacing = yaml.safe_load((scene / "scene.yaml").read_text())["phases"]["static"]["init_args"]["base_spacing"]
    assert Run(scene / "run").config["phases"]["static"]["init_args"]["base_spacing"] == spacing
    assert any(f"{SMOKE} changes phases.velocity.init_args.hit_frame from {CONTACT} (" in line for line in first)

    assert fit(scene, *TINY) == 0  # auto: the preset of the run that is there
    again = capsys.readouterr().out
    assert "r1_physics" not in again and "| E | 1e+05 Pa |" in again
    states = [stage.stem for stage in Run(scene / "run").stages]
    assert states == ["00_static", "01_velocity", "02_r1_physics"]

    assert fit(scene, "--preset", "cpu", *TINY) == 0
    finished = capsys.readouterr().out
    assert f"{scene / 'run'} is finished; to begin anew give another folder" in finished
    assert "about" not in finished and f"report: {scene / 'run' / 'report.html'}" in finished

    assert fit(scene, "--preset", "cpu", *TINY, "--physics.rho=900") == 2
    assert "begun with other settings (physics.rho was 1000.0, is 900.0)" in capsys.readouterr().err
    for command in ("evaluate", "report"):
        assert main([command, str(scene)]) == 0
    assert json.loads((scene / "run" / "results.json").read_text())["result"] == "02_r1_physics"
    assert main(["export", str(scene), "--output", str(scene / "tracks.csv")]) == 0


def test_diagnose_fits_what_it_needs(scene: Path, monkeypatch: pytest.MonkeyPatch):
    asked = []

    def prepare(runs, phase, options, out):
        asked.append([runs, out])
        raise UserInputError("far enough")

    real = fit_command.run
    monkeypatch.setattr(diagnose, "prepare", prepare)
    monkeypatch.setattr(fit_command, "run", lambda words: real([words[0], *TINY, *words[1:]]))
    assert main(["diagnose", str(scene)]) == 2
    assert asked == [[[str(scene / "run")], None]]
    assert [stage.stem for stage in Run(scene / "run").stages] == ["00_static", "01_velocity"]
    monkeypatch.setattr(fit_command, "run", None)  # it is there already
    assert main(["diagnose", str(scene), str(scene / "run"), "--out", str(scene)]) == 2
    assert asked[1] == [[str(scene / "run")] * 2, str(scene)]


def test_not_a_scene(made, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    source = made("opencv_plates").source
    assert fit(source) == 2
    assert (
        f"no scene.yaml there; make a scene of a recording with `pacnerf-lpo init {source} " in capsys.readouterr().err
    )
    assert fit(tmp_path / "nowhere") == 2
    assert "nowhere: no such folder; make a scene" in capsys.readouterr().err
    assert main(["evaluate", str(made("opencv_plates").scene)]) == 2
    assert "nothing is fitted there yet; first run `pacnerf-lpo fit" in capsys.readouterr().err


def test_missing_keys_are_named_with_place_and_example(scene: Path, made, capsys: pytest.CaptureFixture[str]):
    file = scene / "scene.yaml"
    file.write_text(re.sub(r" +(entropy|surface)_weight.*\n", "", file.read_text()))
    assert fit(scene) == 2
    said = capsys.readouterr().err
    assert "missing in section phases.static.init_args: entropy_weight, surface_weight; " in said
    assert f"add to {file}, for example entropy_weight: 0.001, surface_weight: 0.001" in said


def test_a_scene_in_millimetres_is_told_axes_and_units(scene: Path, made, capsys: pytest.CaptureFixture[str]):
    moved_from(scene, made)
    file, content = scene / "all_data.json", json.loads((scene / "all_data.json").read_text())
    for entry in content:
        entry["c2w"] = [[*row[:3], 1000 * row[3]] for row in entry["c2w"]]
    file.write_text(json.dumps(content))
    assert fit(scene) == 2
    said = capsys.readouterr().err
    assert "no training view sees the box" in said and "most likely axes or units differ: y must point up" in said


def test_several_scenes_are_reconstructed_and_identified_together(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    other, asked = shutil.copytree(scene, tmp_path / "higher"), []
    monkeypatch.setattr(diagnose, "run", lambda *runs, **options: asked.append((*runs, options)))
    both = str(tmp_path / "both")
    assert main(["fit", str(scene), str(other), "--out", both, "--preset", "cpu", *TINY]) == 0
    assert asked == [([str(scene), str(other)], {"until": "compare", "out": both})]
    for folder in (scene, other):
        stages = Run(folder / "run").stages
        assert [stage.record.phase for stage in stages][:2] == ["static", "velocity"]
        assert "physics" not in [stage.record.phase for stage in stages]


@pytest.mark.parametrize(
    ("names", "words", "said"),
    [
        (("drop", "drop2"), (), "give a folder for what they share with --out"),
        (("drop", "drop"), ("--out", "both"), "is given twice; a study is of different recordings"),
        (("drop", "nowhere"), ("--out", "both"), "nowhere: no such folder; make a scene of a recording"),
        (("drop", "drop2"), ("--out", "both", "--outer_loop.run_dir=x"), "--outer_loop.run_dir is for one scene"),
    ],
)
def test_mistakes_in_a_study(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch, names, words, said):
    monkeypatch.chdir(tmp_path)
    for name in ("drop", "drop2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.yaml").write_text("data: {}\n")
    assert main(["fit", *names, *words]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.glob("*/run")) and not (tmp_path / "both").exists()
