"""Mistakes in a study on the command line: one line each, and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pacnerf_lpo.__main__ import main


def run_of(folder: Path, status: str) -> str:
    """A run directory with one finished phase, as far as a study looks before it reads the video."""
    record = {
        "index": 1,
        "round": 0,
        "phase": "velocity",
        "status": "done",
        "checkpoint": "",
        "state": "01_velocity.pt",
    }
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text(json.dumps({"format": 1, "status": status, "phases": [record]}))
    return str(folder)


@pytest.mark.parametrize(
    ("names", "options", "said"),
    [
        (["low", "high"], [], "several runs are a study; give a folder for its results with --out"),
        (["low", "high/../low"], ["--out", "both"], "is given twice; a study is of different recordings"),
        (["low", "broken"], ["--out", "both"], "broken: its fit failed; go on with `fit --resume"),
        (["low", "nowhere"], ["--out", "both"], "nowhere is not a run directory"),
        (["low", "high"], ["--out", "both", "--per-recording", "Wind"], "no such effect; did you mean"),
        (["low", "high"], ["--out", "both", "--tracks", "p.csv"], "--tracks and --clouds belong to one recording"),
        (["low"], ["--per-recording", "UniformForce"], "--per-recording is for several runs"),
    ],
)
def test_mistakes(
    names: list[str],
    options: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    for name, status in (("low", "finished"), ("high", "finished"), ("broken", "failed")):
        run_of(tmp_path / name, status)
    assert main(["diagnose", *names, *options]) == 2
    lines = [line for line in capsys.readouterr().err.split("\n") if line.strip()]
    assert len(lines) == 1 and said in lines[0], lines
    assert not (tmp_path / "both").exists() and not (tmp_path / "low" / "diagnosis").exists()


def test_a_plan_needs_a_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["plan", str(tmp_path)]) == 2
    assert "run `pacnerf-lpo diagnose` first" in capsys.readouterr().err
