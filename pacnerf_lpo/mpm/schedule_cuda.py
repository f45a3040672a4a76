"""The passes on CUDA: a thread per particle, then a thread per node; sums are atomic. They meet after each loop."""

from pacnerf_lpo.mpm.arrays import Group, Setting
from pacnerf_lpo.mpm.lanes import LANES
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import add_to_slice, adjoint_group, forward_group
from pacnerf_lpo.mpm.taichi_calls import ti

BLOCK = 128
THREADS = 1 << 18
"""As many as the largest GPU of today has at once. A loop over a number that is known when it is compiled saves the
launch of one thread that reads its length; particles and nodes beyond it take turns.
"""
PASSES = 4
"""In a launch: with fewer than 50,000 particles a launch takes the processor longer than a pass takes the GPU."""


@ti.func
def passes(call: ti.template(), laws: ti.template(), parallel: ti.template(), back: ti.template()):
    """Particles, then grid; ``back``: their adjoint, the last pass first. The last pass of a frame begins nothing, the
    first completes nothing. Of a launch of fewer passes the rest are empty.
    """
    for turn in ti.static(range(PASSES - 1, -1, -1) if back else range(PASSES)):
        particle_pass(call, laws, back, turn)
        grid_pass(call, laws, back, turn)


@ti.func
def particle_pass(call: ti.template(), laws: ti.template(), back: ti.template(), turn: ti.template()):
    ti.loop_config(block_dim=BLOCK)
    for thread in range(THREADS):
        p, substep = thread, call.first + turn
        while p < call.dims[0] * LANES and substep < call.last:
            s = Setting.of(call, laws, substep)
            if ti.static(back):
                adjoint_group(s, 0, Group(p // LANES, p % LANES), 0)
            else:
                forward_group(s, 0, Group(p // LANES, p % LANES))
            p += THREADS


@ti.func
def grid_pass(call: ti.template(), laws: ti.template(), back: ti.template(), turn: ti.template()):
    ti.loop_config(block_dim=BLOCK)
    for thread in range(THREADS):
        o, substep = thread, call.first + turn
        idle = substep == (0 if ti.static(back) else call.substeps)
        while o < call.dims[1] * call.dims[2] * call.dims[3] and substep < call.last and not idle:
            s = Setting.of(call, laws, substep)
            i, j, k = o // s.dims.plane, (o // s.dims.row) % s.dims.size_y, o % s.dims.row
            if ti.static(back):
                mine = grid_update_adjoint(s, i, j, k, True)
                for c in ti.static(range(len(laws.names))):
                    add_to_slice(call.of_coefficients, 0, c, mine[c], True)
            else:
                grid_update(s, i, j, k, True)
            o += THREADS
