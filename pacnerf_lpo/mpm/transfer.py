"""Particle-grid transfers with quadratic B-splines, and the contractions their adjoints need.

A field on the nodes is an array of 4-vectors (one SIMD register). Over the 27 nodes of a stencil a particle carries
values linear in the node index, q + i q_i + j q_j + k q_k, so sums factor by axis: 2 to 3 times fewer operations than
node by node. MLS-MPM: Hu et al., "A moving least squares material point method", SIGGRAPH 2018.
"""

from pacnerf_lpo.mpm.runtime import ti


@ti.func
def stencil(x, inv_dx):
    """First node, offset from it in cells, weights and weight derivatives [per cell] by node (row) and axis
    (column).
    """
    first = ti.floor(x * inv_dx - 0.5)
    f = x * inv_dx - first
    w = ti.Matrix.rows([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])
    dw = ti.Matrix.rows([f - 1.5, -2.0 * (f - 1.0), f - 0.5])
    return ti.Vector([int(first[0]), int(first[1]), int(first[2])]), f, w, dw


@ti.func
def with_fourth(a, last):
    return ti.Vector([a[0], a[1], a[2], last])


@ti.func
def column(a, j, scale):
    """Column j of a 3x3 matrix times scale, as the first three of four numbers."""
    return ti.Vector([a[0, j] * scale, a[1, j] * scale, a[2, j] * scale, 0.0])


@ti.func
def add(field: ti.template(), node, value, atomic: ti.template()):
    """field[node] += value; without atomics where each thread has its own field (``+=`` on an array is atomic)."""
    if ti.static(atomic):
        for c in ti.static(range(4)):
            ti.atomic_add(field[node][c], value[c])
    else:
        field[node] = field[node] + value


@ti.func
def scatter(field: ti.template(), start, row, plane, w, q, qi, qj, qk, atomic: ti.template()):
    """field += w (q + i qi + j qj + k qk) on the 27 nodes from node ``start``."""
    for i in range(3):
        for j in range(3):
            wij = w[i, 0] * w[j, 1]
            base = wij * (q + float(i) * qi + float(j) * qj)
            step = wij * qk
            for k in ti.static(range(3)):
                add(field, start + i * plane + j * row + k, w[k, 2] * (base + float(k) * step), atomic)


@ti.func
def gather(field: ti.template(), start, row, plane, w):
    """Sums over the 27 nodes of w u, w u i, w u j, w u k."""
    m, mi, mj, mk = (
        ti.Vector.zero(float, 4),
        ti.Vector.zero(float, 4),
        ti.Vector.zero(float, 4),
        ti.Vector.zero(float, 4),
    )
    for i in range(3):
        t, tj, tk = ti.Vector.zero(float, 4), ti.Vector.zero(float, 4), ti.Vector.zero(float, 4)
        for j in range(3):
            o = start + i * plane + j * row
            u1 = w[1, 2] * field[o + 1]
            u2 = w[2, 2] * field[o + 2]
            s = w[0, 2] * field[o] + u1 + u2
            t += w[j, 1] * s
            tj += (w[j, 1] * j) * s
            tk += w[j, 1] * (u1 + 2.0 * u2)
        m += w[i, 0] * t
        mi += (w[i, 0] * i) * t
        mj += w[i, 0] * tj
        mk += w[i, 0] * tk
    return m, mi, mj, mk


@ti.func
def gather_adjoint(field: ti.template(), start, row, plane, w, dw, q, qi, qj, qk):
    """The moments of :func:`gather`, and the sum of (u · (q + i qi + j qj + k qk)) grad w [per cell]."""
    m, mi, mj, mk = (
        ti.Vector.zero(float, 4),
        ti.Vector.zero(float, 4),
        ti.Vector.zero(float, 4),
        ti.Vector.zero(float, 4),
    )
    gx, gy, gz = ti.Vector.zero(float, 4), ti.Vector.zero(float, 4), ti.Vector.zero(float, 4)
    for i in range(3):
        t, tj, tk = ti.Vector.zero(float, 4), ti.Vector.zero(float, 4), ti.Vector.zero(float, 4)
        ax, ay, az = ti.Vector.zero(float, 4), ti.Vector.zero(float, 4), ti.Vector.zero(float, 4)
        for j in range(3):
            o = start + i * plane + j * row
            u0, u1, u2 = field[o], field[o + 1], field[o + 2]
            w1, w2 = w[1, 2] * u1, w[2, 2] * u2
            s, sk = w[0, 2] * u0 + w1 + w2, w1 + 2.0 * w2
            d1, d2 = dw[1, 2] * u1, dw[2, 2] * u2
            payload = q + float(i) * qi + float(j) * qj
            value = s * payload + sk * qk
            ax += w[j, 1] * value
            ay += dw[j, 1] * value
            az += w[j, 1] * ((dw[0, 2] * u0 + d1 + d2) * payload + (d1 + 2.0 * d2) * qk)
            t += w[j, 1] * s
            tj += (w[j, 1] * j) * s
            tk += w[j, 1] * sk
        gx += dw[i, 0] * ax
        gy += w[i, 0] * ay
        gz += w[i, 0] * az
        m += w[i, 0] * t
        mi += (w[i, 0] * i) * t
        mj += w[i, 0] * tj
        mk += w[i, 0] * tk
    return m, mi, mj, mk, ti.Vector([gx.sum(), gy.sum(), gz.sum()])
