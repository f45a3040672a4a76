"""The operators of a substep of MLS-MPM, each with its adjoint: local laws, P2G, the grid update, and G2P.

With a particle's mass m, position x, velocity v, velocity gradient C and deformation gradient F, and with quadratic
B-spline weights w_i(x) of the nodes at x_i (Hu et al., "A moving least squares material point method", SIGGRAPH 2018):

    laws      F, tau <- material((I + dt C) F);  u = v + dt a;  A = m C - 4 dt V / dx^2 tau
    P2G       m_i = sum_p w_i m,  p_i = sum_p w_i (m u + A (x_i - x))
    grid      v_i = p_i / m_i + dt g, then the ground
    G2P       v = sum_i w_i v_i,  C = 4 / dx^2 sum_i w_i v_i (x_i - x)^T,  x <- x + dt v

The adjoint of P2G gathers, the adjoint of G2P scatters. A name that begins with g is the adjoint of what follows it.
Numbers of a particle are those of a group: one, or a register full of them.
"""

from typing import Any

from pacnerf_lpo.mpm.arrays import Field, Group, Setting, total
from pacnerf_lpo.mpm.lanes import keep, kept
from pacnerf_lpo.mpm.point import Evaluation, GroundEvaluation, Point
from pacnerf_lpo.mpm.taichi_calls import components, ti
from pacnerf_lpo.mpm.tensors import AXES, Tensor3, added, dot, product, scaled
from pacnerf_lpo.mpm.transfer import Stencil, about, gather, linear, scatter, scatter_and_slope


def local_laws(s: Setting, x: list, v: list, C: Tensor3, F: Tensor3, history: list, constants: list) -> Evaluation:
    mass, stiffness, *start = constants[:5]
    trial = kept(added(F, scaled(product(C, F), s.n.dt)))
    time = s.n.start + s.n.dt * s.substep
    point = Point(trial, C, x, start, v, time, s.n.dt, mass, s.n.volume, stiffness, history)
    return Evaluation(s.laws, point, s.coefficients)


def stress_impulse(tau: Tensor3, alive: Any, s: Setting) -> Tensor3:
    """Momentum per metre from the particle that its stress gives in a substep; its own adjoint."""
    return scaled(tau, keep((-4.0 * s.n.dt * s.n.volume * s.n.inv_dx * s.n.inv_dx) * alive))


def p2g(field: Field, here: Stencil, s: Setting, mass: Any, u: list, A: Tensor3, group: Group) -> None:
    """Mass and momentum of the particles, added to their nodes."""
    scatter(field, here, linear([mass * a for a in u], kept(scaled(A, s.n.dx)), mass, here), s, group)


def p2g_adjoint(
    field: Field, here: Stencil, s: Setting, mass: Any, u: list, A: Tensor3, group: Group
) -> tuple[list, list, Tensor3, Any]:
    """Adjoints of x (through the weights), u, A and mass, from those of the nodes."""
    given = linear([mass * a for a in u], kept(scaled(A, s.n.dx)), mass, here)
    moments = gather(field, here, s, group, given)
    h, slope = moments[:3], moments[13:]
    gx = [keep(s.n.inv_dx * slope[i] - dot([row[i] for row in A], h)) for i in AXES]
    return gx, [keep(mass * a) for a in h], about(moments, here, s.n.dx), keep(moments[3] + dot(h, u))


def g2p(field: Field, here: Stencil, s: Setting, group: Group) -> tuple[list, Tensor3]:
    """Velocity and velocity gradient of the particles from their nodes."""
    moments = gather(field, here, s, group)
    return moments[:3], about(moments, here, keep(4.0 * s.n.inv_dx))


def g2p_adjoint(
    field: Field, velocity: Field, here: Stencil, s: Setting, v: list, gv: list, gC: Tensor3, group: Group
) -> list:
    """Adjoints of the nodes' velocities, added to a field; returns that of x, through the weights."""
    B = kept(scaled(gC, keep(4.0 * s.n.inv_dx)))
    slope = scatter_and_slope(field, velocity, here, linear(gv, B, 0.0, here), s, group)
    return [keep(s.n.inv_dx * (slope[i] - dot([row[i] for row in B], v))) for i in AXES]


@ti.func
def grid_update(s: ti.template(), i, j, k, atomic: ti.template()):
    """Velocity of a node from its momentum: gravity, then the ground, where the node lies on it or below."""
    o = s.dims.place(i, j, k)
    q = total(s.call.momentum, s, i, o, atomic)
    u = ti.Vector.zero(float, 3)
    if q[3] > s.n.lightest:
        u = ti.Vector([q[0], q[1], q[2]]) / q[3] + s.n.dt * gravity(s)
    if on_ground(s, j):
        free = s.call.contacts * s.substep + contact(s, i, j, k)
        for axis in ti.static(range(3)):
            s.call.contact[free + axis] = u[axis]
        ground = GroundEvaluation(s.laws, components(u), s.coefficients)
        u = ti.Vector(ground.velocity)
    s.call.velocity[s.call.nodes * s.substep + o] = ti.Vector([u[0], u[1], u[2], q[3]])


@ti.func
def grid_update_adjoint(s: ti.template(), i, j, k, atomic: ti.template()):
    """Adjoints of a node's momentum and mass, into ``node``; returns those of the coefficients of the ground."""
    o, before = s.dims.place(i, j, k), s.substep - 1
    q = total(s.call.momentum, s, i, o, atomic)
    known = s.call.velocity[s.call.nodes * before + o]
    g, u, mass = ti.Vector([q[0], q[1], q[2]]), ti.Vector([known[0], known[1], known[2]]), known[3]
    of_coefficients = ti.Vector.zero(ti.f64, len(s.coefficients))
    if on_ground(s, j):
        free = s.call.contacts * before + contact(s, i, j, k)
        u = ti.Vector([s.call.contact[free], s.call.contact[free + 1], s.call.contact[free + 2]])
        ground = GroundEvaluation(s.laws, components(u), s.coefficients)
        back = ground.pull_back(components(g))
        g = ti.Vector([back[0], back[1], back[2]])
        for c in ti.static(range(len(s.coefficients))):
            of_coefficients[c] = back[3 + c]
    out = ti.Vector.zero(float, 4)
    if mass > s.n.lightest:
        h = g / mass
        out = ti.Vector([h[0], h[1], h[2], -h.dot(u - s.n.dt * gravity(s))])
    s.call.node[o] = out
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
