"""The engine runs on two threads in its tests, so that the sum over slices of particles is tested too."""

import os

import pytest

from pacnerf_lpo.mpm import rollout

os.environ.setdefault("PACNERF_LPO_THREADS", "2")


@pytest.fixture(autouse=True)
def a_thread_for_few_particles(monkeypatch):
    """Even the small bodies of the tests are worth a second thread."""
    monkeypatch.setattr(rollout, "LEAST_PARTICLES", 1)
