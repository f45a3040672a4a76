"""Runs of a benchmark with a stand-in for ``fit``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pacnerf_lpo.paper_tables import execution
from pacnerf_lpo.paper_tables.plan import PlannedRun
from pacnerf_lpo.paper_tables.scenes import Scene
from pacnerf_lpo.paper_tables.tables import RunName

TORUS = Scene("torus", "data/torus", (), "truth.json", original=False)
BASE = RunName("torus", "3v")
LPO = RunName("torus", "3v", "lpo")
NONE = RunName("torus", "3v", "none")

Planner = Callable[..., list[PlannedRun]]


@pytest.fixture
def fake_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """``fit`` computes nothing, and its end is noticed at once."""
    monkeypatch.setattr(execution, "FIT", (sys.executable, str(Path(__file__).with_name("fake_fit.py"))))
    monkeypatch.setattr(execution, "POLL_SECONDS", 0.02)


@pytest.fixture
def plan(tmp_path: Path) -> Planner:
    """Plans runs of the torus: ``plan({BASE: 1, LPO: 4})``."""

    def make(rounds: dict[RunName, int], key: str = "k1") -> list[PlannedRun]:
        runs: dict[RunName, PlannedRun] = {}
        for name, number in rounds.items():
            config = {
                "outer_loop": {"rounds": number, "run_dir": "x", "carry": "particles"},
                "phases": {
                    "velocity": {"init_args": {"hit_frame": 4}},
                    "correction": {"class_path": "LPOModule"} if name.correction not in ("", "none") else None,
                },
                "data": {"frames": 12},
            }
            start = None if name == name.beginning else runs[name.beginning]
            run_dir = tmp_path / "runs" / f"{str(name).replace(' ', '-')}-{key}"
            runs[name] = PlannedRun(name, TORUS, (), number, config, key, run_dir, start)
        return list(runs.values())

    return make
