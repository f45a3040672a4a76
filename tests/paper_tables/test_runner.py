"""What is run, what is taken over, and what is left when a run fails or the benchmark is stopped."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path

import pytest

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.paper_tables import execution, runner
from pacnerf_lpo.paper_tables.plan import PlannedRun
from pacnerf_lpo.paper_tables.runner import Resources, run_all
from pacnerf_lpo.paper_tables.tables import RunName
from tests.paper_tables.conftest import BASE, LPO, NONE, Planner

pytestmark = pytest.mark.usefixtures("fake_fit")
OTHER = RunName("torus", "3v_dagger")


def failure_of(run: PlannedRun) -> str | None:
    """Why the last attempt at a run failed."""
    path = run.run_dir / execution.FAILURE_FILE
    return path.read_text() if path.exists() else None


def statuses(runs: list[PlannedRun], output: Path, resources: Resources | None = None) -> list[str]:
    outcomes = run_all(runs, output, resources or Resources())
    return [outcomes[run.run_dir].status for run in runs]


def phases(run: PlannedRun) -> list[dict]:
    return json.loads((run.run_dir / "manifest.json").read_text())["phases"]


def control(output: Path, **content) -> None:
    (output / "control.json").write_text(json.dumps(content))


def test_common_beginning_is_computed_once_and_said_to_be_copied(tmp_path: Path, plan: Planner):
    base, lpo, none = runs = plan({BASE: 1, LPO: 1, NONE: 2})
    assert statuses(runs, tmp_path) == ["finished"] * 3
    for run in (lpo, none):
        assert [phase["copied_from"] for phase in phases(run)[:3]] == [base.run_dir.name] * 3
        assert phases(run)[3]["copied_from"] is None
        for mine, first in zip(phases(run)[:3], phases(base), strict=True):
            assert mine["seconds"] == first["seconds"]  # those measured where it was computed
            for file in (mine["state"], mine["checkpoint"]):  # the stand-in writes random bytes
                assert (run.run_dir / file).read_bytes() == (base.run_dir / file).read_bytes()
    assert [phase["phase"] for phase in phases(lpo)] == ["static", "velocity", "physics", "correction"]


def test_what_is_finished_is_not_run_again_and_more_rounds_go_on(tmp_path: Path, plan: Planner):
    runs = plan({BASE: 1, LPO: 1})
    statuses(runs, tmp_path)
    state = runs[1].run_dir / phases(runs[1])[3]["state"]
    written = state.read_bytes()
    control(tmp_path, fail=["torus"])  # whatever runs now, fails
    assert statuses(runs, tmp_path) == ["finished"] * 2
    control(tmp_path)
    more = plan({BASE: 1, LPO: 3})
    assert not more[1].is_finished()
    assert statuses(more, tmp_path) == ["finished"] * 2
    assert [phase["round"] for phase in phases(more[1])] == [0, 0, 1, 1, 2, 2, 3, 3]
    assert state.read_bytes() == written
    assert runs[1].is_finished()  # one round is contained in three


def test_a_failed_run_is_one_line_and_the_others_go_on(tmp_path: Path, plan: Planner):
    runs = plan({BASE: 1, OTHER: 1, LPO: 1, RunName("torus", "3v_dagger", "lpo"): 1})
    control(tmp_path, fail=["torus-3v_dagger"])
    assert statuses(runs, tmp_path) == ["finished", "failed", "finished", "failed"]
    assert failure_of(runs[1]) == "|v| dt > dx (v = 310 m/s)"
    assert failure_of(runs[0]) is None
    control(tmp_path)
    assert statuses(runs, tmp_path) == ["finished"] * 4  # the same call tries again
    assert failure_of(runs[1]) is None


def test_results_of_another_key_are_left_alone(tmp_path: Path, plan: Planner):
    statuses(plan({BASE: 1}), tmp_path)
    other = plan({BASE: 1}, key="k2")
    assert not other[0].is_finished()
    assert statuses(other, tmp_path) == ["finished"]
    assert len(list((tmp_path / "runs").iterdir())) == 2


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_stops_and_the_same_call_goes_on(tmp_path: Path, plan: Planner, jobs: int):
    runs = plan({BASE: 1, OTHER: 1, LPO: 1})
    control(tmp_path, slow={"velocity": 60})
    velocity = runs[0].run_dir / "manifest.json"

    def interrupt() -> None:
        while not (velocity.exists() and len(phases(runs[0])) == 2):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    began = time.monotonic()
    assert statuses(runs, tmp_path, Resources(jobs)) == ["stopped"] * 3
    assert time.monotonic() - began < 50
    static = runs[0].run_dir / "states" / "00_static.pt"
    written = static.read_bytes()
    control(tmp_path)
    assert statuses(runs, tmp_path, Resources(jobs)) == ["finished"] * 3
    assert static.read_bytes() == written


def test_too_much_memory_is_a_failure(tmp_path: Path, plan: Planner):
    runs = plan({BASE: 1})
    control(tmp_path, slow={"static": 60})
    assert statuses(runs, tmp_path, Resources(memory=2**20)) == ["failed"]
    assert "the limit is 0.0 GiB" in str(failure_of(runs[0]))


def test_a_run_has_one_writer(tmp_path: Path, plan: Planner):
    runs = plan({BASE: 1})
    runs[0].prepare()
    with execution._locked(runs[0].run_dir):
        assert statuses(runs, tmp_path) == ["failed"]
    assert failure_of(runs[0]) == "another process runs it"


def test_threads_are_shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(runner.os, "sched_getaffinity", lambda _: set(range(8)))
    assert [Resources(jobs).threads for jobs in (1, 3, 20)] == [8, 2, 1]


@pytest.mark.parametrize(("backend", "module"), [("dask", "dask.distributed"), ("ray", "ray.util.joblib")])
def test_a_backend_that_is_not_installed(
    tmp_path: Path, plan: Planner, monkeypatch: pytest.MonkeyPatch, backend, module: str
):
    monkeypatch.setitem(__import__("sys").modules, module, None)  # importing it fails
    with pytest.raises(UserInputError, match=f"--backend {backend}: .* is not installed; pip install"):
        run_all(plan({BASE: 1}), tmp_path, Resources(2, backend))
