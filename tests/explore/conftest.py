"""A run that lacks drag, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.explore.dropped import write_dropped_ball


@pytest.fixture(scope="session")
def dropped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the run."""
    return write_dropped_ball(tmp_path_factory.mktemp("dropped"))
