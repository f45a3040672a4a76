"""What a simulation asks of its device, seen from where kernels are launched: with the schedule for CUDA, compiled for
the CPU, nothing of torch happens between the launches of a frame, and no more per frame where it has more substeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from pacnerf_lpo.mpm import schedule_cuda
from pacnerf_lpo.mpm.effects import LinearDrag
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.simulator import Simulator
from pacnerf_lpo.mpm.taichi_calls import Launcher

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_threads")]
FRAMES, BETWEEN_DEVICES = 4, ("_to_copy", "_local_scalar_dense")


class Operations(TorchDispatchMode):
    """Notes the name of every torch operation among the launches."""

    def __init__(self, events: list[str]):
        super().__init__()
        self.events = events

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        self.events.append(func.overloadpacket.__name__)
        return func(*args, **(kwargs or {}))


@dataclass
class Watched:
    """What a rollout and its gradient did: torch operations, ``bind`` and ``launch`` in order, and what was bound."""

    events: list[str] = field(default_factory=list)
    bound: list[dict[str, Any]] = field(default_factory=list)

    @property
    def launches(self) -> list[list[str]]:
        """What happened between the first and the last launch of every frame, forward and back."""
        text, found = self.events, []
        starts = [place for place, event in enumerate(text) if event == "bind"]
        for start, end in zip(starts, [*starts[1:], len(text)], strict=True):
            last = max(place for place in range(start, end) if text[place] == "launch")
            found.append(text[start + 1 : last + 1])
        return found


def watched(substeps: int, monkeypatch: pytest.MonkeyPatch) -> Watched:
    """A block that falls, rolled out and differentiated."""
    found, bind, launch = Watched(), Launcher.bind, Launcher.__call__

    def noted_bind(self: Launcher, **arguments: Any) -> None:
        found.events.append("bind")
        found.bound.append(arguments)
        bind(self, **arguments)

    def noted_launch(self: Launcher, **changed: Any) -> None:
        found.events.append("launch")
        launch(self, **changed)

    simulator = Simulator(NeoHookean(), dx=0.1, substeps=substeps, effects=[LinearDrag(1.0)], dtype="f64")
    simulator._engine.cuda = True
    axis = torch.arange(4, dtype=torch.float64) * 0.05
    x = torch.cartesian_prod(axis, axis + 0.3, axis)
    v, ones = torch.zeros_like(x, requires_grad=True), torch.ones(len(x), dtype=torch.float64)
    moduli = {name: torch.tensor(value, dtype=torch.float64) for name, value in NeoHookean().guess.items()}
    drag = {"drag": torch.tensor(1.0, dtype=torch.float64)}
    with monkeypatch.context() as patched:
        patched.setattr(Launcher, "bind", noted_bind)
        patched.setattr(Launcher, "__call__", noted_launch)
        with Operations(found.events):
            path = simulator(x, v, 0.125 * ones, ones, moduli, FRAMES, drag)
            (path[-1] ** 2).sum().backward()
    return found


def test_nothing_moves_between_the_launches_of_a_frame(monkeypatch):
    found = watched(60, monkeypatch)
    assert len(found.launches) == 2 * (FRAMES - 1)
    assert all(events == ["launch"] * math.ceil(61 / schedule_cuda.PASSES) for events in found.launches)


def test_a_frame_moves_as_little_with_four_times_the_substeps(monkeypatch):
    few, many = watched(60, monkeypatch), watched(240, monkeypatch)
    for name in BETWEEN_DEVICES:
        assert few.events.count(name) == many.events.count(name), name
    assert [event for event in few.events if event != "launch"] == [e for e in many.events if e != "launch"]


def test_kernels_get_whole_arrays_of_their_own_device(monkeypatch):
    """Kernels get pointers: arrays of another device, or with gaps, would be read as something else."""
    for arguments in watched(60, monkeypatch).bound:
        arrays = [value for value in arguments.values() if isinstance(value, torch.Tensor)]
        assert len(arrays) > 8
        for array in arrays:
            assert array.device == torch.device("cpu") and array.is_contiguous() and not array.requires_grad
