"""Layout of the engine's arrays, and the small pieces of a kernel that read, write and check them."""

# mypy: disable-error-code="valid-type,index"

from pacnerf_lpo.mpm.runtime import ti

STATE = 24
CONSTANTS = 5
"""Per particle: mass [kg], stiffness factor, position at time 0 [m]."""
NUMBERS = 9
"""Before the coefficients: dx, 1/dx, dt, volume, gravity (3), smallest mass of a node, time at frame start."""
NOT_YET = 1 << 30
CAUSES = ("NaN in the velocity of a particle", "|v| dt > dx", "a particle left the grid")


@ti.func
def vector(a: ti.template(), o):
    return ti.Vector([a[o], a[o + 1], a[o + 2]])


@ti.func
def matrix(a: ti.template(), o):
    return ti.Matrix([[a[o], a[o + 1], a[o + 2]], [a[o + 3], a[o + 4], a[o + 5]], [a[o + 6], a[o + 7], a[o + 8]]])


@ti.func
def store(a: ti.template(), o, value: ti.template()):
    for i in ti.static(range(3)):
        a[o + i] = value[i]


@ti.func
def store_matrix(a: ti.template(), o, value: ti.template()):
    for i, j in ti.static(ti.ndrange(3, 3)):
        a[o + 3 * i + j] = value[i, j]


@ti.func
def trial(C, F, dt):
    return F + dt * (C @ F)


@ti.func
def affine_momentum(tau, C, mass, dt, volume, inv_dx):
    """Momentum per metre from the particle: stress impulse and affine velocity."""
    return (-4.0 * dt * volume * inv_dx * inv_dx) * tau + mass * C


@ti.func
def flag(status: ti.template(), cause, substep):
    ti.atomic_min(status[cause], substep)


@ti.func
def check_velocity(v, dt, dx, status: ti.template(), substep):
    step = v.norm_sqr() * dt * dt
    if not step <= dx * dx:
        if step > dx * dx:
            flag(status, 1, substep)
        else:
            flag(status, 0, substep)


@ti.func
def inside(first, dims: ti.template(), status: ti.template(), substep):
    """Index of the first node of a stencil in this grid, moved into it (and reported) when outside."""
    cell = ti.Vector([0, 0, 0])
    for a in ti.static(range(3)):
        cell[a] = ti.max(0, ti.min(first[a] - dims[4 + a], dims[1 + a] - 3))
        if cell[a] != first[a] - dims[4 + a]:
            flag(status, 2, substep)
    return cell


@ti.func
def reach(spans: ti.template(), slices):
    """First and last node within reach of any particle, over all slices."""
    low, high = ti.Vector([NOT_YET, NOT_YET, NOT_YET]), ti.Vector([-1, -1, -1])
    for r in range(slices):
        for a in ti.static(range(3)):
            low[a] = ti.min(low[a], spans[6 * r + a])
            high[a] = ti.max(high[a], spans[6 * r + 3 + a] + 2)
    return low, high


@ti.func
def total(field: ti.template(), spans: ti.template(), i, o, size, slices, atomic: ti.template()):
    """Sum over the slices of the four numbers of a node, cleared for the next substep."""
    zero = ti.Vector.zero(float, 4)
    q = zero
    if ti.static(atomic):
        q = field[o]
        field[o] = zero
    else:
        for r in range(slices):
            if spans[6 * r] <= i <= spans[6 * r + 3] + 2:
                q += field[r * size + o]
                field[r * size + o] = zero
    return q
