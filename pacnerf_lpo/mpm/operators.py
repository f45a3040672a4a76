"""The operators of a substep of MLS-MPM, each with its adjoint: local laws, P2G, the grid update, and G2P.

With a particle's mass m, position x, velocity v, velocity gradient C and deformation gradient F, and with quadratic
B-spline weights w_i(x) of the nodes at x_i (Hu et al., "A moving least squares material point method", SIGGRAPH 2018):

    laws      F, tau <- material((I + dt C) F);  u = v + dt a;  A = m C - 4 dt V / dx^2 tau
    P2G       m_i = sum_p w_i m,  p_i = sum_p w_i (m u + A (x_i - x))
    grid      v_i = p_i / m_i + dt g, then the ground
    G2P       v = sum_i w_i v_i,  C = 4 / dx^2 sum_i w_i v_i (x_i - x)^T,  x <- x + dt v

The adjoint of P2G gathers, the adjoint of G2P scatters. A name that begins with g is the adjoint of what follows it.
"""

from pacnerf_lpo.mpm.arrays import CONSTANTS, STATE, total, vector
from pacnerf_lpo.mpm.point import Evaluation, GroundEvaluation, Point
from pacnerf_lpo.mpm.taichi_calls import components, entries, ti
from pacnerf_lpo.mpm.transfer import about, gather, gather_with_slope, linear, scatter, with_fourth


@ti.func
def local_laws(a: ti.template(), s: ti.template(), p, x, v, C, F):
    """All local laws at particle ``p``; ``a`` has its constants and, in ``now``, its history."""
    trial = F + s.n.dt * (C @ F)
    return Evaluation(
        s.laws,
        Point(
            entries(trial),
            entries(C),
            components(x),
            [a.constants[CONSTANTS * p + 2 + i] for i in ti.static(range(3))],
            components(v),
            s.n.start + s.n.dt * s.call.substep,
            s.n.dt,
            a.constants[CONSTANTS * p],
            s.n.volume,
            a.constants[CONSTANTS * p + 1],
            [a.now[s.width * p + STATE + h] for h in ti.static(range(s.laws.history))],
        ),
        s.coefficients,
    )


@ti.func
def affine_momentum(tau, C, mass, s: ti.template()):
    """A: momentum per metre from the particle, of its velocity gradient and of its stress."""
    return mass * C + stress_impulse(tau, s)


@ti.func
def stress_impulse(tau, s: ti.template()):
    """Momentum per metre from the particle that its stress gives in a substep; its own adjoint."""
    return (-4.0 * s.n.dt * s.n.volume * s.n.inv_dx * s.n.inv_dx) * tau


@ti.func
def p2g(sums: ti.template(), here: ti.template(), s: ti.template(), mass, u, A):
    """Mass and momentum of a particle, added to its nodes."""
    given = linear(mass * u, A * s.n.dx, mass, here)
    scatter(sums, here, given)


@ti.func
def p2g_adjoint(node: ti.template(), here: ti.template(), s: ti.template(), mass, u, A):
    """Adjoints of x (through the weights), u, A and mass, from those of the nodes."""
    given = linear(mass * u, A * s.n.dx, mass, here)
    moments, slope = gather_with_slope(node, here, given)
    h = ti.Vector([moments.m[0], moments.m[1], moments.m[2]])
    gA = about(moments, here, s.n.dx)
    gx = s.n.inv_dx * slope - A.transpose() @ h
    return gx, mass * h, gA, moments.m[3] + h.dot(u)


@ti.func
def g2p(velocity: ti.template(), here: ti.template(), s: ti.template()):
    """Velocity and velocity gradient of a particle from its nodes."""
    moments = gather(velocity, here)
    v = ti.Vector([moments.m[0], moments.m[1], moments.m[2]])
    return v, about(moments, here, 4.0 * s.n.inv_dx)


@ti.func
def g2p_adjoint(sums: ti.template(), velocity: ti.template(), here: ti.template(), s: ti.template(), v, gv, gC):
    """Adjoints of the nodes' velocities, added to them; returns that of x, through the weights."""
    B = (4.0 * s.n.inv_dx) * gC
    given = linear(gv, B, 0.0, here)
    scatter(sums, here, given)
    _moments, slope = gather_with_slope(velocity, here, given)
    return s.n.inv_dx * (slope - B.transpose() @ v)


@ti.func
def grid_update(a: ti.template(), s: ti.template(), i, j, k):
    """Velocity of a node from its momentum: gravity, then the ground, where the node lies on it or below."""
    o = (i * s.dims.size_y + j) * s.dims.size_z + k
    q = total(a.momentum, s, i, o)
    u = ti.Vector.zero(float, 3)
    if q[3] > s.n.lightest:
        u = ti.Vector([q[0], q[1], q[2]]) / q[3] + s.n.dt * gravity(s)
    if on_ground(s, j):
        free = contact(s, i, j, k)
        for axis in ti.static(range(3)):
            a.contact[free + axis] = u[axis]
        ground = GroundEvaluation(s.laws, components(u), s.coefficients)
        u = ti.Vector(ground.velocity)
    a.velocity_out[o] = with_fourth(u, q[3])


@ti.func
def grid_update_adjoint(a: ti.template(), s: ti.template(), i, j, k):
    """Adjoints of a node's momentum and mass, into ``a.node``; returns those of the coefficients of the ground."""
    o = (i * s.dims.size_y + j) * s.dims.size_z + k
    q = total(a.momentum, s, i, o)
    known = a.velocity[o]
    g, u, mass = ti.Vector([q[0], q[1], q[2]]), ti.Vector([known[0], known[1], known[2]]), known[3]
    of_coefficients = ti.Vector.zero(ti.f64, len(s.coefficients))
    if on_ground(s, j):
        u = vector(a.contact, contact(s, i, j, k))
        ground = GroundEvaluation(s.laws, components(u), s.coefficients)
        back = ground.pull_back(components(g))
        g = ti.Vector([back[0], back[1], back[2]])
        for c in ti.static(range(len(s.coefficients))):
            of_coefficients[c] = back[3 + c]
    out = ti.Vector.zero(float, 4)
    if mass > s.n.lightest:
        h = g / mass
        out = with_fourth(h, -h.dot(u - s.n.dt * gravity(s)))
    a.node[o] = out
    return of_coefficients


@ti.func
def gravity(s: ti.template()):
    return ti.Vector([s.n.gravity_x, s.n.gravity_y, s.n.gravity_z])


@ti.func
def on_ground(s: ti.template(), j):
    return j + s.dims.first_y <= 0


@ti.func
def contact(s: ti.template(), i, j, k):
    """Where the velocity of a node at y <= 0 before the ground is kept."""
    return 3 * ((i * (1 - s.dims.first_y) + j) * s.dims.size_z + k)
