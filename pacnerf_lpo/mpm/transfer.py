"""What P2G and G2P have in common: quadratic B-splines on the 27 nodes around a particle, and sums over them.

A field on the nodes is an array of 4-vectors. What a particle gives to its nodes is linear in the node index, q + i qi
+ j qj + k qk, so sums factor by axis. How they are taken is another matter for a group of one particle
(:mod:`~pacnerf_lpo.mpm.transfer_single`) and for one that fills a register (:mod:`~pacnerf_lpo.mpm.transfer_rows`).
"""

from dataclasses import dataclass
from typing import Any

from pacnerf_lpo.mpm import transfer_rows, transfer_single
from pacnerf_lpo.mpm.arrays import Bench, Field, Group, Setting
from pacnerf_lpo.mpm.lanes import floor, keep, select
from pacnerf_lpo.mpm.taichi_calls import Emitted, ti
from pacnerf_lpo.mpm.tensors import AXES, Tensor3, flat


@dataclass(frozen=True)
class Stencil(Emitted):
    """The 27 nodes around each particle of a group.

    cell: index of the first of them along each axis, whole [(3,)]; outside: 1 where it was moved into the grid, else 0.
    offset: of the particle from it [cells, (3,)]; w, dw: weights, derivatives [per cell], by axis and node [(3, 3)].
    """

    cell: list[Any]
    outside: Any
    offset: list[Any]
    w: Tensor3
    dw: Tensor3


def stencil(x: list[Any], s: Setting) -> Stencil:
    """The nodes around positions ``x`` [m]."""
    d = s.dims
    firsts = d.first_x, d.first_y, d.first_z
    ends = d.size_x - 3, d.size_y - 3, d.size_z - 4  # along z four nodes are read
    cell, offset, w, dw, inside = [], [], [], [], []
    for axis, (end, first) in enumerate(zip(ends, firsts, strict=True)):
        scaled = keep(x[axis] * s.n.inv_dx)
        lowest = floor(scaled - 0.5)
        f = keep(scaled - lowest)
        wanted = keep(lowest - ti.cast(first, float))
        last = keep(ti.cast(end, float))
        risen = select(wanted >= 0.0, wanted, 0.0)  # which NaN is not
        cell.append(select(risen <= last, risen, last))
        inside.append(select(cell[axis] == wanted, 1.0, 0.0))
        offset.append(f)
        w.append(
            [keep(0.5 * (1.5 - f) * (1.5 - f)), keep(0.75 - (f - 1.0) * (f - 1.0)), keep(0.5 * (f - 0.5) * (f - 0.5))]
        )
        dw.append([keep(f - 1.5), keep(-2.0 * (f - 1.0)), keep(f - 0.5)])
    return Stencil(cell, keep(1.0 - inside[0] * inside[1] * inside[2]), offset, w, dw)


def linear(value: list[Any], slope: Tensor3, last: Any, here: Stencil) -> list[Any]:
    """``value + slope (i - offset)`` at node i of a stencil, in cells from the particle, and ``last`` as fourth number:
    the four at node 0, and the slope per node along each axis, which is zero for the fourth [(13,)].
    """
    q = [
        keep(value[a] - slope[a][0] * here.offset[0] - slope[a][1] * here.offset[1] - slope[a][2] * here.offset[2])
        for a in AXES
    ]
    return [*q, last, *flat(slope)]


def about(moments: list[Any], here: Stencil, scale: Any) -> Tensor3:
    """scale times the sum of w u (i - offset)ᵀ over the nodes i of a stencil."""
    return [[keep(scale * (moments[4 + 3 * a + b] - moments[a] * here.offset[b])) for b in AXES] for a in AXES]


def scatter(field: Field, here: Stencil, given: list[Any], s: Setting, group: Group) -> None:
    """Add w (q + slope · (i, j, k)) to every node of a stencil, given :func:`linear` numbers q and slope."""
    if group.lane is None:
        _place(here, given, group)
        transfer_rows.scatter(field, s, group)
    else:
        transfer_single.scatter(field, here, s, given)


def gather(field: Field, here: Stencil, s: Setting, group: Group, given: list[Any] | None = None) -> list[Any]:
    """The moments of a field u over a stencil, the sums of w u [(4,)] and of w u (i, j, k) [(3, 3)], number by number
    [(13,)]; and, given :func:`linear` numbers, the sum of (u · (q + slope · (i, j, k))) grad w [per cell, (3,)].
    """
    if group.lane is None:
        _place(here, given or [], group)
        transfer_rows.gather(field, s, group, True, given is not None)
        return group.on_bench(Bench.MOMENTS, 13 if given is None else 16)
    return transfer_single.gather(field, here, s, given or [0.0] * 13)


def scatter_and_slope(
    field: Field, other: Field, here: Stencil, given: list[Any], s: Setting, group: Group
) -> list[Any]:
    """:func:`scatter` to one field, and what :func:`gather` makes of the given numbers in another [per cell, (3,)]."""
    scatter(field, here, given, s, group)
    if group.lane is None:
        transfer_rows.gather(other, s, group, False, True)
        return group.on_bench(Bench.SLOPE, 3)
    return transfer_single.gather(other, here, s, given)[13:]


def _place(here: Stencil, given: list[Any], group: Group) -> None:
    group.put(Bench.W, [*flat(here.w), *flat(here.dw), *here.cell, *given])
