"""Fixtures of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from pacnerf_lpo.explore import Session
from tests.diagnosis.falling import install
from tests.explore.falling import session_of


@pytest.fixture
def falling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_threads: None) -> Session:
    """A session about a ball with hidden drag."""
    install(monkeypatch)
    return session_of(tmp_path)
