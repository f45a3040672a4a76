"""The two kernels of a substep: forward, and its adjoint. Everything else in the engine calls these.

Launch s of a frame of S substeps first completes substep s - 1 (G2P), then begins substep s (local laws and P2G) in
the same pass over the particles, then updates the grid. So a particle is read once per substep and a frame takes S +
1 launches. The
adjoint runs the same passes backward: the adjoint of P2G gathers, the adjoint of G2P scatters.

On the CPU each thread owns a slice of the particles and a grid of its own, so no sum is atomic; the grid pass adds
them up and clears them, over the nodes in reach of a particle only. On CUDA a slice is one particle and the sums are
atomic.

Arrays are flat. A particle's state is 24 numbers: position 3, velocity 3, velocity gradient C 9, deformation gradient
F 9, and the history of effects on the law, which most simulations have none of.
"""

import functools

from pacnerf_lpo.mpm.arrays import (
    CONSTANTS,
    NOT_YET,
    NUMBERS,
    STATE,
    affine_momentum,
    check_velocity,
    inside,
    matrix,
    reach,
    store,
    store_matrix,
    total,
    trial,
    vector,
)
from pacnerf_lpo.mpm.point import Evaluation, GroundEvaluation, LocalLaws
from pacnerf_lpo.mpm.runtime import REAL, Launcher, entries, ti
from pacnerf_lpo.mpm.transfer import column, gather, gather_adjoint, scatter, stencil, with_fourth

LEAST_SHARE = 512
"""Taichi gives a CPU thread at least so many iterations of a loop, whatever block_dim says: so far apart slices lie."""


@functools.cache
def build(laws: LocalLaws, dtype: str, cuda: bool, parallel: bool) -> tuple[Launcher, Launcher]:
    """Forward and adjoint kernel for these laws, compiled at their first launch.

    Args:
        laws: local laws to compile in.
        dtype: ``"f32"`` or ``"f64"``.
        cuda: atomic sums, one particle per thread.
        parallel: on the CPU, one thread per slice; else one slice in the calling thread, which saves handing it over.
    """
    real = REAL[dtype]
    Reals = ti.types.ndarray(dtype=real, ndim=1)
    Nodes = ti.types.ndarray(dtype=ti.types.vector(4, real), ndim=1)
    Doubles = ti.types.ndarray(dtype=ti.f64, ndim=1)
    Ints = ti.types.ndarray(dtype=ti.i32, ndim=1)
    P, H = len(laws.names), laws.history
    apart = LEAST_SHARE if parallel else 1
    width = STATE + H

    @ti.func
    def evaluated(
        state: ti.template(),
        constants: ti.template(),
        coefficients: ti.template(),
        numbers: ti.template(),
        p,
        x,
        v,
        C,
        F,
        substep,
    ):
        """All local laws at one particle."""
        return Evaluation(
            laws,
            entries(trial(C, F, numbers[2])),
            entries(C),
            [x[0], x[1], x[2]],
            [constants[CONSTANTS * p + 2 + a] for a in ti.static(range(3))],
            [v[0], v[1], v[2]],
            numbers[8] + numbers[2] * substep,
            numbers[2],
            constants[CONSTANTS * p],
            numbers[3],
            constants[CONSTANTS * p + 1],
            coefficients,
            [state[width * p + STATE + h] for h in ti.static(range(H))],
        )

    @ti.func
    def begin_substep(
        state: ti.template(),
        ahead: ti.template(),
        momentum: ti.template(),
        constants: ti.template(),
        coefficients: ti.template(),
        numbers: ti.template(),
        dims: ti.template(),
        status: ti.template(),
        p,
        x,
        v,
        C,
        F,
        mine,
        substep,
    ):
        """Local laws and P2G of one particle; returns the first node of its stencil."""
        dx, inv_dx, dt, volume = numbers[0], numbers[1], numbers[2], numbers[3]
        mass = constants[CONSTANTS * p]
        e = evaluated(state, constants, coefficients, numbers, p, x, v, C, F, substep)
        store_matrix(ahead, width * p + 15, ti.Matrix(e.F_new))
        for h in ti.static(range(H)):
            ahead[width * p + STATE + h] = e.history[h]
        first, f, w, _dw = stencil(x, inv_dx)
        cell = inside(first, dims, status, substep)
        A = affine_momentum(ti.Matrix(e.tau), C, mass, dt, volume, inv_dx)
        q = with_fourth(mass * ti.Vector(e.velocity) - A @ (f * dx), mass)
        start = mine + (cell[0] * dims[2] + cell[1]) * dims[3] + cell[2]
        scatter(
            momentum,
            start,
            dims[3],
            dims[2] * dims[3],
            w,
            q,
            column(A, 0, dx),
            column(A, 1, dx),
            column(A, 2, dx),
            cuda,
        )
        return cell

    @ti.func
    def update_node(
        momentum: ti.template(),
        velocity: ti.template(),
        contact: ti.template(),
        coefficients: ti.template(),
        numbers: ti.template(),
        dims: ti.template(),
        spans: ti.template(),
        i,
        j,
        k,
        slices,
    ):
        o = (i * dims[2] + j) * dims[3] + k
        q = total(momentum, spans, i, o, dims[1] * dims[2] * dims[3], slices, cuda)
        u = ti.Vector.zero(float, 3)
        if q[3] > numbers[7]:
            u = ti.Vector([q[0], q[1], q[2]]) / q[3] + numbers[2] * vector(numbers, 4)
        if j + dims[5] <= 0:
            store(contact, 3 * ((i * (1 - dims[5]) + j) * dims[3] + k), u)
            g = GroundEvaluation(laws, [u[0], u[1], u[2]], coefficients)
            u = ti.Vector(g.velocity)
        velocity[o] = with_fourth(u, q[3])

    @ti.kernel
    def forward(
        before: Reals,
        now: Reals,
        ahead: Reals,
        velocity_in: Nodes,
        velocity_out: Nodes,
        contact: Reals,
        momentum: Nodes,
        constants: Reals,
        numbers: Reals,
        dims: Ints,
        spans: Ints,
        status: Ints,
        slices: int,
        chunk: int,
        substep: int,
        finish: int,
        begin: int,
        keep_all: int,
    ):
        if ti.static(cuda):
            ti.loop_config(block_dim=128)
        else:
            ti.loop_config(serialize=not parallel)
        for n in range(slices * apart):
            if n % apart == 0:
                t = n // apart
                dx, inv_dx, dt = numbers[0], numbers[1], numbers[2]
                row, plane = dims[3], dims[2] * dims[3]
                coefficients = [numbers[NUMBERS + c] for c in ti.static(range(P))]
                low, high = ti.Vector([NOT_YET, NOT_YET, NOT_YET]), ti.Vector([-3, -3, -3])
                mine = 0
                if ti.static(not cuda):
                    mine = t * plane * dims[1]
                for p in range(t * chunk, ti.min((t + 1) * chunk, dims[0])):
                    o = width * p
                    x = vector(before, o)
                    v, C = ti.Vector.zero(float, 3), ti.Matrix.zero(float, 3, 3)
                    if finish == 1:
                        first, f, w, _dw = stencil(x, inv_dx)
                        cell = inside(first, dims, status, substep - 1)
                        m, mi, mj, mk = gather(velocity_in, cell[0] * plane + cell[1] * row + cell[2], row, plane, w)
                        v = ti.Vector([m[0], m[1], m[2]])
                        for a in ti.static(range(3)):
                            C[a, 0] = 4.0 * inv_dx * (mi[a] - v[a] * f[0])
                            C[a, 1] = 4.0 * inv_dx * (mj[a] - v[a] * f[1])
                            C[a, 2] = 4.0 * inv_dx * (mk[a] - v[a] * f[2])
                        x += dt * v
                        check_velocity(v, dt, dx, status, substep - 1)
                        store(now, o, x)
                        if keep_all == 1:
                            store(now, o + 3, v)
                            store_matrix(now, o + 6, C)
                    else:
                        v, C = vector(now, o + 3), matrix(now, o + 6)
                    if begin == 1:
                        cell = begin_substep(
                            now,
                            ahead,
                            momentum,
                            constants,
                            coefficients,
                            numbers,
                            dims,
                            status,
                            p,
                            x,
                            v,
                            C,
                            matrix(now, o + 15),
                            mine,
                            substep,
                        )
                        low, high = ti.min(low, cell), ti.max(high, cell)
                if ti.static(not cuda):
                    for a in ti.static(range(3)):
                        spans[6 * t + a] = low[a]
                        spans[6 * t + 3 + a] = high[a]
        if ti.static(cuda):
            for n in range(begin * dims[1] * dims[2] * dims[3]):
                coefficients = [numbers[NUMBERS + c] for c in ti.static(range(P))]
                update_node(
                    momentum,
                    velocity_out,
                    contact,
                    coefficients,
                    numbers,
                    dims,
                    spans,
                    n // (dims[2] * dims[3]),
                    (n // dims[3]) % dims[2],
                    n % dims[3],
                    slices,
                )
        else:
            ti.loop_config(serialize=not parallel)
            for n in range(slices * apart):
                if n % apart == 0:
                    t = n // apart
                    coefficients = [numbers[NUMBERS + c] for c in ti.static(range(P))]
                    low, high = reach(spans, slices)
                    count = begin * (high[0] + 1 - low[0])
                    for i in range(low[0] + t * count // slices, low[0] + (t + 1) * count // slices):
                        for j in range(low[1], high[1] + 1):
                            for k in range(low[2], high[2] + 1):
                                update_node(
                                    momentum, velocity_out, contact, coefficients, numbers, dims, spans, i, j, k, slices
                                )

    @ti.func
    def end_substep_adjoint(
        now: ti.template(),
        p,
        gx,
        gv,
        gC,
        velocity: ti.template(),
        before: ti.template(),
        momentum: ti.template(),
        numbers: ti.template(),
        dims: ti.template(),
        status: ti.template(),
        mine,
        substep,
    ):
        """Adjoint of G2P and of the motion of one particle; returns the adjoint of its position before, and its first
        node.
        """
        inv_dx, dt = numbers[1], numbers[2]
        row, plane = dims[3], dims[2] * dims[3]
        first, f, w, dw = stencil(vector(before, width * p), inv_dx)
        cell = inside(first, dims, status, substep)
        start = cell[0] * plane + cell[1] * row + cell[2]
        a = gv + dt * gx
        B = (4.0 * inv_dx) * gC
        q, qi, qj, qk = with_fourth(a - B @ f, 0.0), column(B, 0, 1.0), column(B, 1, 1.0), column(B, 2, 1.0)
        scatter(momentum, mine + start, row, plane, w, q, qi, qj, qk, cuda)
        _m, _mi, _mj, _mk, slope = gather_adjoint(velocity, start, row, plane, w, dw, q, qi, qj, qk)
        return gx + inv_dx * (slope - B.transpose() @ vector(now, width * p + 3)), cell

    @ti.func
    def update_node_adjoint(
        momentum: ti.template(),
        velocity: ti.template(),
        contact: ti.template(),
        node: ti.template(),
        coefficients: ti.template(),
        numbers: ti.template(),
        dims: ti.template(),
        spans: ti.template(),
        i,
        j,
        k,
        slices,
    ):
        """Adjoint of the grid update at one node; returns the adjoints of the coefficients of the ground."""
        o = (i * dims[2] + j) * dims[3] + k
        q = total(momentum, spans, i, o, dims[1] * dims[2] * dims[3], slices, cuda)
        known = velocity[o]
        g, u, mass = ti.Vector([q[0], q[1], q[2]]), ti.Vector([known[0], known[1], known[2]]), known[3]
        of_coefficients = ti.Vector.zero(ti.f64, P)
        if j + dims[5] <= 0:
            u = vector(contact, 3 * ((i * (1 - dims[5]) + j) * dims[3] + k))
            back = GroundEvaluation(laws, [u[0], u[1], u[2]], coefficients).pull_back([g[0], g[1], g[2]])
            g = ti.Vector([back[0], back[1], back[2]])
            for c in ti.static(range(P)):
                of_coefficients[c] = back[3 + c]
        out = ti.Vector.zero(float, 4)
        if mass > numbers[7]:
            h = g / mass
            out = with_fourth(h, -h.dot(u - numbers[2] * vector(numbers, 4)))
        node[o] = out
        return of_coefficients

    @ti.kernel
    def adjoint(
        now: Reals,
        before: Reals,
        gradient: Reals,
        node: Nodes,
        velocity: Nodes,
        contact: Reals,
        momentum: Nodes,
        constants: Reals,
        of_constants: Reals,
        numbers: Reals,
        of_coefficients: Doubles,
        dims: Ints,
        spans: Ints,
        status: Ints,
        slices: int,
        chunk: int,
        substep: int,
        begun: int,
        finished: int,
    ):
        if ti.static(cuda):
            ti.loop_config(block_dim=128)
        else:
            ti.loop_config(serialize=not parallel)
        for n in range(slices * apart):
            if n % apart == 0:
                t = n // apart
                dx, inv_dx, dt, volume = numbers[0], numbers[1], numbers[2], numbers[3]
                row, plane = dims[3], dims[2] * dims[3]
                coefficients = [numbers[NUMBERS + c] for c in ti.static(range(P))]
                low, high = ti.Vector([NOT_YET, NOT_YET, NOT_YET]), ti.Vector([-3, -3, -3])
                mine = 0
                if ti.static(not cuda):
                    mine = t * plane * dims[1]
                of_mine = ti.Vector.zero(ti.f64, P)
                for p in range(t * chunk, ti.min((t + 1) * chunk, dims[0])):
                    o, oc = width * p, CONSTANTS * p
                    gx, gv = vector(gradient, o), vector(gradient, o + 3)
                    gC, gF = matrix(gradient, o + 6), matrix(gradient, o + 15)
                    if begun == 1:
                        x, v, C, F, mass = (
                            vector(now, o),
                            vector(now, o + 3),
                            matrix(now, o + 6),
                            matrix(now, o + 15),
                            constants[oc],
                        )
                        first, f, w, dw = stencil(x, inv_dx)
                        cell = inside(first, dims, status, substep)
                        e = evaluated(now, constants, coefficients, numbers, p, x, v, C, F, substep)
                        A, u = affine_momentum(ti.Matrix(e.tau), C, mass, dt, volume, inv_dx), ti.Vector(e.velocity)
                        m, mi, mj, mk, slope = gather_adjoint(
                            node,
                            cell[0] * plane + cell[1] * row + cell[2],
                            row,
                            plane,
                            w,
                            dw,
                            with_fourth(mass * u - A @ (f * dx), mass),
                            column(A, 0, dx),
                            column(A, 1, dx),
                            column(A, 2, dx),
                        )
                        h = ti.Vector([m[0], m[1], m[2]])
                        gA = ti.Matrix.zero(float, 3, 3)
                        for a in ti.static(range(3)):
                            gA[a, 0] = dx * (mi[a] - h[a] * f[0])
                            gA[a, 1] = dx * (mj[a] - h[a] * f[1])
                            gA[a, 2] = dx * (mk[a] - h[a] * f[2])
                        gtau, gu = (-4.0 * dt * volume * inv_dx * inv_dx) * gA, mass * h
                        gh = [gradient[o + STATE + h] for h in ti.static(range(H))]
                        back = e.pull_back(entries(gF), entries(gtau), [gu[0], gu[1], gu[2]], gh)
                        gF = ti.Matrix(back.F)
                        gC = mass * gA + dt * (gF @ F.transpose()) + ti.Matrix(back.C)
                        gF += dt * (C.transpose() @ gF)
                        gv = ti.Vector(back.v)
                        gx += inv_dx * slope - A.transpose() @ h + ti.Vector(back.x)
                        of_constants[oc] = of_constants[oc] + m[3] + h.dot(u) + (gA * C).sum() + back.mass
                        of_constants[oc + 1] = of_constants[oc + 1] + back.stiffness
                        for a in ti.static(range(3)):
                            of_constants[oc + 2 + a] = of_constants[oc + 2 + a] + back.X[a]
                        for h in ti.static(range(H)):
                            gradient[o + STATE + h] = back.history[h]
                        for c in ti.static(range(P)):
                            of_mine[c] += back.coefficients[c]
                    if finished == 1:
                        gx, cell = end_substep_adjoint(
                            now, p, gx, gv, gC, velocity, before, momentum, numbers, dims, status, mine, substep
                        )
                        low, high = ti.min(low, cell), ti.max(high, cell)
                    else:
                        store(gradient, o + 3, gv)
                        store_matrix(gradient, o + 6, gC)
                    store(gradient, o, gx)
                    store_matrix(gradient, o + 15, gF)
                if ti.static(cuda):
                    for c in ti.static(range(P)):
                        ti.atomic_add(of_coefficients[c], of_mine[c])
                else:
                    for c in ti.static(range(P)):
                        of_coefficients[P * t + c] = of_coefficients[P * t + c] + of_mine[c]
                    for a in ti.static(range(3)):
                        spans[6 * t + a] = low[a]
                        spans[6 * t + 3 + a] = high[a]
        if ti.static(cuda):
            for n in range(finished * dims[1] * dims[2] * dims[3]):
                coefficients = [numbers[NUMBERS + c] for c in ti.static(range(P))]
                of_node = update_node_adjoint(
                    momentum,
                    velocity,
                    contact,
                    node,
                    coefficients,
                    numbers,
                    dims,
                    spans,
                    n // (dims[2] * dims[3]),
                    (n // dims[3]) % dims[2],
                    n % dims[3],
                    slices,
                )
                for c in ti.static(range(P)):
                    if of_node[c] != 0.0:
                        ti.atomic_add(of_coefficients[c], of_node[c])
        else:
            ti.loop_config(serialize=not parallel)
            for n in range(slices * apart):
                if n % apart == 0:
                    t = n // apart
                    coefficients = [numbers[NUMBERS + c] for c in ti.static(range(P))]
                    of_mine = ti.Vector.zero(ti.f64, P)
                    low, high = reach(spans, slices)
                    count = finished * (high[0] + 1 - low[0])
                    for i in range(low[0] + t * count // slices, low[0] + (t + 1) * count // slices):
                        for j in range(low[1], high[1] + 1):
                            for k in range(low[2], high[2] + 1):
                                of_mine += update_node_adjoint(
                                    momentum,
                                    velocity,
                                    contact,
                                    node,
                                    coefficients,
                                    numbers,
                                    dims,
                                    spans,
                                    i,
                                    j,
                                    k,
                                    slices,
                                )
                    for c in ti.static(range(P)):
                        of_coefficients[P * t + c] = of_coefficients[P * t + c] + of_mine[c]

    return Launcher(forward, dtype), Launcher(adjoint, dtype)
