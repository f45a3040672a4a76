"""The sums of a group that fills a register, particle by particle, from and to the group's bench.

The nodes of a stencil along z lie side by side in memory. With a fourth, of weight 0, they are a row of 16 numbers,
which one instruction handles; a stencil is nine rows. The fourth node has to exist and to be finite.
"""

from pacnerf_lpo.mpm.arrays import Bench
from pacnerf_lpo.mpm.lanes import LANES
from pacnerf_lpo.mpm.taichi_calls import ti

ROW = 16
"""Numbers of a row: four at each of four nodes."""


@ti.func
def on(group: ti.template(), row: ti.template(), lane):
    """A number of one particle on the bench."""
    return group.bench[group.base + row][lane]


@ti.func
def first_node(s: ti.template(), group: ti.template(), lane):
    """Place in memory of the first node of the stencil of one particle."""
    cell = ti.static(Bench.CELL)
    return s.dims.place(int(on(group, cell, lane)), int(on(group, cell + 1, lane)), int(on(group, cell + 2, lane)))


@ti.func
def row_at(field: ti.template(), o):
    """The row that begins with node ``o``, read across the ends of its vectors."""
    row = ti.Vector.zero(float, ROW)
    for t in range(ROW):
        row[t] = field[o][t]
    return row


@ti.func
def add_row(field: ti.template(), o, row):
    """Add to the row that begins with node ``o``."""
    new = row_at(field, o) + row
    for t in range(ROW):
        field[o][t] = new[t]


@ti.func
def of_nodes(a, b, c):
    """A row with the same number four times at each of the three nodes of a stencil, and 0 at the fourth."""
    return ti.Vector([a, a, a, a, b, b, b, b, c, c, c, c, 0.0, 0.0, 0.0, 0.0])


@ti.func
def repeated(group: ti.template(), lane, a: ti.template(), b: ti.template(), c: ti.template(), d: ti.template()):
    """A row with four numbers of one particle at every node, from these rows of the bench."""
    p, q, r, s = on(group, a, lane), on(group, b, lane), on(group, c, lane), on(group, d, lane)
    return ti.Vector([p, q, r, s, p, q, r, s, p, q, r, s, p, q, r, s])


@ti.func
def added_up(row, c: ti.template()):
    """Sum over the nodes of a row of its number ``c``."""
    return (row[c] + row[4 + c]) + (row[8 + c] + row[12 + c])


@ti.func
def total_of(row):
    """Sum over a row."""
    return (added_up(row, 0) + added_up(row, 1)) + (added_up(row, 2) + added_up(row, 3))


@ti.func
def given_at(group: ti.template(), lane):
    """What a particle gives to the rows of its stencil, without weights: to the first, and changes along x and y."""
    b, zero = ti.static(Bench.GIVEN, Bench.ZERO)
    q = repeated(group, lane, b, b + 1, b + 2, b + 3)
    qk = repeated(group, lane, b + 6, b + 9, b + 12, zero)
    qi, qj = repeated(group, lane, b + 4, b + 7, b + 10, zero), repeated(group, lane, b + 5, b + 8, b + 11, zero)
    return q + of_nodes(0.0, 1.0, 2.0) * qk, qi, qj


@ti.func
def scatter(field: ti.template(), s: ti.template(), group: ti.template()):
    """Add what each particle gives, times the weights, to its nodes."""
    for lane in range(LANES):
        o = field.first + first_node(s, group, lane)
        wz = of_nodes(on(group, Bench.W + 6, lane), on(group, Bench.W + 7, lane), on(group, Bench.W + 8, lane))
        q, qi, qj = given_at(group, lane)
        q, qi, qj = wz * q, wz * qi, wz * qj
        for i in range(3):
            w, given = on(group, Bench.W + i, lane), q
            for j in ti.static(range(3)):
                add_row(field.array, o + j * s.dims.row, (w * on(group, Bench.W + 3 + j, lane)) * given)
                given += qj
            q += qi
            o += s.dims.plane


@ti.func
def along_y(field: ti.template(), o, s: ti.template(), group: ti.template(), lane):
    """Sums over the rows of a plane of a stencil: of w u and of w u j."""
    wu = on(group, Bench.W + 4, lane) * row_at(field, o + s.dims.row)
    wu2 = on(group, Bench.W + 5, lane) * row_at(field, o + 2 * s.dims.row)
    t = wu + wu2
    return on(group, Bench.W + 3, lane) * row_at(field, o) + t, t + wu2


@ti.func
def store_moments(group: ti.template(), lane, m, mi, mj):
    """Sum rows of moments over their nodes, onto the bench."""
    w1, w2 = on(group, Bench.W + 7, lane), on(group, Bench.W + 8, lane)
    wz = of_nodes(on(group, Bench.W + 6, lane), w1, w2)
    mk = of_nodes(0.0, w1, 2.0 * w2) * m
    m, mi, mj = wz * m, wz * mi, wz * mj
    for c in ti.static(range(4)):
        group.bench[group.base + Bench.MOMENTS + c][lane] = added_up(m, c)
    for c in ti.static(range(3)):
        o = group.base + Bench.MOMENTS + 4 + 3 * c
        group.bench[o][lane] = added_up(mi, c)
        group.bench[o + 1][lane] = added_up(mj, c)
        group.bench[o + 2][lane] = added_up(mk, c)


@ti.func
def gather(field: ti.template(), s: ti.template(), group: ti.template(), moments: ti.template(), slope: ti.template()):
    """The moments of a field u over each particle's stencil, the sum of (u · what it gives) grad w, or both."""
    for lane in range(LANES):
        o = field.first + first_node(s, group, lane)
        zero = ti.Vector.zero(float, ROW)
        m, mi, mj = zero, zero, zero
        gx, gy, gz = zero, zero, zero
        q, qi, qj = zero, zero, zero
        if ti.static(slope):
            q, qi, qj = given_at(group, lane)
        w0, w1, w2 = on(group, Bench.W + 3, lane), on(group, Bench.W + 4, lane), on(group, Bench.W + 5, lane)
        dw0, dw1, dw2 = on(group, Bench.DW + 3, lane), on(group, Bench.DW + 4, lane), on(group, Bench.DW + 5, lane)
        for i in range(3):
            w = on(group, Bench.W + i, lane)
            if ti.static(slope):
                q1 = q + qj
                u0 = row_at(field.array, o) * q
                u1 = row_at(field.array, o + s.dims.row) * q1
                u2 = row_at(field.array, o + 2 * s.dims.row) * (q1 + qj)
                value = w0 * u0 + w1 * u1 + w2 * u2
                gx += on(group, Bench.DW + i, lane) * value
                gy += w * (dw0 * u0 + dw1 * u1 + dw2 * u2)
                gz += w * value
                q += qi
            if ti.static(moments):
                t, tj = along_y(field.array, o, s, group, lane)
                m += w * t
                mi += (float(i) * w) * t
                mj += w * tj
            o += s.dims.plane
        if ti.static(moments):
            store_moments(group, lane, m, mi, mj)
        if ti.static(slope):
            wz = of_nodes(on(group, Bench.W + 6, lane), on(group, Bench.W + 7, lane), on(group, Bench.W + 8, lane))
            dwz = of_nodes(on(group, Bench.DW + 6, lane), on(group, Bench.DW + 7, lane), on(group, Bench.DW + 8, lane))
            group.bench[group.base + Bench.SLOPE][lane] = total_of(wz * gx)
            group.bench[group.base + Bench.SLOPE + 1][lane] = total_of(wz * gy)
            group.bench[group.base + Bench.SLOPE + 2][lane] = total_of(dwz * gz)
