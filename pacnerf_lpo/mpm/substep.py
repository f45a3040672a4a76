"""What a group of particles does in a pass, forward and backward: the order of the operators, and what is stored.

Pass s of a frame completes substep s - 1 (G2P and the motion) and begins substep s (local laws and P2G) in one go over
the particles, so that a particle is read once per substep. The adjoint goes through the same passes backward.
"""

from typing import Any

from pacnerf_lpo.mpm.arrays import (
    ALIVE,
    CONSTANTS,
    MASS,
    STATE,
    C,
    F,
    Field,
    Group,
    Setting,
    V,
    check_stencil,
    check_velocity,
)
from pacnerf_lpo.mpm.lanes import keep, kept, new_scope, summed
from pacnerf_lpo.mpm.operators import g2p, g2p_adjoint, local_laws, p2g, p2g_adjoint, stress_impulse
from pacnerf_lpo.mpm.taichi_calls import ti
from pacnerf_lpo.mpm.tensors import AXES, added, contraction, flat, product, scaled, transposed
from pacnerf_lpo.mpm.transfer import stencil


@ti.func
def forward_group(s: ti.template(), first, group: ti.template()):
    """Completes a substep and begins the next; momentum goes to the field from node ``first`` on."""
    if s.substep > 0:
        complete(s, group)
    if s.substep < s.call.substeps:
        begin(s, first, group)


def complete(s: Setting, group: Group) -> None:
    """G2P and the motion."""
    new_scope()
    states, velocity = s.call.states, Field(s.call.velocity, s.call.nodes * (s.substep - 1))
    x, now = group.numbers(states, s.rows(group, s.substep - 1), 3), s.rows(group, s.substep)
    v, grad = g2p(velocity, stencil(x, s), s, group)
    check_velocity(v, s, group)
    group.write(states, now, [keep(x[i] + s.n.dt * v[i]) for i in AXES])
    group.write(states, now + V, [*v, *flat(grad)])


def begin(s: Setting, first: Any, group: Group) -> None:
    """The local laws and P2G."""
    new_scope()
    states, now = s.call.states, s.rows(group, s.substep)
    x, v = group.numbers(states, now, 3), group.numbers(states, now + V, 3)
    grad, deformation = group.tensor(states, now + C), group.tensor(states, now + F)
    history = group.numbers(states, now + STATE, s.laws.history)
    constants = group.numbers(s.call.constants, group.block * CONSTANTS, CONSTANTS)
    here = stencil(x, s)
    check_stencil(here.cell, here.outside, s, group)
    laws = local_laws(s, x, v, grad, deformation, history, constants)
    group.write(states, s.rows(group, s.substep + 1) + F, [*flat(laws.F_new), *laws.history])
    mass = keep(constants[ALIVE] * constants[MASS])
    A = kept(added(scaled(grad, mass), stress_impulse(laws.tau, constants[ALIVE], s)))
    p2g(Field(s.call.momentum, first), here, s, mass, laws.velocity, A, group)


@ti.func
def adjoint_group(s: ti.template(), first, group: ti.template(), row):
    """Undoes the beginning of a substep and the completion of the one before, whose adjoint goes to the field from node
    ``first`` on; adjoints of the coefficients are added to those of ``slice``.
    """
    if s.substep < s.call.substeps:
        undo_begin(s, group, row)
    if s.substep > 0:
        undo_complete(s, first, group)


def undo_begin(s: Setting, group: Group, row: Any) -> None:
    """Adjoint of :func:`begin`."""
    new_scope()
    call, now = s.call, s.rows(group, s.substep)
    o, constant = keep(group.block * s.width), keep(group.block * CONSTANTS)
    x, v = group.numbers(call.states, now, 3), group.numbers(call.states, now + V, 3)
    grad, deformation = group.tensor(call.states, now + C), group.tensor(call.states, now + F)
    history = group.numbers(call.states, now + STATE, s.laws.history)
    constants = group.numbers(call.constants, constant, CONSTANTS)
    laws, here = local_laws(s, x, v, grad, deformation, history, constants), stencil(x, s)
    alive, mass = constants[ALIVE], keep(constants[ALIVE] * constants[MASS])
    A = kept(added(scaled(grad, mass), stress_impulse(laws.tau, alive, s)))
    gx, gu, gA, gmass = p2g_adjoint(Field(call.node, 0), here, s, mass, laws.velocity, A, group)
    gF, ghistory = group.tensor(call.gradient, o + F), group.numbers(call.gradient, o + STATE, s.laws.history)
    back = laws.pull_back(gF, stress_impulse(gA, alive, s), gu, ghistory)
    gtrial = kept(back.F)
    gC = added(added(scaled(gA, mass), back.C), scaled(product(gtrial, transposed(deformation)), s.n.dt))
    gF = added(gtrial, scaled(product(transposed(grad), gtrial), s.n.dt))
    known = group.numbers(call.gradient, o, 3)
    group.write(call.gradient, o, [known[i] + gx[i] + back.x[i] for i in AXES])
    group.write(call.gradient, o + V, [*back.v, *flat(gC), *flat(gF), *back.history])
    own = [alive * (gmass + contraction(gA, grad)) + back.mass, back.stiffness, *back.X]
    summed_before = group.numbers(call.of_constants, constant, len(own))
    group.write(call.of_constants, constant, [x + y for x, y in zip(summed_before, own, strict=True)])
    for c, of_coefficient in enumerate(back.coefficients):
        add_to_slice(call.of_coefficients, row, c, summed(keep(of_coefficient)), group.lane is not None)


def undo_complete(s: Setting, first: Any, group: Group) -> None:
    """Adjoint of :func:`complete`."""
    new_scope()
    call, o = s.call, keep(group.block * s.width)
    gx, gv = group.numbers(call.gradient, o, 3), group.numbers(call.gradient, o + V, 3)
    gC = group.tensor(call.gradient, o + C)
    left = stencil(group.numbers(call.states, s.rows(group, s.substep - 1), 3), s)
    check_stencil(left.cell, 0.0, s, group)
    v = group.numbers(call.states, s.rows(group, s.substep) + V, 3)
    gv = [keep(gv[i] + s.n.dt * gx[i]) for i in AXES]
    to, velocity = Field(call.momentum, first), Field(call.velocity, call.nodes * (s.substep - 1))
    through_weights = g2p_adjoint(to, velocity, left, s, v, gv, gC, group)
    group.write(call.gradient, o, [gx[i] + through_weights[i] for i in AXES])


@ti.func
def add_to_slice(sums: ti.template(), row, c: ti.template(), value, atomic: ti.template()):
    """sums[row + c] += value, atomically where other threads add there, too."""
    if ti.static(atomic):
        if value != 0.0:
            ti.atomic_add(sums[row + c], value)
    else:
        sums[row + c] = sums[row + c] + value
