"""The sums of a group of one particle, as a thread of a GPU takes them: node by node, added atomically."""

from typing import Any

from pacnerf_lpo.mpm.lanes import entry, keep
from pacnerf_lpo.mpm.taichi_calls import ti


@ti.func
def _start(here: ti.template(), s: ti.template()):
    """Place in memory of the first node of a stencil."""
    return s.dims.place(int(here.cell[0]), int(here.cell[1]), int(here.cell[2]))


@ti.func
def _given(numbers: ti.template()):
    """q, and its slope along each axis, as 4-vectors."""
    q = ti.Vector([numbers[0], numbers[1], numbers[2], numbers[3]])
    qi = ti.Vector([numbers[4], numbers[7], numbers[10], 0.0])
    qj = ti.Vector([numbers[5], numbers[8], numbers[11], 0.0])
    qk = ti.Vector([numbers[6], numbers[9], numbers[12], 0.0])
    return q, qi, qj, qk


@ti.func
def scatter(field: ti.template(), here: ti.template(), s: ti.template(), numbers: ti.template()):
    """Add w (q + i qi + j qj + k qk) to every node of a stencil. The first numbers of all nodes lie side by side, then
    the second, and so on: neighbouring threads add to neighbouring addresses.
    """
    q, qi, qj, qk = _given(numbers)
    start, wx, wy = field.first + _start(here, s), ti.Vector(here.w[0]), ti.Vector(here.w[1])
    for i in range(3):
        for j in range(3):
            w = wx[i] * wy[j]
            base = w * (q + float(i) * qi + float(j) * qj)
            for k in ti.static(range(3)):
                value = here.w[2][k] * (base + (float(k) * w) * qk)
                for c in ti.static(range(4)):
                    place = c * s.dims.nodes + start + s.dims.place(i, j, k)
                    ti.atomic_add(field.array[place // 4][place % 4], value[c])


def gather(field: Any, here: Any, s: Any, numbers: list[Any]) -> list[Any]:
    """The moments of a field u, and the sum of (u · given) grad w [(16,)]."""
    m, mi, mj, mk, slope = _sums(field, here, s, numbers)
    moments = [entry(m, c) for c in range(4)]
    moments += [entry(along, c) for c in range(3) for along in (mi, mj, mk)]
    return [*moments, *(keep(entry(slope, c)) for c in range(3))]


@ti.func
def _sums(field: ti.template(), here: ti.template(), s: ti.template(), numbers: ti.template()):
    """Sums over the nodes of w u, w u i, w u j, w u k, and of (u · given) grad w."""
    q, qi, qj, qk = _given(numbers)
    start = field.first + _start(here, s)
    wx, wy, dwx, dwy = ti.Vector(here.w[0]), ti.Vector(here.w[1]), ti.Vector(here.dw[0]), ti.Vector(here.dw[1])
    zero = ti.Vector.zero(float, 4)
    m, mi, mj, mk, slope = zero, zero, zero, zero, ti.Vector.zero(float, 3)
    for i in range(3):
        for j in range(3):
            base, w = q + float(i) * qi + float(j) * qj, wx[i] * wy[j]
            for k in ti.static(range(3)):
                u = field.array[start + s.dims.place(i, j, k)]
                wu = (w * here.w[2][k]) * u
                m += wu
                mi += float(i) * wu
                mj += float(j) * wu
                mk += float(k) * wu
                value = u.dot(base + float(k) * qk)
                slope += value * ti.Vector(
                    [dwx[i] * wy[j] * here.w[2][k], wx[i] * dwy[j] * here.w[2][k], w * here.dw[2][k]]
                )
    return m, mi, mj, mk, slope
