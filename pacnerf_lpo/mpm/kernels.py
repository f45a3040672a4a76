"""The kernel of the engine, compiled twice: passes forward, and their adjoint. Everything else in the engine calls it.

A pass goes over the particles (:mod:`~pacnerf_lpo.mpm.substep`), then over the grid; in which order threads go through
them is the schedule of the device. A frame of S substeps takes S + 1 passes, as the first one completes nothing and the
last one begins nothing. Arrays are flat; :mod:`~pacnerf_lpo.mpm.arrays` names what is in them.
"""

import functools

from pacnerf_lpo.mpm import schedule_cpu, schedule_cuda
from pacnerf_lpo.mpm.arrays import Launch
from pacnerf_lpo.mpm.lanes import LANES
from pacnerf_lpo.mpm.point import LocalLaws
from pacnerf_lpo.mpm.taichi_calls import REAL, Launcher, ti


@functools.cache
def build(laws: LocalLaws, dtype: str, cuda: bool, parallel: bool) -> tuple[Launcher, Launcher]:
    """Forward and adjoint kernel for these laws, compiled at their first launch; ``gradient``, ``node``,
    ``of_constants`` and ``of_coefficients`` are for the adjoint.

    Args:
        laws: local laws to compile in.
        dtype: ``"f32"`` or ``"f64"``.
        cuda: atomic sums, one particle per thread, one pass per launch.
        parallel: on the CPU, one thread per slice; else one slice in the calling thread.
    """
    real, schedule = REAL[dtype], schedule_cuda if cuda else schedule_cpu
    Reals = ti.types.ndarray(dtype=real, ndim=1)
    Nodes = ti.types.ndarray(dtype=ti.types.vector(4, real), ndim=1)
    Rows = ti.types.ndarray(dtype=ti.types.vector(LANES, real), ndim=1)
    Doubles = ti.types.ndarray(dtype=ti.f64, ndim=1)
    Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)

    def launcher(back: bool) -> Launcher:
        @ti.kernel
        def passes(
            states: Rows,
            velocity: Nodes,
            contact: Reals,
            momentum: Nodes,
            constants: Rows,
            gradient: Rows,
            node: Nodes,
            of_constants: Rows,
            of_coefficients: Doubles,
            numbers: Reals,
            dims: Ints,
            spans: Ints,
            status: Ints,
            bench: Rows,
            progress: Ints,
            slices: int,
            chunk: int,
            substeps: int,
            first: int,
            last: int,
            state: int,
            nodes: int,
            contacts: int,
        ):
            call = Launch(
                states, velocity, contact, momentum, constants, gradient, node, of_constants, of_coefficients,
                numbers, dims, spans, status, bench, progress, slices, chunk, substeps,
                first, last, state, nodes, contacts,
            )  # fmt: skip
            schedule.passes(call, laws, parallel, back)

        return Launcher(passes, dtype)

    return launcher(back=False), launcher(back=True)
