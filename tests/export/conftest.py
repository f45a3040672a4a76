"""A finished example run with a closed-form motion in place of the engine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.export.motion import Subject
from tests.report.example_run import closed_form_motion, write_example_run


@pytest.fixture(scope="package")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A run directory without predictions."""
    with closed_form_motion():
        yield write_example_run(tmp_path_factory.mktemp("runs") / "example")


@pytest.fixture(scope="package")
def subject(finished_run: Path) -> Subject:
    """The last phase of the run, five frames."""
    run = Run(finished_run)
    return Subject(run, run.last)
