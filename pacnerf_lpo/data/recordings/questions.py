"""What can neither be read nor measured: asked once on a terminal, else said in one line that names the option."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pacnerf_lpo.data.recordings.recording import AXES, UNITS, Recording
from pacnerf_lpo.errors import Unmeasured, UserInputError

T = TypeVar("T")


@dataclass(frozen=True)
class Question:
    """words: what is asked. default: the answer to Enter. answered: the recording with an answer."""

    words: str
    default: Callable[[Recording], str]
    answered: Callable[[Recording, str], Recording]


def asked(recording: Recording, work: Callable[[Recording], T]) -> tuple[Recording, T]:
    """Do ``work``, and ask at a terminal for a value that it lacks. Raises UserInputError where nobody answers."""
    while True:
        try:
            return recording, work(recording)
        except Unmeasured as gap:
            if not (sys.stdin.isatty() and sys.stderr.isatty()):
                raise
            recording = _ask(recording, gap)


def _ask(recording: Recording, gap: Unmeasured) -> Recording:
    question = QUESTIONS[gap.option]
    default = question.default(recording)
    print(f"{gap}", file=sys.stderr)
    while True:
        print(f"{question.words} [{default}]: ", end="", file=sys.stderr, flush=True)
        answer = sys.stdin.readline()
        if not answer:
            raise gap
        try:
            return question.answered(recording, answer.strip() or default)
        except (UserInputError, ValueError):
            print(f"'{answer.strip()}' is no answer to that", file=sys.stderr)


def _usual_up(recording: Recording) -> str:
    """The axis that is nearest to what the cameras have on top."""
    above = np.sum([camera.pose[:, 1] for camera in recording.cameras], axis=0)
    return max(AXES, key=lambda name: float(np.dot(AXES[name], above)))


QUESTIONS = {
    "up": Question(f"Which axis of the calibration points up: {', '.join(AXES)}?", _usual_up, Recording.with_up),
    "unit": Question(
        f"Which unit has the calibration: {', '.join(UNITS)}, or how many metres is one unit?",
        lambda recording: "m",
        Recording.with_unit,
    ),
    "fps": Question(
        "How many frames per second have the videos?",
        lambda recording: "30",
        lambda recording, answer: recording.with_frame_rate(float(answer)),
    ),
}
