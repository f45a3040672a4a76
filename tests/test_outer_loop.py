"""The order of the phases, what crosses between them, and what is left when a run is interrupted, killed or fails."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pacnerf_lpo import manifest, outer_loop
from pacnerf_lpo.callbacks.phase import PhaseCheckpoint
from pacnerf_lpo.diagnosis.posterior import take_over
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.identification.problem import PARTICLES
from pacnerf_lpo.manifest import INTERVALS_FILE, Manifest
from pacnerf_lpo.outer_loop import OuterLoop, algorithm_1
from pacnerf_lpo.types import ParticleState
from tests import fake_run

STEMS = ["00_static", "01_velocity", "02_r1_physics", "03_r1_correction"]


pytestmark = pytest.mark.usefixtures("small_threads")


def read_manifest(run_dir: Path) -> dict:
    return json.loads((run_dir / "manifest.json").read_text())


def final_positions(run_dir: Path) -> torch.Tensor:
    return ParticleState.load(run_dir / "states" / f"{STEMS[-1]}.pt").positions


def start(words: list[str]) -> subprocess.Popen:
    root = Path(__file__).resolve().parents[1]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [
        sys.executable,
        "-c",
        "import sys; from pacnerf_lpo.__main__ import leave; from tests import fake_run as run; "
        "leave(run.main(sys.argv[1:]))",
        *words,
    ]
    return subprocess.Popen(command, cwd=root, env=environment, stderr=subprocess.PIPE, text=True)


def wait_for(path: Path, process: subprocess.Popen) -> None:
    """Until the file is there; the process must not end before."""
    deadline = time.monotonic() + 180
    while not path.exists():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_order_of_phases():
    stems = [step.stem for step in algorithm_1(2, correction=True)]
    assert stems == [*STEMS, "04_r2_physics", "05_r2_correction"]
    assert [step.role for step in algorithm_1(2, correction=False)] == ["static", "velocity", "physics", "physics"]


def test_grids_are_fitted_again_between_rounds_only():
    stems = [step.stem for step in algorithm_1(2, correction=True, refit=True)]
    assert stems == [*STEMS, "04_r1_refit", "05_r2_physics", "06_r2_correction"]
    assert algorithm_1(2, correction=True, refit=True)[4].template == "static"


@pytest.mark.slow
@pytest.mark.parametrize(("run_all", "rounds_run"), [(False, 3), (True, 4)])
def test_rounds_stop_when_the_held_out_error_does_not_fall(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_all: bool, rounds_run: int
):
    errors = iter((3.0, 2.0, 2.5, 1.0))
    monkeypatch.setattr(OuterLoop, "check", lambda *_: None)  # the fake video has no views
    monkeypatch.setattr(outer_loop, "held_out_images", lambda data: frozenset({(0, 1)}))
    monkeypatch.setattr(outer_loop, "held_out_error", lambda *_: next(errors))
    words = [*fake_run.arguments(tmp_path / "run"), "--outer_loop.rounds=4", "--outer_loop.stop_when=held_out"]
    words += [f"--outer_loop.run_all_rounds={run_all}", "--outer_loop.carry=refit_grid"]
    assert fake_run.main(words) == 0
    content = manifest.Manifest.load(tmp_path / "run")
    assert content.phases[-1].round == rounds_run and content.phases[-1].phase == "correction"
    assert content.status == "finished" and content.chosen_round == 2
    assert sum(record.held_out_error is not None for record in content.phases) == rounds_run  # corrections only


def test_run_directory_and_one_time_line(tmp_path: Path):
    run = tmp_path / "run"
    assert fake_run.main(fake_run.arguments(run, static="steps=5", velocity="steps=3")) == 0
    content = read_manifest(run)
    assert content["status"] == "finished"
    assert [Path(phase["state"]).stem for phase in content["phases"]] == STEMS
    assert {phase["status"] for phase in content["phases"]} == {"done"}
    for phase in content["phases"]:
        assert (run / phase["state"]).is_file() and (run / phase["checkpoint"]).is_file()
        torch.load(run / phase["checkpoint"], weights_only=True)
    events = EventAccumulator(str(run / "tensorboard")).Reload()
    assert [event.step for event in events.Scalars("static/loss")] == [0, 1, 2, 3, 4]
    assert [event.step for event in events.Scalars("velocity/loss")] == [5, 6, 7]
    assert events.Scalars("physics/loss")[0].step == 8


def test_each_phase_receives_what_the_last_one_gave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    received: list[ParticleState | None] = []
    take = fake_run.FakePhase.import_state
    monkeypatch.setattr(
        fake_run.FakePhase, "import_state", lambda phase, state: (received.append(state), take(phase, state))[1]
    )
    words = [*fake_run.arguments(tmp_path / "run"), "--outer_loop.rounds=2", "--outer_loop.physics_start=restart"]
    assert fake_run.main(words) == 0
    assert received[0] is None
    for number, state in enumerate(received[1:]):
        assert state is not None
        saved = ParticleState.load(next((tmp_path / "run" / "states").glob(f"{number:02d}_*.pt")))
        assert torch.equal(state.positions, saved.positions)
        restarts = number + 1 in (2, 4)  # the two identifications start from the initial guess
        assert state.physics == ({} if restarts else saved.physics)


@pytest.mark.parametrize(("intervals", "particles"), [("true", PARTICLES), ("500", 500), ("false", 0)])
def test_a_correction_begins_with_the_values_of_the_fit_that_intervals_come_from(
    intervals: str, particles: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    asked: list[tuple[str, int]] = []
    received: list[ParticleState] = []
    bounded: list[Mapping] = []
    take = fake_run.FakePhase.import_state

    def import_state(phase: fake_run.FakePhase, state: ParticleState) -> None:
        received.append(state)
        bounded.append(phase.within)
        take(phase, state)

    def look_back(manifest: Manifest, *rest: Any) -> None:
        asked.append((manifest.done[-1].phase, rest[-1]))
        if asked[-1] == ("physics", particles) and particles:
            run = Run(manifest.run_dir)
            (run.run_dir / INTERVALS_FILE).write_text('{"parameters": {"E": {"low": 6.0, "high": 8.0}}}')
            take_over(run, run.uncorrected, {"E": 7.0, "v_x": 1.0, "v_y": 2.0, "v_z": 3.0})

    monkeypatch.setattr(fake_run, "look_back", look_back)
    monkeypatch.setattr(fake_run.FakePhase, "import_state", import_state)
    words = [*fake_run.arguments(tmp_path / "run"), f"--intervals={intervals}", "--outer_loop.rounds=2"]
    assert fake_run.main(words) == 0
    # not before the identification; the real one passes over corrections and what follows them
    later = [("correction", 0), ("physics", particles), ("correction", particles)]
    assert asked == [("static", 0), ("velocity", 0), ("physics", particles), *later]
    assert (Manifest.load(tmp_path / "run").done[2].before is not None) == bool(particles)
    assert (received[3].physics["E"] == 7.0) == bool(particles)
    assert received[3].velocity.tolist() == [[1.0, 2.0, 3.0] if particles else [0.0, 0.0, 0.0]]
    inside = {"E": (6.0, 8.0)} if particles else {}
    assert bounded == [{}, {}, {}, {}, inside, inside]


@pytest.mark.slow
@pytest.mark.parametrize(("start", "searches"), [("warm", [True, False]), ("restart", [True, True])])
def test_a_warm_identification_is_not_preceded_by_another_search(
    start: str, searches: list[bool], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    seen: list[bool] = []
    take = fake_run.FakePhase.import_state
    monkeypatch.setattr(
        fake_run.FakePhase, "import_state", lambda phase, state: (seen.append(phase.searches), take(phase, state))[1]
    )
    words = [*fake_run.arguments(tmp_path / "run"), "--outer_loop.rounds=2", f"--outer_loop.physics_start={start}"]
    assert fake_run.main(words) == 0
    assert [seen[2], seen[4]] == searches  # static, velocity, physics, correction, physics, correction


def test_after_laws_have_competed_their_parameters_are_not_searched_again(tmp_path: Path):
    loop = OuterLoop(str(tmp_path / "run"), rounds=2)
    for law, searches in ((False, [True, False]), (True, [False, False])):
        loop.steps = algorithm_1(2, False, law=law)
        assert [loop.searches(step) for step in loop.steps if step.role == "physics"] == searches
    loop.physics_start = "restart"
    assert all(loop.searches(step) for step in loop.steps)


@pytest.mark.slow
def test_correction_can_be_switched_off(tmp_path: Path):
    words = [*fake_run.arguments(tmp_path / "run"), "--phases.correction=null", "--outer_loop.rounds=2"]
    assert fake_run.main(words) == 0
    phases = [phase["phase"] for phase in read_manifest(tmp_path / "run")["phases"]]
    assert phases == ["static", "velocity", "physics", "physics"]


def test_a_run_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "mine.txt").write_text("kept")
    assert fake_run.main(fake_run.arguments(tmp_path)) == 2
    assert f"pacnerf-lpo fit --resume {tmp_path}" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGKILL, -9)])
def test_a_stopped_run_goes_on_as_if_it_had_not_been_stopped(tmp_path: Path, number: int, status: int):
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    assert fake_run.main(fake_run.arguments(whole, velocity="steps=40")) == 0
    slow = fake_run.arguments(stopped, velocity="steps=40,seconds=0.15")  # six seconds to be stopped in
    process = start([*slow, "--outer_loop.checkpoint_seconds=0"])
    wait_for(stopped / "checkpoints" / "01_velocity" / "last.ckpt", process)
    process.send_signal(number)
    message = process.communicate(timeout=60)[1]
    assert process.returncode == status
    if status == 130:
        assert message.strip().splitlines()[-1].endswith(f"`pacnerf-lpo fit --resume {stopped}`")
        assert "Traceback" not in message
        assert read_manifest(stopped)["status"] == "interrupted"
    done = torch.load(stopped / "checkpoints" / "01_velocity" / "last.ckpt", weights_only=True)["global_step"]
    assert 0 < done < 40
    finished_before = (stopped / "states" / "00_static.pt").stat().st_mtime_ns
    assert fake_run.main(["--resume", str(stopped)]) == 0
    assert (stopped / "states" / "00_static.pt").stat().st_mtime_ns == finished_before
    assert torch.equal(final_positions(stopped), final_positions(whole))
    assert [phase["steps"] for phase in read_manifest(stopped)["phases"]] == [6, 40, 6, 6]


@pytest.mark.slow
def test_a_long_step_is_given_up_within_five_seconds(tmp_path: Path):
    """The last checkpoint is that of the step before, and the run goes on from there."""
    run = tmp_path / "run"
    slow = fake_run.arguments(run, velocity="steps=3,seconds=12")
    process = start([*slow, "--outer_loop.checkpoint_seconds=0"])
    wait_for(run / "states" / "00_static.pt", process)
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    message = process.communicate(timeout=60)[1]
    assert time.monotonic() - sent < 6.0, message  # and a second for the interpreter to end
    assert process.returncode == 130 and "Traceback" not in message
    assert message.strip().splitlines()[-1].endswith(f"`pacnerf-lpo fit --resume {run}`")
    assert read_manifest(run)["status"] == "interrupted"


@pytest.mark.slow
def test_code_that_does_not_hear_of_signals_is_ended(tmp_path: Path):
    """A computation outside Python, here an eigenvalue problem, keeps Python's handlers waiting."""
    program = """
import numpy as np
from pacnerf_lpo.callbacks.stop_request import StopRequest
with StopRequest():
    matrix = np.random.default_rng(0).random((3000, 3000))
    print("busy", flush=True)
    np.linalg.eigvals(matrix)
"""
    command = [sys.executable, "-c", program]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "busy\n"
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    sent = time.monotonic()
    message = process.communicate(timeout=60)[1]
    assert process.returncode == 130, message
    assert time.monotonic() - sent < 6.0 and message == "stopped\n"


def test_a_wish_to_stop_between_two_batches_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """It arrives after this batch was looked at and before Lightning asks whether it has seen a signal itself."""
    batch_end, sent = PhaseCheckpoint.on_train_batch_end, []

    def then_terminate(self: PhaseCheckpoint, *arguments: Any) -> None:
        batch_end(self, *arguments)
        if not sent:
            sent.append(os.kill(os.getpid(), signal.SIGTERM))

    monkeypatch.setattr(PhaseCheckpoint, "on_train_batch_end", then_terminate)
    assert fake_run.main(fake_run.arguments(tmp_path / "run")) == 130
    assert f"pacnerf-lpo fit --resume {tmp_path / 'run'}" in capsys.readouterr().err
    assert read_manifest(tmp_path / "run")["status"] == "interrupted"


def test_full_disk_keeps_the_last_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    run = tmp_path / "run"
    room = iter(range(3))
    flush = os.fsync

    def fsync(descriptor: int) -> None:
        name = os.readlink(f"/proc/self/fd/{descriptor}")
        if "01_velocity" in name and "ckpt" in name and next(room, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(descriptor)

    monkeypatch.setattr(manifest.os, "fsync", fsync)
    assert fake_run.main([*fake_run.arguments(run), "--outer_loop.checkpoint_seconds=0"]) == 1
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "disk full" in message and f"pacnerf-lpo fit --resume {run}" in message
    assert torch.load(run / "checkpoints" / "01_velocity" / "last.ckpt", weights_only=True)["global_step"] == 3
    assert list(run.rglob("*.part")) == []
    content = read_manifest(run)
    assert content["status"] == "failed" and content["phases"][0]["status"] == "done"
    assert "No space left" in content["phases"][1]["error"]


def test_unstable_simulation_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert fake_run.main(fake_run.arguments(tmp_path / "run", physics="unstable=true")) == 1
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "phase 02_r1_physics: simulation stopped in frame 4, substep 17: |v| dt > dx" in message
    assert read_manifest(tmp_path / "run")["status"] == "failed"
    assert (tmp_path / "run" / "states" / "01_velocity.pt").is_file()


def test_progress_is_shown_without_a_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert fake_run.main(fake_run.arguments(tmp_path / "run")) == 0
    lines = capsys.readouterr().err.splitlines()
    assert any(line.startswith("round 1 of 1, physics: 6/6") and "loss" in line and "Pa" in line for line in lines)
