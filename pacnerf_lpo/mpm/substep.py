"""What a group of particles does in a pass, forward and backward: the order of the operators, and what is stored.

Pass s of a frame completes substep s - 1 (G2P and the motion) and begins substep s (local laws and P2G) in one go over
the particles, so that a particle is read once per substep. The adjoint goes through the same passes backward.
"""

from dataclasses import dataclass, replace
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
    Launch,
    Setting,
    V,
    check_stencil,
    check_velocity,
)
from pacnerf_lpo.mpm.lanes import keep, kept, new_scope, summed
from pacnerf_lpo.mpm.operators import g2p, g2p_adjoint, local_laws, p2g, p2g_adjoint, stress_impulse
from pacnerf_lpo.mpm.taichi_calls import Emitted, ti
from pacnerf_lpo.mpm.tensors import AXES, added, contraction, flat, product, scaled, transposed
from pacnerf_lpo.mpm.transfer import stencil


@dataclass(frozen=True)
class Arrays(Emitted):
    """Arrays of a launch; :meth:`at` says where those of a substep begin in them.

    states: of the particles.  velocity: of the nodes, with their mass.  contact: velocity of nodes before the ground.
    momentum: of the nodes, summed per slice.
    gradient: adjoint of the state.  node: adjoints of the nodes' momentum and mass.
    of_constants, of_coefficients: adjoints, summed up.
    before, now, ahead: states before the substep that is completed, after it, and after the next (which begins with
    their deformation).  velocity_before, contact_before, velocity_now, contact_now: of the substep completed, and of
    the one begun.
    """

    states: Any
    velocity: Any
    contact: Any
    momentum: Any
    constants: Any
    gradient: Any
    node: Any
    of_constants: Any
    of_coefficients: Any
    before: Any = None
    now: Any = None
    ahead: Any = None
    velocity_before: Any = None
    velocity_now: Any = None
    contact_before: Any = None
    contact_now: Any = None

    def at(self, call: Launch, substep: Any) -> "Arrays":
        """With the places of a substep."""
        earlier = keep(ti.max(substep - 1, 0))
        return replace(
            self, before=keep(call.state * earlier), now=keep(call.state * substep),
            ahead=keep(call.state * (substep + 1)), velocity_before=keep(call.nodes * earlier),
            velocity_now=keep(call.nodes * substep), contact_before=keep(call.contact * earlier),
            contact_now=keep(call.contact * substep),
        )  # fmt: skip


@ti.func
def forward_group(a: ti.template(), s: ti.template(), first, group: ti.template()):
    """Completes a substep and begins the next; momentum goes to the field from node ``first`` on."""
    if s.substep > 0:
        complete(a, s, group)
    if s.substep < s.call.substeps:
        begin(a, s, first, group)


def complete(a: Arrays, s: Setting, group: Group) -> None:
    """G2P and the motion."""
    new_scope()
    o = keep(group.block * s.width)
    x = group.numbers(a.states, a.before + o, 3)
    v, grad = g2p(Field(a.velocity, a.velocity_before), stencil(x, s), s, group)
    check_velocity(v, s, group)
    group.write(a.states, a.now + o, [keep(x[i] + s.n.dt * v[i]) for i in AXES])
    group.write(a.states, a.now + o + V, [*v, *flat(grad)])


def begin(a: Arrays, s: Setting, first: Any, group: Group) -> None:
    """The local laws and P2G."""
    new_scope()
    o = keep(group.block * s.width)
    x, v = group.numbers(a.states, a.now + o, 3), group.numbers(a.states, a.now + o + V, 3)
    grad, deformation = group.tensor(a.states, a.now + o + C), group.tensor(a.states, a.now + o + F)
    history = group.numbers(a.states, a.now + o + STATE, s.laws.history)
    constants = group.numbers(a.constants, group.block * CONSTANTS, CONSTANTS)
    here = stencil(x, s)
    check_stencil(here.cell, here.outside, s, group)
    laws = local_laws(s, x, v, grad, deformation, history, constants)
    group.write(a.states, a.ahead + o + F, [*flat(laws.F_new), *laws.history])
    mass = keep(constants[ALIVE] * constants[MASS])
    A = kept(added(scaled(grad, mass), stress_impulse(laws.tau, constants[ALIVE], s)))
    p2g(Field(a.momentum, first), here, s, mass, laws.velocity, A, group)


@ti.func
def adjoint_group(a: ti.template(), s: ti.template(), first, group: ti.template(), row):
    """Undoes the beginning of a substep and the completion of the one before, whose adjoint goes to the field from node
    ``first`` on; adjoints of the coefficients are added to those of ``slice``.
    """
    if s.substep < s.call.substeps:
        undo_begin(a, s, group, row)
    if s.substep > 0:
        undo_complete(a, s, first, group)


def undo_begin(a: Arrays, s: Setting, group: Group, row: Any) -> None:
    """Adjoint of :func:`begin`."""
    new_scope()
    o, constant = keep(group.block * s.width), keep(group.block * CONSTANTS)
    x, v = group.numbers(a.states, a.now + o, 3), group.numbers(a.states, a.now + o + V, 3)
    grad, deformation = group.tensor(a.states, a.now + o + C), group.tensor(a.states, a.now + o + F)
    history = group.numbers(a.states, a.now + o + STATE, s.laws.history)
    constants = group.numbers(a.constants, constant, CONSTANTS)
    laws, here = local_laws(s, x, v, grad, deformation, history, constants), stencil(x, s)
    alive, mass = constants[ALIVE], keep(constants[ALIVE] * constants[MASS])
    A = kept(added(scaled(grad, mass), stress_impulse(laws.tau, alive, s)))
    gx, gu, gA, gmass = p2g_adjoint(Field(a.node, 0), here, s, mass, laws.velocity, A, group)
    gF, ghistory = group.tensor(a.gradient, o + F), group.numbers(a.gradient, o + STATE, s.laws.history)
    back = laws.pull_back(gF, stress_impulse(gA, alive, s), gu, ghistory)
    gtrial = kept(back.F)
    gC = added(added(scaled(gA, mass), back.C), scaled(product(gtrial, transposed(deformation)), s.n.dt))
    gF = added(gtrial, scaled(product(transposed(grad), gtrial), s.n.dt))
    known = group.numbers(a.gradient, o, 3)
    group.write(a.gradient, o, [known[i] + gx[i] + back.x[i] for i in AXES])
    group.write(a.gradient, o + V, [*back.v, *flat(gC), *flat(gF), *back.history])
    own = [alive * (gmass + contraction(gA, grad)) + back.mass, back.stiffness, *back.X]
    summed_before = group.numbers(a.of_constants, constant, len(own))
    group.write(a.of_constants, constant, [x + y for x, y in zip(summed_before, own, strict=True)])
    for c, of_coefficient in enumerate(back.coefficients):
        add_to_slice(a.of_coefficients, row, c, summed(keep(of_coefficient)), group.lane is not None)


def undo_complete(a: Arrays, s: Setting, first: Any, group: Group) -> None:
    """Adjoint of :func:`complete`."""
    new_scope()
    o = keep(group.block * s.width)
    gx, gv, gC = group.numbers(a.gradient, o, 3), group.numbers(a.gradient, o + V, 3), group.tensor(a.gradient, o + C)
    left = stencil(group.numbers(a.states, a.before + o, 3), s)
    check_stencil(left.cell, 0.0, s, group)
    v = group.numbers(a.states, a.now + o + V, 3)
    gv = [keep(gv[i] + s.n.dt * gx[i]) for i in AXES]
    to, velocity = Field(a.momentum, first), Field(a.velocity, a.velocity_before)
    through_weights = g2p_adjoint(to, velocity, left, s, v, gv, gC, group)
    group.write(a.gradient, o, [gx[i] + through_weights[i] for i in AXES])


@ti.func
def add_to_slice(sums: ti.template(), row, c: ti.template(), value, atomic: ti.template()):
    """sums[row + c] += value, atomically where other threads add there, too."""
    if ti.static(atomic):
        if value != 0.0:
            ti.atomic_add(sums[row + c], value)
    else:
        sums[row + c] = sums[row + c] + value
