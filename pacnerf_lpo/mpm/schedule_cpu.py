"""The passes on the CPU: slices of the blocks of particles, each with a field on the nodes, and a thread for each.

So no sum is atomic; the pass over the grid adds the fields up and clears them, over the nodes in reach of a particle
only. A launch goes through all substeps of a frame. After each pass a thread waits, busily, for slices that others have
begun, since putting it to sleep and waking it takes as long as a pass of some thousand particles. Where the operating
system does not let all threads run, those that run do the slices of the others; and where one is interrupted in the
middle of a slice, the launch is stopped, and the next one goes on from there.
"""

from pacnerf_lpo.mpm.arrays import Bench, Group, Setting, begin_pass, end_pass, reach
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import add_to_slice, adjoint_group, forward_group
from pacnerf_lpo.mpm.taichi_calls import ti

LEAST_SHARE = 512
"""Taichi gives a CPU thread at least so many iterations of a loop, whatever block_dim says: so far apart slices lie."""
LINE = 16
"""Integers of a cache line: so far apart are numbers that several threads change."""
DONE, STOPPED, FIRST_SLICE = 0, LINE, 2
"""Of the progress of a frame: how many slices are done, and whether the launch is stopped; by slice, in lines from
FIRST_SLICE on, in how many passes it was begun."""
PATIENCE = 50000
"""How often a waiting thread looks: a third of a millisecond, several times as long as sleeping and waking take."""


@ti.func
def passes(call: ti.template(), laws: ti.template(), parallel: ti.template(), back: ti.template()):
    """Particles, then grid, pass by pass, with ``parallel`` by as many threads as there are slices; ``back``: the
    adjoint, from the last pass to the first.
    """
    apart = ti.static(LEAST_SHARE if parallel else 1)
    ti.loop_config(serialize=not parallel)
    for t in range(call.slices * apart):
        if t % apart == 0:
            for n in range(call.last - call.first):
                substep = call.last - 1 - n if ti.static(back) else call.first + n
                for half, work in ti.static(enumerate((particles, nodes), 1)):
                    for k in range(call.slices):
                        u = (t // apart + k) % call.slices
                        if begun(call, u, 2 * n + half):
                            work(call, laws, u, substep, back)
                            ti.atomic_add(call.progress[DONE], 1)
                    meet(call, 2 * n + half)


@ti.func
def begun(call: ti.template(), u, count):
    """Whether this thread is the first that comes to slice ``u`` in pass ``count``, and the passes before are done."""
    mine = False
    if ti.atomic_max(call.progress[DONE], 0) >= (count - 1) * call.slices:  # noqa: SIM102 Taichi's "and" evaluates both
        if ti.atomic_max(call.progress[STOPPED], 0) == 0:
            mine = ti.atomic_max(call.progress[LINE * (u + FIRST_SLICE)], count) < count
    return mine


@ti.func
def meet(call: ti.template(), count):
    """Wait until all slices of ``count`` passes are done. If that takes long, some thread does not run: stop the
    launch, so that this one sleeps meanwhile.
    """
    waited = PATIENCE * ti.atomic_max(call.progress[STOPPED], 0)
    while ti.atomic_max(call.progress[DONE], 0) < count * call.slices and waited < PATIENCE:
        waited += 1
    if waited == PATIENCE:
        ti.atomic_max(call.progress[STOPPED], 1)


@ti.func
def particles(call: ti.template(), laws: ti.template(), t, substep, back: ti.template()):
    """What slice ``t`` does with its particles."""
    s = Setting.of(call, laws, substep)
    base, first = t * Bench.ROWS, t * s.dims.nodes
    begin_pass(Group(0, None, call.bench, base))
    for b in range(t * call.chunk, ti.min((t + 1) * call.chunk, s.dims.blocks)):
        if ti.static(back):
            adjoint_group(s, first, Group(b, None, call.bench, base), t * len(laws.names))
        else:
            forward_group(s, first, Group(b, None, call.bench, base))
    end_pass(Group(0, None, call.bench, base), s, t)


@ti.func
def nodes(call: ti.template(), laws: ti.template(), t, substep, back: ti.template()):
    """What slice ``t`` does with its share of rows of nodes; the last pass begins nothing, the first ends nothing."""
    s = Setting.of(call, laws, substep)
    low, high = reach(call)
    rows = high[1] + 1 - low[1]
    count = rows * (high[0] + 1 - low[0]) * (substep != (0 if ti.static(back) else call.substeps))
    mine = ti.Vector.zero(ti.f64, len(laws.names))
    for n in range(t * count // call.slices, (t + 1) * count // call.slices):
        for k in range(low[2], high[2] + 1):
            if ti.static(back):
                mine += grid_update_adjoint(s, low[0] + n // rows, low[1] + n % rows, k, False)
            else:
                grid_update(s, low[0] + n // rows, low[1] + n % rows, k, False)
    if ti.static(back):
        for c in ti.static(range(len(laws.names))):
            add_to_slice(call.of_coefficients, t * len(laws.names), c, mine[c], False)
