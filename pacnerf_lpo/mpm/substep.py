"""What one particle does in a launch, forward and backward: the order of the operators, and what is stored.

Launch s of a frame completes substep s - 1 (G2P and the motion) and begins substep s (local laws and P2G) in one pass
over the particles, so that a particle is read once per substep. The adjoint runs the same passes backward.
"""

from dataclasses import dataclass
from typing import Any

from pacnerf_lpo.mpm.arrays import (
    CONSTANTS,
    STATE,
    C,
    F,
    V,
    check_velocity,
    matrix,
    store,
    store_matrix,
    vector,
)
from pacnerf_lpo.mpm.operators import (
    affine_momentum,
    g2p,
    g2p_adjoint,
    local_laws,
    p2g,
    p2g_adjoint,
    stress_impulse,
)
from pacnerf_lpo.mpm.taichi_calls import Emitted, entries, ti
from pacnerf_lpo.mpm.transfer import stencil


@dataclass(frozen=True)
class Forward(Emitted):
    """Arrays of a forward launch, and what it does.

    before, now, ahead: states of the particles before the substep that is completed, after it, and after the next
    (which begins with their deformation).  velocity_in, velocity_out: of the nodes, with their mass.
    contact: velocity of nodes before the ground.  momentum: of the nodes, summed per slice.
    finish, begin: complete a substep, begin one.  keep_all: store v and C, too, which the last launch and a tape need.
    """

    before: Any
    now: Any
    ahead: Any
    velocity_in: Any
    velocity_out: Any
    contact: Any
    momentum: Any
    constants: Any
    finish: Any
    begin: Any
    keep_all: Any


@dataclass(frozen=True)
class Adjoint(Emitted):
    """Arrays of an adjoint launch, and what it does.

    now, before: states after and before the substep that is completed.  gradient: adjoint of the state.
    node: adjoints of the nodes' momentum and mass.  velocity, contact, momentum: as forward, of that substep.
    of_constants, of_coefficients: adjoints, summed up.  begun, finished: undo a beginning, undo a completion.
    """

    now: Any
    before: Any
    gradient: Any
    node: Any
    velocity: Any
    contact: Any
    momentum: Any
    constants: Any
    of_constants: Any
    of_coefficients: Any
    begun: Any
    finished: Any


@ti.func
def forward_particle(a: ti.template(), s: ti.template(), sums: ti.template(), p):
    """Completes a substep and begins the next; returns the first node of the stencil that momentum went to."""
    o = s.width * p
    cell = ti.Vector([0, 0, 0])
    x = vector(a.before, o)
    v, grad = ti.Vector.zero(float, 3), ti.Matrix.zero(float, 3, 3)
    if a.finish == 1:
        left = stencil(x, s, s.call.substep - 1)
        v, grad = g2p(a.velocity_in, left, s)
        x += s.n.dt * v
        check_velocity(v, s, s.call.substep - 1)
        store(a.now, o, x)
        if a.keep_all == 1:
            store(a.now, o + V, v)
            store_matrix(a.now, o + C, grad)
    else:
        v, grad = vector(a.now, o + V), matrix(a.now, o + C)
    if a.begin == 1:
        here = stencil(x, s, s.call.substep)
        laws = local_laws(a, s, p, x, v, grad, matrix(a.now, o + F))
        store_matrix(a.ahead, o + F, ti.Matrix(laws.F_new))
        for h in ti.static(range(s.laws.history)):
            a.ahead[o + STATE + h] = laws.history[h]
        mass = a.constants[CONSTANTS * p]
        A = affine_momentum(ti.Matrix(laws.tau), grad, mass, s)
        p2g(sums, here, s, mass, ti.Vector(laws.velocity), A)
        cell = here.cell
    return cell


@ti.func
def adjoint_particle(a: ti.template(), s: ti.template(), sums: ti.template(), p, of_coefficients: ti.template()):
    """Undoes the beginning of a substep and the completion of the one before; returns the first node it scattered to.

    Adjoints of the coefficients are added to ``of_coefficients``.
    """
    o, constant = s.width * p, CONSTANTS * p
    cell = ti.Vector([0, 0, 0])
    gx, gv = vector(a.gradient, o), vector(a.gradient, o + V)
    gC, gF = matrix(a.gradient, o + C), matrix(a.gradient, o + F)
    if a.begun == 1:
        x, v, grad, deformation = (
            vector(a.now, o),
            vector(a.now, o + V),
            matrix(a.now, o + C),
            matrix(a.now, o + F),
        )
        mass = a.constants[constant]
        laws = local_laws(a, s, p, x, v, grad, deformation)
        u = ti.Vector(laws.velocity)
        A = affine_momentum(ti.Matrix(laws.tau), grad, mass, s)
        here = stencil(x, s, s.call.substep)
        gx_weights, gu, gA, gmass = p2g_adjoint(a.node, here, s, mass, u, A)
        gtau = stress_impulse(gA, s)
        ghistory = [a.gradient[o + STATE + h] for h in ti.static(range(s.laws.history))]
        back = laws.pull_back(entries(gF), entries(gtau), [gu[0], gu[1], gu[2]], ghistory)
        gF = ti.Matrix(back.F)  # of the trial (I + dt C) F
        gC = mass * gA + s.n.dt * (gF @ deformation.transpose()) + ti.Matrix(back.C)
        gF += s.n.dt * (grad.transpose() @ gF)
        gv = ti.Vector(back.v)
        gx += gx_weights + ti.Vector(back.x)
        a.of_constants[constant] = a.of_constants[constant] + gmass + (gA * grad).sum() + back.mass
        a.of_constants[constant + 1] = a.of_constants[constant + 1] + back.stiffness
        for i in ti.static(range(3)):
            a.of_constants[constant + 2 + i] = a.of_constants[constant + 2 + i] + back.X[i]
        for h in ti.static(range(s.laws.history)):
            a.gradient[o + STATE + h] = back.history[h]
        for c in ti.static(range(len(s.coefficients))):
            of_coefficients[c] += back.coefficients[c]
    if a.finished == 1:
        left = stencil(vector(a.before, o), s, s.call.substep)
        gx += g2p_adjoint(sums, a.velocity, left, s, vector(a.now, o + V), gv + s.n.dt * gx, gC)
        cell = left.cell
    else:
        store(a.gradient, o + V, gv)
        store_matrix(a.gradient, o + C, gC)
    store(a.gradient, o, gx)
    store_matrix(a.gradient, o + F, gF)
    return cell
