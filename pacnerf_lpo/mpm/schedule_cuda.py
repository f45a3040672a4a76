"""The passes on CUDA: a thread per particle, then a thread per node; sums are atomic. One pass per launch."""

from pacnerf_lpo.mpm.arrays import Group, Setting
from pacnerf_lpo.mpm.lanes import LANES
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import add_to_slice, adjoint_group, forward_group
from pacnerf_lpo.mpm.taichi_calls import ti

BLOCK = 128


@ti.func
def passes(
    arrays: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template(), back: ti.template()
):
    """Particles, then grid; ``back``: their adjoint. The last pass begins nothing, the first completes nothing."""
    ti.loop_config(block_dim=BLOCK)
    for p in range(call.dims[0] * LANES):
        s = Setting.of(call, laws, call.first)
        if ti.static(back):
            adjoint_group(arrays.at(call, call.first), s, 0, Group(p // LANES, p % LANES), 0)
        else:
            forward_group(arrays.at(call, call.first), s, 0, Group(p // LANES, p % LANES))
    nodes = call.dims[1] * call.dims[2] * call.dims[3]
    for o in range((call.first != (0 if ti.static(back) else call.substeps)) * nodes):
        s = Setting.of(call, laws, call.first)
        a = arrays.at(call, call.first)
        i, j, k = o // s.dims.plane, (o // s.dims.row) % s.dims.size_y, o % s.dims.row
        if ti.static(back):
            mine = grid_update_adjoint(a, s, i, j, k, True)
            for c in ti.static(range(len(laws.names))):
                add_to_slice(a.of_coefficients, 0, c, mine[c], True)
        else:
            grid_update(a, s, i, j, k, True)
