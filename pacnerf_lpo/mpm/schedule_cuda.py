"""The passes of a launch on CUDA: a thread per particle, then a thread per node; sums are atomic."""

from pacnerf_lpo.mpm.arrays import Setting
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import adjoint_particle, forward_particle
from pacnerf_lpo.mpm.taichi_calls import ti
from pacnerf_lpo.mpm.transfer import Sums

BLOCK = 128


@ti.func
def forward(a: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """Particles, then grid."""
    ti.loop_config(block_dim=BLOCK)
    for p in range(call.slices):
        s = Setting.of(call, laws, True)
        forward_particle(a, s, Sums(a.momentum, 0, True), p)
    for o in range(a.begin * call.dims[1] * call.dims[2] * call.dims[3]):
        s = Setting.of(call, laws, True)
        grid_update(a, s, o // s.dims.plane, (o // s.dims.row) % s.dims.size_y, o % s.dims.row)


@ti.func
def adjoint(a: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """Particles, then grid."""
    ti.loop_config(block_dim=BLOCK)
    for p in range(call.slices):
        s = Setting.of(call, laws, True)
        mine = ti.Vector.zero(ti.f64, len(laws.names))
        adjoint_particle(a, s, Sums(a.momentum, 0, True), p, mine)
        add_atomically(a.of_coefficients, mine)
    for o in range(a.finished * call.dims[1] * call.dims[2] * call.dims[3]):
        s = Setting.of(call, laws, True)
        mine = grid_update_adjoint(a, s, o // s.dims.plane, (o // s.dims.row) % s.dims.size_y, o % s.dims.row)
        add_atomically(a.of_coefficients, mine)


@ti.func
def add_atomically(sums: ti.template(), values: ti.template()):
    """sums += values; most are zero, of nodes above the ground."""
    for c in ti.static(range(values.n)):
        if values[c] != 0.0:
            ti.atomic_add(sums[c], values[c])
