"""A finished example run, evaluated once with a closed-form motion in place of the engine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from pacnerf_lpo.evaluation.evaluate import evaluate_run
from tests.report.example_run import closed_form_motion, write_example_run


@pytest.fixture(scope="package")
def example_motion() -> Iterator[None]:
    """Every simulation of this folder's tests follows the closed form."""
    with closed_form_motion():
        yield


@pytest.fixture(scope="package")
def evaluated_run(tmp_path_factory: pytest.TempPathFactory, example_motion: None) -> Path:
    """A run directory with results.json, truth known."""
    folder = write_example_run(tmp_path_factory.mktemp("runs") / "example")
    evaluate_run(folder, "demo")
    return folder
