"""The passes of a launch on the CPU: each thread owns a slice of the particles and a field on the nodes.

So no sum is atomic; the pass over the grid adds the fields up and clears them, over the nodes in reach of a particle
only.
"""

from pacnerf_lpo.mpm.arrays import NOT_YET, Setting, reach, store_span
from pacnerf_lpo.mpm.operators import grid_update, grid_update_adjoint
from pacnerf_lpo.mpm.substep import adjoint_particle, forward_particle
from pacnerf_lpo.mpm.taichi_calls import ti
from pacnerf_lpo.mpm.transfer import Sums

LEAST_SHARE = 512
"""Taichi gives a CPU thread at least so many iterations of a loop, whatever block_dim says: so far apart slices lie."""


@ti.func
def forward(a: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """Particles, then grid; with ``parallel`` one thread per slice, else one slice in the calling thread."""
    apart = ti.static(LEAST_SHARE if parallel else 1)
    ti.loop_config(serialize=not parallel)
    for n in range(call.slices * apart):
        if n % apart == 0:
            t = n // apart
            s = Setting.of(call, laws, False)
            sums = Sums(a.momentum, first_of(t, s), False)
            low, high = nowhere()
            for p in range(t * call.chunk, ti.min((t + 1) * call.chunk, s.dims.particles)):
                cell = forward_particle(a, s, sums, p)
                low, high = ti.min(low, cell), ti.max(high, cell)
            store_span(call.spans, t, low, high)
    ti.loop_config(serialize=not parallel)
    for n in range(call.slices * apart):
        if n % apart == 0:
            s = Setting.of(call, laws, False)
            low, high = reach(call)
            first, last = share(n // apart, call.slices, low[0], a.begin * (high[0] + 1 - low[0]))
            for i in range(first, last):
                for j in range(low[1], high[1] + 1):
                    for k in range(low[2], high[2] + 1):
                        grid_update(a, s, i, j, k)


@ti.func
def adjoint(a: ti.template(), call: ti.template(), laws: ti.template(), parallel: ti.template()):
    """Particles, then grid; each slice adds the adjoints of the coefficients up by itself."""
    apart = ti.static(LEAST_SHARE if parallel else 1)
    ti.loop_config(serialize=not parallel)
    for n in range(call.slices * apart):
        if n % apart == 0:
            t = n // apart
            s = Setting.of(call, laws, False)
            sums = Sums(a.momentum, first_of(t, s), False)
            low, high = nowhere()
            mine = ti.Vector.zero(ti.f64, len(laws.names))
            for p in range(t * call.chunk, ti.min((t + 1) * call.chunk, s.dims.particles)):
                cell = adjoint_particle(a, s, sums, p, mine)
                low, high = ti.min(low, cell), ti.max(high, cell)
            store_span(call.spans, t, low, high)
            add_to_slice(a.of_coefficients, t, mine)
    ti.loop_config(serialize=not parallel)
    for n in range(call.slices * apart):
        if n % apart == 0:
            s = Setting.of(call, laws, False)
            low, high = reach(call)
            mine = ti.Vector.zero(ti.f64, len(laws.names))
            first, last = share(n // apart, call.slices, low[0], a.finished * (high[0] + 1 - low[0]))
            for i in range(first, last):
                for j in range(low[1], high[1] + 1):
                    for k in range(low[2], high[2] + 1):
                        mine += grid_update_adjoint(a, s, i, j, k)
            add_to_slice(a.of_coefficients, n // apart, mine)


@ti.func
def nowhere():
    """First and last node of no stencil."""
    return ti.Vector([NOT_YET, NOT_YET, NOT_YET]), ti.Vector([-3, -3, -3])


@ti.func
def first_of(t, s: ti.template()):
    """First node of the field of slice ``t``."""
    return t * s.dims.nodes


@ti.func
def share(t, slices, first, count):
    """Beginning and end of the share of slice ``t`` in ``count`` planes from ``first`` on."""
    return first + t * count // slices, first + (t + 1) * count // slices


@ti.func
def add_to_slice(sums: ti.template(), t, values: ti.template()):
    """sums[t] += values, of an array with a row per slice."""
    count = ti.static(values.n)
    for c in ti.static(range(count)):
        sums[count * t + c] = sums[count * t + c] + values[c]
