"""The passes on the CPU: each thread owns a slice of the blocks of particles, and a field on the nodes.

So no sum is atomic; the pass over the grid adds the fields up and clears them, over the nodes in reach of a particle
only. One thread goes through all substeps of a frame in one launch; several meet after each pass.
"""

from pacnerf_lpo.mpm.arrays import Bench, Group, Setting, begin_pass, end_pass, reach
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import add_to_slice, adjoint_group, forward_group
from pacnerf_lpo.mpm.taichi_calls import ti

LEAST_SHARE = 512
"""Taichi gives a CPU thread at least so many iterations of a loop, whatever block_dim says: so far apart slices lie."""


@ti.func
def forward(arrays: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """Particles, then grid; with ``parallel`` one pass, with one thread per slice."""
    if ti.static(parallel):
        for n in range(call.slices * LEAST_SHARE):
            if n % LEAST_SHARE == 0:
                particles(arrays, call, laws, n // LEAST_SHARE, call.first)
        for n in range(call.slices * LEAST_SHARE):
            if n % LEAST_SHARE == 0:
                nodes(arrays, call, laws, n // LEAST_SHARE, call.first)
    else:
        ti.loop_config(serialize=True)
        for n in range(call.first, call.last):
            particles(arrays, call, laws, 0, n)
            nodes(arrays, call, laws, 0, n)


@ti.func
def adjoint(arrays: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """The same backward, from the last pass to the first."""
    if ti.static(parallel):
        for n in range(call.slices * LEAST_SHARE):
            if n % LEAST_SHARE == 0:
                particles_adjoint(arrays, call, laws, n // LEAST_SHARE, call.first)
        for n in range(call.slices * LEAST_SHARE):
            if n % LEAST_SHARE == 0:
                nodes_adjoint(arrays, call, laws, n // LEAST_SHARE, call.first)
    else:
        ti.loop_config(serialize=True)
        for n in range(call.last - call.first):
            particles_adjoint(arrays, call, laws, 0, call.last - 1 - n)
            nodes_adjoint(arrays, call, laws, 0, call.last - 1 - n)


@ti.func
def particles(arrays: ti.template(), call: ti.template(), laws: ti.template(), t, substep):
    """What slice ``t`` does with its particles."""
    s = Setting.of(call, laws, substep)
    a = arrays.at(call, substep)
    base, first = t * Bench.ROWS, t * s.dims.nodes
    begin_pass(Group(0, None, call.bench, base))
    for b in range(t * call.chunk, ti.min((t + 1) * call.chunk, s.dims.blocks)):
        forward_group(a, s, first, Group(b, None, call.bench, base))
    end_pass(Group(0, None, call.bench, base), s, t)


@ti.func
def nodes(arrays: ti.template(), call: ti.template(), laws: ti.template(), t, substep):
    """What slice ``t`` does with its share of the nodes."""
    s = Setting.of(call, laws, substep)
    a = arrays.at(call, substep)
    low, high = reach(call)
    count = high[0] + 1 - low[0]
    if substep == call.substeps:
        count = 0
    for i in range(low[0] + t * count // call.slices, low[0] + (t + 1) * count // call.slices):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                grid_update(a, s, i, j, k, False)


@ti.func
def particles_adjoint(arrays: ti.template(), call: ti.template(), laws: ti.template(), t, substep):
    """Adjoint of :func:`particles`."""
    s = Setting.of(call, laws, substep)
    a = arrays.at(call, substep)
    base, first = t * Bench.ROWS, t * s.dims.nodes
    begin_pass(Group(0, None, call.bench, base))
    for b in range(t * call.chunk, ti.min((t + 1) * call.chunk, s.dims.blocks)):
        adjoint_group(a, s, first, Group(b, None, call.bench, base), t * len(laws.names))
    end_pass(Group(0, None, call.bench, base), s, t)


@ti.func
def nodes_adjoint(arrays: ti.template(), call: ti.template(), laws: ti.template(), t, substep):
    """Adjoint of :func:`nodes`."""
    s = Setting.of(call, laws, substep)
    a = arrays.at(call, substep)
    low, high = reach(call)
    count = high[0] + 1 - low[0]
    if substep == 0:
        count = 0
    mine = ti.Vector.zero(ti.f64, len(laws.names))
    for i in range(low[0] + t * count // call.slices, low[0] + (t + 1) * count // call.slices):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                mine += grid_update_adjoint(a, s, i, j, k, False)
    for c in ti.static(range(len(laws.names))):
        add_to_slice(a.of_coefficients, t * len(laws.names), c, mine[c], False)
