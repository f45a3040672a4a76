"""The command: its options, its mistakes, its exit status, and one benchmark with real runs."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.commands import _spelled_out
from pacnerf_lpo.commands.benchmark import run

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ["--configs", str(ROOT / "configs")]
SMOKE = ["--overlay", str(ROOT / "tests" / "smoke.yaml")]


def test_options_may_be_spelled_with_dashes_and_lists_as_words():
    words = ["--data-root", "a-b", "--overlay", "one.yaml", "two.yaml", "--dry-run", "--jobs=2"]
    assert _spelled_out(run, words) == [
        *("--data_root", "a-b", "--overlay", "['one.yaml', 'two.yaml']", "--dry_run", "true", "--jobs", "2")
    ]
    assert _spelled_out(run, ["--overlay", "[one.yaml]", "--dry_run", "false"])[1::2] == ["[one.yaml]", "false"]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--suite", "table3"], "there is no suite table3; known are table4"),
        (["--suite", "table5"], "wants --data-root"),
        (["--suite", "table5", "--data-root", "nowhere"], "nowhere: there is no such folder"),
        (["--suite", "quick", "--scenes", "torus"], "--scenes torus: no scene of the suite quick; it has bird"),
        (["--suite", "quick", "--jobs", "0"], "--jobs 0: give 1 or more"),
        (["--suite", "quick", "--configs", "nowhere"], "nowhere/fit.yaml: no such file; --configs"),
        (["--suite", "quick", *CONFIGS, "--overlay", "mine.yaml"], "mine.yaml: no such file"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], expected: str):
    assert main(["benchmark", *words, "--output", str(tmp_path / "out")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and expected in lines[0], lines


def test_a_failed_run_is_in_the_tables_and_in_the_exit_status(
    tmp_path: Path, fake_fit: None, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "control.json").write_text(json.dumps({"fail": ["bird-6v-lpo"]}))
    words = ["benchmark", "--suite", "quick", *CONFIGS, "--output", str(tmp_path)]
    assert main(words) == 1
    shown = capsys.readouterr()
    assert "1 of 2 runs failed" in shown.err.splitlines()[-1]
    assert "1: failed: |v| dt > dx" in (tmp_path / "tables" / "quick_images.md").read_text()
    (tmp_path / "control.json").unlink()
    assert main(words) == 0
    assert "failed" not in (tmp_path / "tables" / "quick_images.md").read_text()


@pytest.mark.slow
def test_real_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    """Both runs of the suite `quick`, each phase for one moment, with one thread as tiny tensors like it."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    words = ["benchmark", "--suite", "quick", *CONFIGS, *SMOKE, "--output", str(tmp_path)]
    assert main([*words, "--dry-run"]) == 0
    listed = capsys.readouterr().out
    assert listed.count("missing") == 2 and "starts from bird 6v baseline" in listed
    assert main(words) == 0
    tables = capsys.readouterr().out
    row = next(line for line in tables.splitlines() if line.startswith("| bird | PSNR"))
    assert "**" in row and "n/a" not in row
    (lpo,) = (tmp_path / "runs").glob("bird-6v-lpo-*")
    (base,) = (tmp_path / "runs").glob("bird-6v-baseline-*")
    phases = json.loads((lpo / "manifest.json").read_text())["phases"]
    assert [phase["copied_from"] for phase in phases] == [base.name] * 3 + [None]
    first, second = (json.loads((run_dir / "results.json").read_text())["phases"] for run_dir in (base, lpo))
    assert first == second[:3]  # evaluated from the same states
    assert main([*words, "--dry-run"]) == 0
    assert capsys.readouterr().out.count("finished") == 2
