"""The engine runs on two threads in its tests, so that the sum over slices of particles is tested too."""

import os

import pytest

from pacnerf_lpo.mpm import rollout, schedule_cuda

os.environ.setdefault("PACNERF_LPO_THREADS", "2")


@pytest.fixture(autouse=True)
def a_thread_for_few_particles(monkeypatch):
    """Even the small bodies of the tests are worth a second thread."""
    monkeypatch.setattr(rollout, "LEAST_PARTICLES", 1)


@pytest.fixture(autouse=True)
def few_threads_of_a_gpu(monkeypatch):
    """The schedule for CUDA, compiled for the CPU: particles take turns, and the last launch of a frame is not full."""
    monkeypatch.setattr(schedule_cuda, "THREADS", 64)
    monkeypatch.setattr(schedule_cuda, "PASSES", 2)
