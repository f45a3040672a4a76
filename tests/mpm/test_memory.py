"""The backward pass keeps one state per frame and one frame's substeps, not one per substep."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

from pacnerf_lpo.mpm import runtime
from tests.mpm.engine import Setup, run_engine
from tests.mpm.scenes import BY_NAME, block

STATE_BYTES = 4 * (3 + 3 + 9 + 9)
"""x, v, C, F of one particle in float32."""


def peak() -> int:
    """Highest resident memory since the last reset [bytes]."""
    return 1024 * int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1])  # type: ignore[index]


def reset_peak() -> None:
    """Start measuring the peak from the memory resident now."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        pytest.skip("the peak of the resident memory cannot be reset on this machine")


def grown(frames: int, substeps: int, cells: tuple[int, int, int], backward: bool) -> tuple[int, int]:
    """Peak memory of one rollout above what was resident before [bytes], and the number of particles."""
    particles = block(cells=cells, dx=0.05, bottom=0.5)
    setup = Setup("NeoHookean", dx=0.05, dt=1e-4, substeps=substeps)
    leaves = particles.leaves() if backward else vars(particles)
    reset_peak()
    before = peak()
    trajectory = run_engine(setup, leaves, BY_NAME["NeoHookean"].tensors(), {}, frames=frames, dtype="f32")
    if backward:
        trajectory.sum().backward()
    return peak() - before, len(particles.mass)


@pytest.mark.slow
def test_backward_memory_grows_with_frames_plus_substeps():
    """8 frames of 16 substeps: at most twice frames + substeps states for all of states, grids, inputs and gradients;
    storing
    every substep would take 112 states without the grids."""
    frames, substeps = 8, 16
    grown(2, 2, (2, 2, 2), backward=True)  # compile
    used, n = grown(frames, substeps, (14, 14, 14), backward=True)
    states = used / (n * STATE_BYTES)
    assert states < 2 * (frames + substeps), f"{states:.0f} states"


def test_rollout_without_gradients_stores_no_states():
    """Only positions at the frames (an eighth of a state each), the current state and the grids remain."""
    frames, substeps = 8, 16
    grown(2, 2, (2, 2, 2), backward=False)
    used, n = grown(frames, substeps, (14, 14, 14), backward=False)
    states = used / (n * STATE_BYTES)
    assert states < frames, f"{states:.0f} states"


def test_memory_that_torch_keeps_for_itself_is_free(monkeypatch):
    """Its cache grows with every phase of a fit: counted as taken, the last one would compute frames again."""
    found = {"mem_get_info": (40, 80), "memory_reserved": 35, "memory_allocated": 5}
    for name, value in found.items():
        monkeypatch.setattr(torch.cuda, name, lambda device, value=value: value)
    assert runtime.free_memory(torch.device("cuda")) == 70
