"""Taichi, imported here and nowhere else: start-up, precision, and launching kernels cheaply.

``ti.init`` runs once per process, at the first simulation. Arrays are torch tensors: Taichi reads and writes their
memory, so a kernel compiled once serves every number of particles, grid size and time step.
"""

import contextlib
import io
import os
import threading
import warnings
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.errors import Stopped, UserInputError

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
import taichi as ti
from taichi.lang import impl

REAL = {"f32": ti.f32, "f64": ti.f64}
TORCH_REAL = {"f32": torch.float32, "f64": torch.float64}
OPTIONS: dict[str, Any] = {"fast_math": False, "real_matrix_scalarize": False}
"""Vectors stay vectors down to LLVM: a 4-vector of a node is one SIMD register."""
LAUNCHING = threading.RLock()
"""A kernel has one set of bound arguments: threads of a process take turns, frame by frame of their rollouts."""
_unwanted: ContextVar[Callable[[], bool]] = ContextVar("_unwanted", default=lambda: False)
_started: dict[str, Any] = {}


def start(device: str = "cpu", threads: int | None = None) -> int:
    """Initialise Taichi once per process; return the number of CPU threads (1 on CUDA).

    Args:
        device: ``"cpu"`` or ``"cuda"``.
        threads: CPU threads; default ``PACNERF_LPO_THREADS``, else what torch uses. Ignored after the first call.
    Raises:
        UserInputError: unknown device, CUDA not available, or Taichi already runs on the other device.
    """
    kind = torch.device(device).type
    if not _started:
        if kind not in ("cpu", "cuda"):
            raise UserInputError(f"simulator device {device!r}: choose 'cpu' or 'cuda'")
        if kind == "cuda" and not torch.cuda.is_available():
            raise UserInputError(
                "simulator device 'cuda': no CUDA device is visible to torch; choose 'cpu' (--trainer.accelerator=cpu)"
            )
        count = threads or int(os.environ.get("PACNERF_LPO_THREADS", 0)) or torch.get_num_threads()
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


def keep(value: Any) -> Any:
    """While a kernel is compiled: store an expression in a local variable, so that using it twice computes it once."""
    return impl.expr_init(value)


def components(vector: Any) -> list[Any]:
    """While a kernel is compiled: the three expressions of a 3-vector."""
    builder = impl.get_runtime().compiling_callable.ast_builder()
    return [keep(impl.subscript(builder, vector, i)) for i in range(3)]


def entries(matrix: Any) -> list[list[Any]]:
    """While a kernel is compiled: the nine expressions of a 3x3 matrix."""
    builder = impl.get_runtime().compiling_callable.ast_builder()
    return [[keep(impl.subscript(builder, matrix, i, j)) for j in range(3)] for i in range(3)]


def compiling_double() -> bool:
    """While a kernel is compiled: whether its real numbers are float64."""
    return impl.get_runtime().default_fp == ti.f64


class Array:
    """A contiguous tensor as launches take it, made once where many of them use it.

    tensor: it.
    described: its address, bytes, length, and that it has no gradient.
    """

    __slots__ = ("described", "tensor")

    def __init__(self, tensor: Tensor):
        self.tensor = tensor
        self.described = tensor.data_ptr(), tensor.element_size() * tensor.numel(), (len(tensor),), 0


class Launcher:
    """A kernel with its arguments bound: a launch sets only those that change (Taichi's own call costs 10 times more).

    Args:
        kernel: a ``ti.kernel`` whose parameters are 1-D arrays of numbers or vectors (contiguous torch tensors), and
            numbers. An array may be given as :class:`Array`, too.
        dtype: ``"f32"`` or ``"f64"``, the type of decimal constants inside the kernel.
    """

    def __init__(self, kernel: Callable, dtype: str):
        self._kernel = kernel._primal  # type: ignore[attr-defined]
        self._position = {argument.name: (i,) for i, argument in enumerate(self._kernel.arguments)}
        self._dtype = dtype
        self._compiled: Any = None
        self._context: Any = None
        self._bound: dict[str, Any] = {}

    def bind(self, **arguments: Any) -> None:
        """Set every argument for the launches to come; the first call compiles the kernel. The caller keeps arrays
        alive.
        """
        if self._compiled is None:
            self._compile([arguments[name] for name in self._position])
        for name, value in arguments.items():
            self._set(name, value)

    def __call__(self, **changed: Any) -> None:
        """Launch with some arguments changed."""
        for name, value in changed.items():
            self._set(name, value)
        impl.get_runtime().prog.launch_kernel(self._compiled, self._context)

    def _compile(self, arguments: list) -> None:
        runtime = impl.get_runtime()
        runtime.set_default_fp(REAL[self._dtype])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            shown = [value.tensor if isinstance(value, Array) else value for value in arguments]
            handle = self._kernel.compiled_kernels[self._kernel.ensure_compiled(*shown)]
        self._compiled = runtime.prog.compile_kernel(runtime.prog.config(), runtime.prog.get_device_caps(), handle)
        self._context = handle.make_launch_context()
        runtime.set_default_fp(ti.f32)

    def _set(self, name: str, value: Any) -> None:
        if isinstance(value, Tensor):
            value = Array(value)
        if isinstance(value, Array):
            value = value.described
        if self._bound.get(name) == value:
            return
        self._bound[name], index = value, self._position[name]
        if isinstance(value, tuple):
            self._context.set_arg_external_array_with_shape(index, *value)
        elif isinstance(value, int):
            self._context.set_arg_int(index, value)
        else:
            self._context.set_arg_float(index, value)
