"""The two kernels of a substep: forward, and its adjoint. Everything else in the engine calls these.

A launch is a pass over the particles (:mod:`~pacnerf_lpo.mpm.substep`), then one over the grid; in which order threads
go through them is the schedule of the device. A frame of S substeps takes S + 1 launches, as the first one completes
nothing and the last one begins nothing. Arrays are flat; :mod:`~pacnerf_lpo.mpm.arrays` names what is in them.
"""

import functools

from pacnerf_lpo.mpm import schedule_cpu, schedule_cuda
from pacnerf_lpo.mpm.arrays import Launch
from pacnerf_lpo.mpm.point import LocalLaws
from pacnerf_lpo.mpm.substep import Adjoint, Forward
from pacnerf_lpo.mpm.taichi_calls import REAL, Launcher, ti


@functools.cache
def build(laws: LocalLaws, dtype: str, cuda: bool, parallel: bool) -> tuple[Launcher, Launcher]:
    """Forward and adjoint kernel for these laws, compiled at their first launch.

    Args:
        laws: local laws to compile in.
        dtype: ``"f32"`` or ``"f64"``.
        cuda: atomic sums, one particle per thread.
        parallel: on the CPU, one thread per slice; else one slice in the calling thread, which saves handing it over.
    """
    real, schedule = REAL[dtype], schedule_cuda if cuda else schedule_cpu
    Reals = ti.types.ndarray(dtype=real, ndim=1)
    Nodes = ti.types.ndarray(dtype=ti.types.vector(4, real), ndim=1)
    Doubles = ti.types.ndarray(dtype=ti.f64, ndim=1)
    Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)

    @ti.kernel
    def forward(
        before: Reals,
        now: Reals,
        ahead: Reals,
        velocity_in: Nodes,
        velocity_out: Nodes,
        contact: Reals,
        momentum: Nodes,
        constants: Reals,
        numbers: Reals,
        dims: Ints,
        spans: Ints,
        status: Ints,
        slices: int,
        chunk: int,
        substep: int,
        finish: int,
        begin: int,
        keep_all: int,
    ):
        call = Launch(numbers, dims, spans, status, slices, chunk, substep)
        a = Forward(
            before, now, ahead, velocity_in, velocity_out, contact, momentum, constants, finish, begin, keep_all
        )
        schedule.forward(a, call, laws, parallel)

    @ti.kernel
    def adjoint(
        now: Reals,
        before: Reals,
        gradient: Reals,
        node: Nodes,
        velocity: Nodes,
        contact: Reals,
        momentum: Nodes,
        constants: Reals,
        of_constants: Reals,
        of_coefficients: Doubles,
        numbers: Reals,
        dims: Ints,
        spans: Ints,
        status: Ints,
        slices: int,
        chunk: int,
        substep: int,
        begun: int,
        finished: int,
    ):
        call = Launch(numbers, dims, spans, status, slices, chunk, substep)
        a = Adjoint(
            now, before, gradient, node, velocity, contact, momentum, constants, of_constants, of_coefficients,
            begun, finished,
        )  # fmt: skip
        schedule.adjoint(a, call, laws, parallel)

    return Launcher(forward, dtype), Launcher(adjoint, dtype)
