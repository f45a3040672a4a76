"""Results of a diagnosis on disk: every step once, so that a stopped diagnosis goes on where it was."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import joblib

from pacnerf_lpo import __version__
from pacnerf_lpo.manifest import write_atomically

FOLDER = "diagnosis"
Result = TypeVar("Result")


class Store:
    """What the steps found, under names that depend on all that they depend on.

    Args:
        folder: where they lie.
        problem: bytes that tell what is under diagnosis.
        options: of the diagnosis.
    """

    def __init__(self, folder: Path, problem: bytes, options: dict):
        self.folder = folder
        self.key = hashlib.sha256(problem + json.dumps([options, __version__]).encode()).hexdigest()[:16]

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
