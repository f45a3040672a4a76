"""Fixtures of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from pacnerf_lpo.explore import Session
from tests.diagnosis.falling import install
from tests.explore.dropped import write_dropped_ball
from tests.explore.falling import session_of


@pytest.fixture
def falling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_threads: None) -> Session:
    """A session about a ball with hidden drag."""
    install(monkeypatch)
    return session_of(tmp_path)


@pytest.fixture(scope="session")
def dropped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run that lacks drag."""
    return write_dropped_ball(tmp_path_factory.mktemp("dropped"))
