"""What all simulations of a process share: Taichi's start, the device, and whose turn it is.

``ti.init`` runs once per process, at the first simulation. Arrays are torch tensors: Taichi reads and writes their
memory, so a kernel compiled once serves every number of particles, grid size and time step.
"""

import contextlib
import io
import os
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

import torch

from pacnerf_lpo.errors import Stopped, UserInputError
from pacnerf_lpo.mpm.taichi_calls import ti

OPTIONS: dict[str, Any] = {"fast_math": False, "real_matrix_scalarize": False}
"""Vectors stay vectors down to LLVM: a 4-vector of a node is one SIMD register."""
LAUNCHING = threading.RLock()
"""A kernel has one set of bound arguments: threads of a process take turns, frame by frame of their rollouts."""
_unwanted: ContextVar[Callable[[], bool]] = ContextVar("_unwanted", default=lambda: False)
_started: dict[str, Any] = {}


def start(device: str = "cpu") -> int:
    """Initialise Taichi once per process, on ``"cpu"`` or ``"cuda"``; return the number of CPU threads (1 on CUDA):
    ``PACNERF_LPO_THREADS``, else what torch used at the first call. Raises UserInputError where the device is unknown,
    CUDA is not available, or Taichi already runs on the other device.
    """
    kind = torch.device(device).type
    if not _started:
        if kind not in ("cpu", "cuda"):
            raise UserInputError(f"simulator device {device!r}: choose 'cpu' or 'cuda'")
        if kind == "cuda" and not torch.cuda.is_available():
            raise UserInputError(
                "simulator device 'cuda': no CUDA device is visible to torch; choose 'cpu' (--trainer.accelerator=cpu)"
            )
        count = int(os.environ.get("PACNERF_LPO_THREADS", 0)) or torch.get_num_threads()
        arch = ti.cuda if kind == "cuda" else ti.cpu
        with contextlib.redirect_stdout(io.StringIO()):
            ti.init(arch=arch, cpu_max_num_threads=count, log_level=ti.ERROR, **OPTIONS)
        _started.update(kind=kind, threads=count if kind == "cpu" else 1)
    if kind != _started["kind"]:
        raise UserInputError(
            f"simulator device {device!r}: this process already simulates on {_started['kind']!r}; "
            "use one device per process"
        )
    return _started["threads"]


def device() -> torch.device:
    """Where this process simulates and renders: what :func:`start` was given, else the CPU."""
    return torch.device(_started.get("kind", "cpu"))


def free_memory(gpu: torch.device) -> int:
    """Of a CUDA device [bytes]: what nobody holds, and what torch holds without a tensor in it."""
    unused = torch.cuda.memory_reserved(gpu) - torch.cuda.memory_allocated(gpu)
    return torch.cuda.mem_get_info(gpu)[0] + unused


@contextlib.contextmanager
def stoppable(unwanted: Callable[[], bool]) -> Iterator[None]:
    """Let rollouts of this thread raise ``Stopped`` at the next frame once ``unwanted`` says so."""
    token = _unwanted.set(unwanted)
    try:
        yield
    finally:
        _unwanted.reset(token)


def heed() -> None:
    """Raise Stopped where the rollout in progress is not wanted any more, see :func:`stoppable`."""
    if _unwanted.get()():
        raise Stopped("the simulation was stopped")
