"""How a rollout drives its kernels on another device.

A double takes the place of the launcher, and torch's meta device, which computes nothing and mixes with no other, that
of the graphics card.
"""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from pacnerf_lpo.mpm import schedule_cuda
from pacnerf_lpo.mpm.arrays import CAUSES, NOT_YET, STATE
from pacnerf_lpo.mpm.rollout import Engine, Rollout

PARTICLES, SUBSTEPS, FRAMES = 50, 8, 3
GRID_READS, STATUS_READS = 2, 1
"""Of numbers of the device by the host, in a frame: first and last node of its grid, and what failed."""


class Double:
    """A kernel that computes nothing, and remembers what it was given."""

    def __init__(self, log: list[tuple[str, dict[str, Any]]]):
        self.log = log

    def bind(self, **arguments: Any) -> None:
        self.log.append(("bind", arguments))

    def __call__(self, **changed: Any) -> None:
        self.log.append(("launch", changed))


@pytest.fixture
def reads(monkeypatch) -> list[Tensor]:
    """Tensors of which the host has read a number; what a double has computed there."""
    seen: list[Tensor] = []

    def numbers(self: Tensor) -> list[int]:
        seen.append(self)
        return [NOT_YET] * len(self) if self.dtype == torch.int32 else [0] * len(self)

    def number(self: Tensor) -> float:
        seen.append(self)
        return 1.0

    monkeypatch.setattr(Tensor, "tolist", numbers)
    for name in ("__float__", "__int__", "__bool__", "item"):
        monkeypatch.setattr(Tensor, name, number)
    return seen


def rolled_out(substeps: int, dtype: torch.dtype = torch.float32) -> list[tuple[str, dict[str, Any]]]:
    """What the kernels of a rollout on another device are given, forward and backward."""
    log: list[tuple[str, dict[str, Any]]] = []
    engine = Engine(None, 0.1, substeps, 1 / 24, (0.0, -9.8, 0.0), "f32", 1, True, 1e9)  # type: ignore[arg-type]
    engine.kernels = lambda particles: (Double(log), Double(log))  # type: ignore[method-assign, assignment, return-value]
    meta = {"device": "meta", "dtype": dtype, "requires_grad": True}
    inputs = torch.zeros(PARTICLES, STATE, **meta), torch.ones(PARTICLES, 5, **meta), torch.zeros(2, **meta)
    Rollout.apply(engine, FRAMES, True, *inputs).sum().backward()
    assert all(one.grad is not None and one.grad.device.type == "meta" for one in inputs)
    return log


def test_every_array_of_a_launch_lies_on_the_device_of_the_state(reads):
    bound = [arguments for name, arguments in rolled_out(SUBSTEPS) if name == "bind"]
    assert len(bound) == 2 * (FRAMES - 1)
    kinds = {"spans": torch.int32, "status": torch.int32, "dims": torch.int32, "progress": torch.int32}
    for arguments in bound:
        arrays = {name: value for name, value in arguments.items() if isinstance(value, Tensor)}
        assert {array.device.type for array in arrays.values()} == {"meta"}
        assert all(array.is_contiguous() and array.dim() in (1, 2) for array in arrays.values())
        for name, array in arrays.items():
            expected = torch.float64 if name == "of_coefficients" else kinds.get(name, torch.float32)
            assert array.dtype == expected, name
        assert all(isinstance(arguments[name], int) for name in set(arguments) - set(arrays))
        assert len(arrays["status"]) == len(CAUSES) and arguments["slices"] == 1


def test_a_frame_is_some_passes_for_each_launch_and_the_adjoint_goes_back(reads):
    passes = [(changed["first"], changed["last"]) for name, changed in rolled_out(SUBSTEPS) if name == "launch"]
    assert schedule_cuda.PASSES == 2
    forward = [(0, 2), (2, 4), (4, 6), (6, 8), (8, 9)]
    assert passes == (FRAMES - 1) * forward + (FRAMES - 1) * forward[::-1]


def test_launches_change_two_numbers_and_nothing_moves_between_them(reads):
    """The host reads some numbers of a frame, as many whatever the number of launches."""
    before: list[int] = []
    for substeps in (SUBSTEPS, 10 * SUBSTEPS):
        reads.clear()
        log = rolled_out(substeps)
        assert all(set(changed) == {"first", "last"} for name, changed in log if name == "launch")
        before.append(len(reads))
    assert before[0] == before[1]


def test_the_host_waits_for_the_device_three_times_in_a_frame(reads):
    rolled_out(SUBSTEPS)
    of_a_frame = GRID_READS + STATUS_READS
    beginning = 1 + GRID_READS  # the mean mass; how many frames the memory holds
    backward = STATUS_READS
    assert len(reads) == beginning + (FRAMES - 1) * (of_a_frame + backward)
