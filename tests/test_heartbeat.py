"""A command that is silent for a while says what it is doing; one that speaks does not."""

from __future__ import annotations

import sys
import time

import pytest

from pacnerf_lpo import heartbeat


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heartbeat, "QUIET", 0.2)
    monkeypatch.setattr(heartbeat, "POLL", 0.02)


def test_silence_is_broken_with_the_task_at_hand(capsys: pytest.CaptureFixture[str]):
    before, began = (sys.stdout, sys.stderr), time.monotonic()
    with heartbeat.heartbeat("reading"):
        time.sleep(0.5)
        heartbeat.doing("fitting")
        time.sleep(0.5)
    most = (time.monotonic() - began) / heartbeat.QUIET
    time.sleep(0.4)  # it is over
    said = [line.split(" (")[0] for line in capsys.readouterr().err.splitlines()]
    # a task that has just begun is not "still" done, which a busy machine can show, too
    assert said == sorted(said, key=["still reading", "fitting ...", "still fitting"].index)
    assert 1 <= said.count("still reading") < len(said) <= most
    assert (sys.stdout, sys.stderr) == before
    assert "write" not in vars(sys.stdout) and "write" not in vars(sys.stderr)


def test_who_speaks_is_left_alone(capsys: pytest.CaptureFixture[str]):
    with heartbeat.heartbeat("reading"):
        for number in range(20):
            print(number, file=sys.stderr if number % 2 else sys.stdout)
            time.sleep(0.03)
    assert "still" not in capsys.readouterr().err


def test_what_was_said_after_a_task_began_is_what_goes_on(capsys: pytest.CaptureFixture[str]):
    with heartbeat.heartbeat("reading"):
        time.sleep(0.1)
        print("drawing")
        time.sleep(0.6)
        heartbeat.doing("fitting")
        time.sleep(0.15)
    said = [line.split(" (")[0] for line in capsys.readouterr().err.splitlines()]
    assert said[:2] == ["still busy with that"] * 2 and "still reading" not in said
    assert said[2:] in ([], ["fitting ..."], ["still fitting"])


def test_a_task_inside_another_changes_its_name_only(capsys: pytest.CaptureFixture[str]):
    with heartbeat.heartbeat("outer"):
        with heartbeat.heartbeat("inner"):
            time.sleep(0.35)
        time.sleep(0.1)
    assert capsys.readouterr().err.startswith("still inner")


def test_without_a_heartbeat_nothing_happens(capsys: pytest.CaptureFixture[str]):
    heartbeat.doing("nothing")
    assert capsys.readouterr().err == ""
