"""Rollouts of several threads of one process, and rollouts that are stopped."""

from __future__ import annotations

import threading

import pytest
import torch

from pacnerf_lpo.errors import Stopped
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.runtime import stoppable
from pacnerf_lpo.mpm.simulator import Simulator

FRAMES = 6


def rolled(E: float) -> torch.Tensor:
    """A small block that falls on the ground [m, (F, N, 3)]."""
    axis = torch.arange(4) * 0.05
    positions = torch.cartesian_prod(axis, axis + 0.02, axis)
    velocity = torch.tensor([0.0, -1.0, 0.0]).expand_as(positions)
    one = torch.ones(len(positions))
    simulator = Simulator(NeoHookean(), dx=0.1, substeps=40)
    return simulator(positions, velocity, 0.1 * one, one, {"E": torch.tensor(E), "nu": torch.tensor(0.3)}, FRAMES)


def test_threads_take_turns():
    moduli = [5e4, 1e5, 2e5, 4e5]
    alone = [rolled(E) for E in moduli]
    found: dict[float, torch.Tensor] = {}
    threads = [threading.Thread(target=lambda E=E: found.update({E: rolled(E)})) for E in moduli]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120)
    for E, expected in zip(moduli, alone, strict=True):
        torch.testing.assert_close(found[E], expected, rtol=0, atol=0)


def test_a_rollout_stops_at_the_next_frame_and_in_its_own_thread_alone():
    asked: list[bool] = []

    def unwanted() -> bool:
        asked.append(True)
        return len(asked) > 3

    with stoppable(unwanted):
        with pytest.raises(Stopped):
            rolled(1e5)
        other = threading.Thread(target=rolled, args=(1e5,))
        other.start()
        other.join(120)
    assert len(asked) == 4
    assert len(rolled(1e5)) == FRAMES
