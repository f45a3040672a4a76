"""What a user sees when the command line or the configuration is wrong: one line, and a status that is not 0."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib import import_module
from inspect import signature
from pathlib import Path

import pytest

from pacnerf_lpo.__main__ import COMMANDS, main
from pacnerf_lpo.commands.help import SECTIONS, command_help
from pacnerf_lpo.errors import UserInputError
from tests import fake_run

MATERIAL = "physics:\n  material:\n    class_path: {}\n    init_args:\n      {}\n"


@pytest.fixture
def complain(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Runs ``fit`` with one more configuration file or option, and returns the one line it prints."""

    def run(*words: str, config: str | None = None) -> str:
        extra = list(words)
        if config is not None:
            (tmp_path / "mine.yaml").write_text(config)
            extra += ["--config", str(tmp_path / "mine.yaml")]
        status = fake_run.main([*fake_run.arguments(tmp_path / "run"), *extra])
        lines = capsys.readouterr().err.strip().splitlines()
        assert status == 2
        assert len(lines) == 1, lines
        assert not (tmp_path / "run").exists()
        return lines[0]

    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "expected"),
    [
        ("physics:\n  roh: 900\n", "mine.yaml, line 2: unknown key physics.roh; did you mean physics.rho?"),
        ("physcs:\n  rho: 900\n", "unknown key physcs.rho; did you mean physics.rho?"),
        ("outer_loop:\n  runds: 2\n", "unknown key outer_loop.runds; did you mean outer_loop.rounds?"),
        ("trainer:\n  logger: false\n", "unknown key trainer.logger"),
        (
            MATERIAL.format("FakeMaterial", "nuu: 0.1"),
            "line 5: unknown key physics.material.init_args.nuu; did you mean",
        ),
        (
            MATERIAL.format("FakeMaterail", "nu: 0.1"),
            "known are FakeMaterial; a class of your own has its module before it, MODULE.FakeMaterail; did you mean",
        ),
        (
            "physics:\n  material:\n    class_path: fractions.Fraction\n",
            "line 3: physics.material: fractions.Fraction is no FakeMaterial; known",
        ),
        (
            "physics:\n  material:\n    class_path: fractions.Bruch\n",
            "line 3: physics.material: fractions.Bruch cannot be imported: ",
        ),
        (
            "physics:\n  material:\n    class_path: nowhere.Rubber\n",
            "nowhere.Rubber cannot be imported: No module named 'nowhere'; modules",
        ),
        (MATERIAL.format("FakeMaterial", "E: stiff"), "line 5: physics.material.E: expected float, got stiff"),
        (MATERIAL.format("FakeMaterial", "E: -1e5"), "E = -100000 Pa is not a possible Young's modulus"),
        ("data: [a: {\n", "mine.yaml, line 2: not valid YAML"),
        ("just words\n", "mine.yaml: expected sections"),
        ("outer_loop:\n  rounds: ${nowhere.rounds}\n", "outer_loop.rounds refers to nowhere.rounds, which is not set"),
        ("outer_loop:\n  rounds: -1\n", "outer_loop.rounds = -1"),
    ],
)
def test_mistake_in_a_config_file(complain, config: str, expected: str):
    assert expected in complain(config=config)


def test_an_unknown_phase(complain):
    """All classes that exist are named; which ones depends on what was imported before."""
    said = complain(config="phases:\n  static:\n    class_path: FakePhse\n")
    before, names = said.split("there is no FakePhse; known are ")
    assert before.endswith("phases.static: ") and "FakePhase" in names.replace(";", ",").split(", ")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["--config", "nowhere.yaml"],
            "--config nowhere.yaml: no such file, and no shipped configuration",
        ),
        (["--config=scenes/tors"], "did you mean scenes/torus"),
        (["-c", "."], ".: a folder, and no shipped"),
        (["--config", "demo_candidates"], "demo_candidates.yaml: expected sections"),
        (["--physics.roh=900"], "unknown key physics.roh; did you mean physics.rho?"),
        (["--outer_loop.rounds=two"], "outer_loop.rounds: expected int, got two"),
        (["--data.root=missing"], "missing: no such folder"),
        (["--resume", "nowhere"], "give no other option"),
    ],
)
def test_mistake_on_the_command_line(complain, words: list[str], expected: str):
    assert expected in complain(*words)


def test_phases_check_their_settings_before_anything_is_written(complain, monkeypatch: pytest.MonkeyPatch):
    def attach(phase, data, physics) -> None:
        raise UserInputError("hit_frame = 40 but the video has 14 frames; lower hit_frame")

    monkeypatch.setattr(fake_run.FakePhase, "attach", attach)
    assert "hit_frame = 40" in complain()


def test_missing_option(capsys: pytest.CaptureFixture[str]):
    assert fake_run.main(["--physics.material=FakeMaterial"]) == 2
    said = capsys.readouterr().err
    assert "missing: data.root, phases.physics" in said and "or give --data.root" in said
    assert "add to a --config file of your scene, for example root: scenes/drop" in said


def test_resume_needs_a_run_directory(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert fake_run.main(["--resume", str(tmp_path)]) == 2
    assert capsys.readouterr().err.strip() == f"pacnerf-lpo: {tmp_path} is not a run directory: it has no config.yaml"


def test_a_failed_evaluation_keeps_the_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def broken(run_dir: Path, truth: str | None) -> None:
        raise ValueError("no font")

    monkeypatch.setattr(fake_run, "finish", broken)
    assert fake_run.main(fake_run.arguments(tmp_path / "run")) == 1
    assert "the fit is complete but its evaluation failed" in capsys.readouterr().err
    assert '"finished"' in (tmp_path / "run" / "manifest.json").read_text()


def test_unknown_command(capsys: pytest.CaptureFixture[str]):
    assert main(["evalaute", "runs/demo"]) == 2
    assert capsys.readouterr().err.strip() == "pacnerf-lpo: there is no command evalaute; did you mean evaluate?"


HEAVY = ("torch", "numpy", "scipy", "matplotlib", "taichi", "pytorch_lightning", "jsonargparse", "PIL")


def test_help_loads_nothing_but_what_it_shows():
    """Of the program and of every command; ``configs`` alone is small enough to be loaded."""
    code = f"""import sys
from pacnerf_lpo.__main__ import COMMANDS, main
from pacnerf_lpo.commands.help import SECTIONS, command_help
for words in [["--help"], *([command, "--help"] for command in COMMANDS if command != "configs")]:
    assert main(words) == 0
    assert not (loaded := [name for name in {HEAVY} if name in sys.modules]), (words, loaded)
"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    assert all(name in shown.stdout for name in COMMANDS)


@pytest.mark.parametrize("command", sorted({*COMMANDS} - {"fit", "configs"}))
def test_help_describes_every_argument(command: str):
    shown = command_help(command, COMMANDS[command][1])
    for name in signature(import_module(COMMANDS[command][1]).run).parameters:
        assert re.search(rf"^  (--{name}|{name.upper()})\s+\w", shown, re.MULTILINE), name


def test_help_of_fit_describes_every_key_of_its_own_sections():
    shown = command_help("fit", COMMANDS["fit"][1])
    for section, path in SECTIONS.items():
        module, _, name = path.rpartition(".")
        kind = getattr(import_module(f"pacnerf_lpo.{module}"), name)
        for key in signature(kind).parameters:
            assert re.search(rf"^  --{section}\.{key}\s+\S", shown, re.MULTILINE), key


def test_help_all_of_fit_lists_the_trainers_options(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        main(["fit", "--help", "all"])
    assert ended.value.code == 0
    assert "--trainer.accelerator" in capsys.readouterr().out


def test_no_bar_is_drawn_into_a_log():
    drawing = "import pacnerf_lpo.__main__ as program; program.main = lambda: len(list(bar())) - 3; program.run()"
    command = f"def bar():\n    from tqdm import tqdm\n    return tqdm(range(3))\n{drawing}"
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr == ""


@pytest.mark.parametrize(("given", "used"), [(None, "passive"), ("active", "active")])
def test_waiting_threads_leave_their_cores_from_before_torch_is_loaded(given: str | None, used: str):
    command = """import os, sys
import pacnerf_lpo.__main__ as program
program.main = lambda: print(os.environ["OMP_WAIT_POLICY"], "torch" in sys.modules)
program.run()"""
    environment = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    if given is not None:
        environment["OMP_WAIT_POLICY"] = given
    done = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == [used, "False"], done.stderr
