"""Results of a diagnosis on disk: every step once, so that a stopped diagnosis goes on where it was."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from typing import TypeVar

import joblib

from pacnerf_lpo import __version__
from pacnerf_lpo.diagnosis.problem import Problem
from pacnerf_lpo.manifest import write_atomically

FOLDER = "diagnosis"
Result = TypeVar("Result")


class Store:
    """What the steps found, under names that depend on all that they depend on.

    Args:
        problem: the run under diagnosis.
        options: of the diagnosis.
    """

    def __init__(self, problem: Problem, options: dict):
        self.folder = problem.run.run_dir / FOLDER
        stem = problem.stem
        state = problem.run.stage(stem).state_path.read_bytes()
        config = json.dumps(
            [problem.run.config["data"], problem.run.config["physics"], options, __version__], default=str
        )
        self.key = hashlib.sha256(state + config.encode()).hexdigest()[:16]

    def once(self, name: str, step: Callable[[], Result]) -> Result:
        """What ``step`` gives; taken from disk where it was done before with the same run and options."""
        path = self.folder / "steps" / f"{self.key}_{name}.joblib"
        if path.is_file():
            return joblib.load(path)
        result = step()
        path.parent.mkdir(parents=True, exist_ok=True)
        content = io.BytesIO()
        joblib.dump(result, content)
        write_atomically(path, content.getvalue())
        return result
