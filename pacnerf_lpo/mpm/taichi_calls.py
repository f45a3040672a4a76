"""Taichi's private calls, here and nowhere else, with the version that they were tried with.

A law emits expressions while a kernel is compiled, and a rollout launches one kernel hundreds of times with a few
arguments changed; for neither has Taichi a public call.
"""

import contextlib
import functools
import inspect
import linecache
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
_module_of, inspect.getmodule = inspect.getmodule, lambda *_: None
try:  # each of Taichi's functions asks for its module: half of the import, where torch has loaded thousands before
    import taichi as ti
    from taichi.lang import impl, kernel_impl
    from taichi.lang.any_array import AnyArray
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
    from taichi.lang.expr import Expr as Expr
finally:
    inspect.getmodule = _module_of


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Taichi's function of this name, which asks for the module of the frame, too, though only its line counts."""
    try:
        frame = sys._getframe(level_of_class_stackframe)
    except ValueError:  # at the top of a program
        return False
    line = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
    return any(pattern.match(line) for pattern in kernel_impl._KERNEL_CLASS_STACKFRAME_STMT_RES)


kernel_impl._inside_class = _inside_class

OURS = Path(__file__).parents[1].as_posix() + "/"
"""Files of this package."""
TRIED_WITH = (1, 7, 4)
"""Version of Taichi that every call of this module was tried with."""
REAL = {"f32": ti.f32, "f64": ti.f64}
TORCH_REAL = {"f32": torch.float32, "f64": torch.float64}


def keep(value: Any) -> Any:
    """While a kernel is compiled: store an expression in a local variable, so that using it twice computes it once."""
    return impl.expr_init(value)


def entry(array: Any, *indices: Any) -> Any:
    """While a kernel is compiled: an entry of an array, a vector or a matrix; of an array of vectors, the vector or,
    with one more index, a number of it.
    """
    return keep(_place(array, indices))


def assign(array: Any, value: Any, *indices: Any) -> None:
    """While a kernel is compiled: store an entry, as :func:`entry` reads it."""
    _place(array, indices)._assign(value)


def _place(array: Any, indices: tuple) -> Any:
    builder = impl.get_runtime().compiling_callable.ast_builder()
    if isinstance(array, AnyArray):
        return _place(impl.subscript(builder, array, indices[0]), indices[1:])
    return impl.subscript(builder, array, *indices) if indices else array


def components(vector: Any) -> list[Any]:
    """While a kernel is compiled: the three expressions of a 3-vector."""
    return [entry(vector, i) for i in range(3)]


def compiling_double() -> bool:
    """While a kernel is compiled: whether its real numbers are float64."""
    return impl.get_runtime().default_fp == ti.f64


def _mistake_in_a_law(error: BaseException) -> UserInputError | None:
    """What a law of somebody's own did wrong while it was compiled, with its file and line; None: it was another."""
    chain = [error]
    while (before := chain[-1].__cause__ or chain[-1].__context__) is not None:
        chain.append(before)
    for link in reversed(chain):
        frames = traceback.extract_tb(link.__traceback__)
        files = [(frame.filename.replace(os.sep, "/"), frame.lineno) for frame in frames]
        own = [(name, line) for name, line in files if not name.startswith(OURS) and "/taichi/" not in name]
        said = str(link) if isinstance(link, UserInputError) else f"{type(link).__name__}: {link}"
        if own:
            return UserInputError(f"{own[-1][0]}, line {own[-1][1]}: {said}")
    return chain[-1] if isinstance(chain[-1], UserInputError) else None


_source_lines = functools.cache(kernel_impl.getsourcelines)


def _place_in_source(context: Any, node: Any) -> str:
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}: '


@contextlib.contextmanager
def _quick_translation() -> Iterator[None]:
    """Taichi reads a function's source at each of its calls, and quotes the line of every expression for errors: half
    the time of its translation, which a kernel from its cache takes, too. Here a source is read once, and a place is a
    line number.
    """
    known = kernel_impl.getsourcelines, ASTTransformerContext.get_pos_info
    kernel_impl.getsourcelines, ASTTransformerContext.get_pos_info = _source_lines, _place_in_source
    try:
        yield
    finally:
        kernel_impl.getsourcelines, ASTTransformerContext.get_pos_info = known


class Emitted:
    """A record of expressions and arrays, which exists while a kernel is compiled; functions of a kernel take it whole.

    It compiles to nothing: a field stands for the expression that was put into it.
    """

    _data_oriented = True

    @classmethod
    def read(cls, array: Any) -> Any:
        """The record whose fields are the first numbers of an array, in order."""
        return cls(*(entry(array, i) for i in range(len(fields(cls)))))  # type: ignore[arg-type]


class Launcher:
    """A kernel with its arguments bound: a launch sets only those that change (Taichi's own call costs 10 times more).
    On CUDA it sets them all: there Taichi moves the arguments to the device, and what held them cannot be used again.

    Args:
        kernel: a ``ti.kernel`` whose parameters are 1-D arrays of numbers or vectors (contiguous torch tensors), and
            numbers.
        dtype: ``"f32"`` or ``"f64"``, the type of decimal constants inside the kernel.
    """

    def __init__(self, kernel: Callable, dtype: str):
        self._kernel = kernel._primal  # type: ignore[attr-defined]
        self._position = {argument.name: (i,) for i, argument in enumerate(self._kernel.arguments)}
        self._dtype = dtype
        self._compiled: Any = None
        self._handle: Any = None
        self._context: Any = None
        self._bound: dict[str, Any] = {}
        self._used_once = False

    def bind(self, **arguments: Any) -> None:
        """Set all arguments for launches to come; the first call compiles the kernel. The caller keeps arrays alive."""
        if self._compiled is None:
            self._compile([arguments[name] for name in self._position])
        for name, value in arguments.items():
            self._set(name, value)

    def __call__(self, **changed: Any) -> None:
        """Launch with some arguments changed."""
        for name, value in changed.items():
            self._set(name, value)
        if self._used_once:
            self._context = self._handle.make_launch_context()
            for name, value in self._bound.items():
                self._pass(name, value)
        impl.get_runtime().prog.launch_kernel(self._compiled, self._context)

    def _compile(self, arguments: list) -> None:
        runtime = impl.get_runtime()
        runtime.set_default_fp(REAL[self._dtype])
        try:
            with warnings.catch_warnings(), _quick_translation():
                warnings.simplefilter("ignore", SyntaxWarning)
                self._handle = self._kernel.compiled_kernels[self._kernel.ensure_compiled(*arguments)]
            program, config = runtime.prog, runtime.prog.config()
            self._compiled = program.compile_kernel(config, program.get_device_caps(), self._handle)
            self._context, self._used_once = self._handle.make_launch_context(), config.arch == ti.cuda
        except Exception as error:
            if (mistake := _mistake_in_a_law(error)) is None:
                raise
            raise mistake from None
        finally:
            runtime.set_default_fp(ti.f32)

    def _set(self, name: str, value: Any) -> None:
        if isinstance(value, Tensor):
            assert value.is_contiguous(), name
            value = value.data_ptr(), value.element_size() * value.numel(), (len(value),), 0  # it has no gradient
        if self._bound.get(name) != value:
            self._bound[name] = value
            if not self._used_once:
                self._pass(name, value)

    def _pass(self, name: str, value: Any) -> None:
        index = self._position[name]
        if isinstance(value, tuple):
            self._context.set_arg_external_array_with_shape(index, *value)
        elif isinstance(value, int):
            self._context.set_arg_int(index, value)
        else:
            self._context.set_arg_float(index, value)
