"""The passes on the CPU: each thread owns a slice of the blocks of particles, and a field on the nodes.

So no sum is atomic; the pass over the grid adds the fields up and clears them, over the nodes in reach of a particle
only. A launch goes through all substeps of a frame. Threads meet after each pass: they wait busily, as putting a thread to
sleep and waking it takes as long as a pass of some thousand particles.
"""

from pacnerf_lpo.mpm.arrays import Bench, Group, Setting, begin_pass, end_pass, reach
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import add_to_slice, adjoint_group, forward_group
from pacnerf_lpo.mpm.taichi_calls import ti

LEAST_SHARE = 512
"""Taichi gives a CPU thread at least so many iterations of a loop, whatever block_dim says: so far apart slices lie."""


@ti.func
def forward(arrays: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """Particles, then grid, pass by pass; with ``parallel`` one thread per slice."""
    apart = ti.static(LEAST_SHARE if parallel else 1)
    ti.loop_config(serialize=not parallel)
    for t in range(call.slices * apart):
        if t % apart == 0:
            for n in range(call.first, call.last):
                particles(arrays, call, laws, t // apart, n)
                meet(call, 2 * (n - call.first), parallel)
                nodes(arrays, call, laws, t // apart, n)
                meet(call, 2 * (n - call.first) + 1, parallel)


@ti.func
def adjoint(arrays: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """The same backward, from the last pass to the first."""
    apart = ti.static(LEAST_SHARE if parallel else 1)
    ti.loop_config(serialize=not parallel)
    for t in range(call.slices * apart):
        if t % apart == 0:
            for n in range(call.last - call.first):
                particles_adjoint(arrays, call, laws, t // apart, call.last - 1 - n)
                meet(call, 2 * n, parallel)
                nodes_adjoint(arrays, call, laws, t // apart, call.last - 1 - n)
                meet(call, 2 * n + 1, parallel)


@ti.func
def meet(call: ti.template(), before, parallel: ti.template()):
    """Wait until all threads have come here; they have met ``before`` times in this launch."""
    if ti.static(parallel):
        ti.atomic_add(call.arrived[0], 1)
        while ti.atomic_max(call.arrived[0], 0) < (before + 1) * call.slices:
            pass


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
    """What slice ``t`` does with its share of the rows of nodes."""
    s = Setting.of(call, laws, substep)
    a = arrays.at(call, substep)
    low, high = reach(call)
    rows = high[1] + 1 - low[1]
    count = rows * (high[0] + 1 - low[0])
    if substep == call.substeps:
        count = 0
    for n in range(t * count // call.slices, (t + 1) * count // call.slices):
        for k in range(low[2], high[2] + 1):
            grid_update(a, s, low[0] + n // rows, low[1] + n % rows, k, False)


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
    rows = high[1] + 1 - low[1]
    count = rows * (high[0] + 1 - low[0])
    if substep == 0:
        count = 0
    mine = ti.Vector.zero(ti.f64, len(laws.names))
    for n in range(t * count // call.slices, (t + 1) * count // call.slices):
        for k in range(low[2], high[2] + 1):
            mine += grid_update_adjoint(a, s, low[0] + n // rows, low[1] + n % rows, k, False)
    for c in ti.static(range(len(laws.names))):
        add_to_slice(a.of_coefficients, t * len(laws.names), c, mine[c], False)
