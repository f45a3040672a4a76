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
    before = sys.stdout, sys.stderr
    with heartbeat.heartbeat("reading"):
        time.sleep(0.5)
        heartbeat.doing("fitting")
        time.sleep(0.5)
    time.sleep(0.4)  # it is over
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(" (")[0] for line in lines] in (
        ["still reading", "still reading", "still fitting", "still fitting"],
        ["still reading", "still fitting", "still fitting"],
        ["still reading", "still reading", "still fitting"],
        ["still reading", "still fitting"],
    )
    assert (sys.stdout, sys.stderr) == before
    assert "write" not in vars(sys.stdout) and "write" not in vars(sys.stderr)


def test_who_speaks_is_left_alone(capsys: pytest.CaptureFixture[str]):
    with heartbeat.heartbeat("reading"):
        for number in range(20):
            print(number, file=sys.stderr if number % 2 else sys.stdout)
            time.sleep(0.03)
    assert "still" not in capsys.readouterr().err


def test_a_task_inside_another_changes_its_name_only(capsys: pytest.CaptureFixture[str]):
    with heartbeat.heartbeat("outer"):
        with heartbeat.heartbeat("inner"):
            time.sleep(0.35)
        time.sleep(0.1)
    assert capsys.readouterr().err.startswith("still inner")


def test_without_a_heartbeat_nothing_happens(capsys: pytest.CaptureFixture[str]):
    heartbeat.doing("nothing")
    assert capsys.readouterr().err == ""
