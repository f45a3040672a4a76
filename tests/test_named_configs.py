"""Shipped configurations go by name in every folder, wherever a command takes such a file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import pacnerf_lpo.commands.fit  # noqa: F401  (makes the short class names known)
from pacnerf_lpo import named_configs
from pacnerf_lpo.__main__ import main
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.commands import diagnose
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.named_configs import config_names, find_config, summary

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
NAMES = sorted(str(path.relative_to(CONFIGS).with_suffix("")) for path in CONFIGS.rglob("*.yaml"))


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder outside the repository."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def resolved(words: list[str]) -> str:
    """The complete configuration that ``fit`` makes of a command line."""
    return PhaseCLI([*words, "--data.root", "nowhere"], VideoModule, Physics).dump()


def test_every_file_has_a_name(elsewhere: Path):
    assert sorted(config_names()) == NAMES
    for name in NAMES:
        assert find_config(name, "--config") == CONFIGS / f"{name}.yaml"


@pytest.mark.parametrize("name", NAMES)
def test_every_file_begins_with_a_sentence_about_it(name: str):
    comment = " ".join((CONFIGS / f"{name}.yaml").read_text().replace("\n# ", " ").removeprefix("# ").split())
    assert comment.startswith(summary(name)) and len(summary(name)) > 15


def test_names_and_paths_mean_the_same(elsewhere: Path, monkeypatch: pytest.MonkeyPatch):
    names = ("fit", "scenes/torus", "cpu", "effects/linear_drag")
    by_name = resolved(["--config", "fit", "--config=scenes/torus", "-c", "cpu", "--config", "effects/linear_drag"])
    monkeypatch.chdir(ROOT)
    assert by_name == resolved([word for name in names for word in ("--config", f"configs/{name}.yaml")])
    assert "LinearDrag" in by_name


def test_a_file_wins_over_a_name_and_a_folder_does_not(elsewhere: Path):
    (elsewhere / "cpu").write_text("data:\n  frames: 5\n")
    (elsewhere / "scenes").mkdir()
    (elsewhere / "scenes" / "torus").mkdir()
    assert find_config("cpu", "--config") == Path("cpu")
    assert find_config("scenes/torus", "--config") == CONFIGS / "scenes" / "torus.yaml"
    assert "frames: 5\n" in resolved(["--config", "fit", "--config", "scenes/torus", "--config", "cpu"])


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "linear-drag",
            "no shipped configuration has that name; did you mean effects/linear_drag? `",
        ),
        ("torus", "did you mean scenes/torus or shared/torus or "),
        ("configs/fit.yaml", "did you mean fit? `pacnerf-lpo configs` lists them"),
        (
            "../../etc/passwd",
            "no shipped configuration has that name; `pacnerf-lpo configs` lists them",
        ),
        (".", ".: a folder, and no shipped configuration"),
    ],
)
def test_an_unknown_name_says_which_are_near(elsewhere: Path, name: str, said: str):
    with pytest.raises(UserInputError) as complaint:
        find_config(name, "--overlay")
    assert str(complaint.value).startswith(f"--overlay {name}: ") and said in str(complaint.value)


def test_those_inside_an_installed_package_come_first(elsewhere: Path, monkeypatch: pytest.MonkeyPatch):
    (elsewhere / "package" / "configs").mkdir(parents=True)
    (elsewhere / "package" / "configs" / "mine.yaml").write_text("# Mine. More of it.\n")
    (elsewhere / "configs").mkdir()
    monkeypatch.setattr(named_configs, "PACKAGE", elsewhere / "package")
    assert config_names() == ["mine"] and summary("mine") == "Mine."


def test_configs_are_listed_and_shown(elsewhere: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["configs"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert sorted(line.split()[0] for line in listed) == NAMES
    assert main(["configs", "effects"]) == 0
    effects = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in effects] == [name for name in NAMES if name.startswith("effects/")]
    assert "effects/linear_drag         Air drag in proportion to the velocity; identified from" in "\n".join(effects)
    assert main(["configs", "scenes/torus"]) == 0
    assert capsys.readouterr().out == (CONFIGS / "scenes" / "torus.yaml").read_text()
    assert main(["configs", "scene"]) == 2
    assert capsys.readouterr().err.startswith("pacnerf-lpo: pacnerf-lpo configs scene: no such file, and no shipped")


@pytest.mark.slow
def test_benchmark_takes_names(elsewhere: Path, capsys: pytest.CaptureFixture[str]):
    words = ["benchmark", "--suite", "quick", "--output", "out", "--dry-run"]
    (elsewhere / "mine.yaml").write_text((CONFIGS / "cpu_coarse.yaml").read_text())
    listed = []
    for overlay in ([], ["--overlay", "cpu_coarse"], ["--overlay", "mine.yaml"]):
        assert main([*words, *overlay]) == 0
        listed.append(capsys.readouterr().out)
    plain, by_name, by_path = listed
    assert plain != by_name == by_path and plain.count("missing") == 2


def test_diagnose_takes_names(elsewhere: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def prepare(runs, phase, options, out):
        raise UserInputError(json.dumps(options.candidates))

    monkeypatch.setattr(diagnose, "prepare", prepare)
    (elsewhere / "mine.yaml").write_text("- class_path: LinearDrag\n")
    for given, found in (("demo_candidates", str(CONFIGS / "demo_candidates.yaml")), ("mine.yaml", "mine.yaml")):
        assert main(["diagnose", "run", "--candidates", given]) == 2
        assert json.dumps(found) in capsys.readouterr().err
    assert main(["diagnose", "run", "--candidates", "candidates"]) == 2
    assert "--candidates candidates: no such file" in capsys.readouterr().err
