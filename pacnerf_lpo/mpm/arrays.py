"""Layout of the engine's arrays, by name, and the small pieces of a kernel that read, write and check them.

Particles lie in blocks of :data:`~pacnerf_lpo.mpm.lanes.LANES`, the same number of all of them side by side: a row.
So a register is filled by one load on the CPU, and threads of a GPU read neighbouring addresses.
"""

from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.mpm.lanes import LANES, entry, keep, largest, new_scope, select, smallest, wide
from pacnerf_lpo.mpm.point import LocalLaws
from pacnerf_lpo.mpm.taichi_calls import Emitted, assign, ti
from pacnerf_lpo.mpm.tensors import AXES, Tensor3

STATE = 24
"""Rows of a block: position 3, velocity 3, velocity gradient C 9, deformation gradient F 9; the history follows."""
V, C, F = 3, 6, 15
"""Where velocity and the two gradients begin in the state of a particle; the position is first."""
MASS, STIFFNESS, X0, ALIVE, CONSTANTS = 0, 1, 2, 5, 6
"""Rows of a block of constants: mass [kg], stiffness factor, position at time 0 [m], and 1; 0 for the copies of the
last particle that fill the last block. These move with it, and neither weigh nor push."""
NOT_YET = 1 << 30
CAUSES = ("NaN in the velocity of a particle", "|v| dt > dx", "a particle left the grid")


def packed(rows: Tensor, fill: Tensor) -> Tensor:
    """Numbers of particles [(N, K)] in blocks [(B, K, LANES)]; ``fill`` is what fills the last block [(K,)]."""
    filled = torch.cat([rows, fill.expand(-len(rows) % LANES, -1)])
    return filled.view(-1, LANES, rows.shape[1]).transpose(1, 2).contiguous()


def unpacked(blocks: Tensor, count: int) -> Tensor:
    """Numbers of so many particles [(N, K)], from blocks [(B, K, LANES)]."""
    return blocks.transpose(1, 2).reshape(-1, blocks.shape[1])[:count]


@dataclass(frozen=True)
class Numbers(Emitted):
    """The array ``numbers``: what the substeps of a frame have in common [SI]; the coefficients of the laws follow.

    dx, inv_dx: node spacing and its inverse.  dt: substep.  volume: of an undeformed particle.
    lightest: a node of less mass than this stays at rest.  start: time at the beginning of the frame.
    """

    dx: Any
    inv_dx: Any
    dt: Any
    volume: Any
    gravity_x: Any
    gravity_y: Any
    gravity_z: Any
    lightest: Any
    start: Any


START = [field.name for field in fields(Numbers)].index("start")


@dataclass(frozen=True)
class Dims(Emitted):
    """The array ``dims``: how many blocks of particles there are, and nodes of the grid along each axis from its first
    node on.

    The grid is a window of the infinite one whose node (0, 0, 0) lies at the world's origin.
    """

    blocks: Any
    size_x: Any
    size_y: Any
    size_z: Any
    first_x: Any
    first_y: Any
    first_z: Any

    @property
    def row(self) -> Any:
        """Nodes from one to the next along y."""
        return self.size_z

    @property
    def plane(self) -> Any:
        """Nodes from one to the next along x."""
        return self.size_y * self.size_z

    @property
    def nodes(self) -> Any:
        return self.size_x * self.size_y * self.size_z

    def place(self, i: Any, j: Any, k: Any) -> Any:
        """Where a node lies in memory."""
        return i * self.plane + j * self.row + k


@dataclass(frozen=True)
class Launch(Emitted):
    """Arguments of the kernel.

    states: of the particles.  velocity: of the nodes, with their mass.  contact: velocity of nodes before the ground.
    momentum: of the nodes, summed per slice.  constants: of the particles.
    gradient: adjoint of the state.  node: adjoints of the nodes' momentum and mass.
    of_constants, of_coefficients: adjoints, summed up.
    numbers, dims: see there.  spans: per slice the first and the last node that begins a stencil.
    status: per cause the first substep it befell.  bench: rows of LANES numbers per slice, see :class:`Bench`.
    progress: see the schedule of the CPU; 0 at first.  slices: of the blocks, ``chunk`` in each.
    substeps: of the frame.  first, last: the passes of this launch, the last excluded.
    state, nodes, contacts: from the array of one substep to that of the next; 0 where only one is kept.
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
    numbers: Any
    dims: Any
    spans: Any
    status: Any
    bench: Any
    progress: Any
    slices: Any
    chunk: Any
    substeps: Any
    first: Any
    last: Any
    state: Any
    nodes: Any
    contacts: Any


@dataclass(frozen=True)
class Setting(Emitted):
    """What a thread knows of a substep: its numbers by name, the local laws and their coefficients."""

    n: Numbers
    dims: Dims
    laws: LocalLaws
    coefficients: list[Any]
    call: Launch
    substep: Any

    @classmethod
    def of(cls, call: Launch, laws: LocalLaws, substep: Any) -> "Setting":
        """Read it from the arrays of a launch."""
        first = len(fields(Numbers))
        coefficients = [entry(call.numbers, first + c) for c in range(len(laws.names))]
        return cls(Numbers.read(call.numbers), Dims.read(call.dims), laws, coefficients, call, substep)

    @property
    def width(self) -> int:
        """Rows of a block of states."""
        return STATE + self.laws.history

    def rows(self, group: "Group", substep: Any) -> Any:
        """Where the states of a group before a substep begin."""
        return keep(self.call.state * substep + group.block * self.width)


class Bench:
    """Rows of a slice's bench, where numbers of a group lie between what is computed lane by lane and for all lanes.

    W, DW: weights of a stencil and their derivatives, by axis and node.  CELL: its first node.
    GIVEN: what is given to the nodes, q 4 and slope 9.  MOMENTS, SLOPE: what is gathered, 4 and 9, and 3.
    SPEED, OUTSIDE: the worst of a pass, 0 where nothing is wrong.  LOW, HIGH: first and last of all CELLs of a pass.
    ZERO: nothing else.
    """

    W, DW, CELL, GIVEN = 0, 9, 18, 21
    MOMENTS, SLOPE, SPEED, OUTSIDE = 34, 47, 50, 51
    LOW, HIGH, ZERO, ROWS = 52, 55, 58, 59


@dataclass(frozen=True)
class Field(Emitted):
    """Four numbers at every node, from node ``first`` of an array on."""

    array: Any
    first: Any


@dataclass(frozen=True)
class Group(Emitted):
    """Particles that are computed together: a block on the CPU, one particle on CUDA.

    block: its index.  lane: of the one particle; None: all lanes.  bench: array, ``base``: first row of the thread.
    """

    block: Any
    lane: Any
    bench: Any = None
    base: Any = None

    def numbers(self, rows: Any, first: Any, count: int) -> list[Any]:
        """So many numbers of each particle, from row ``first`` on."""
        where = [] if self.lane is None else [self.lane]
        return [entry(rows, first + c, *where) for c in range(count)]

    def tensor(self, rows: Any, first: Any) -> Tensor3:
        """A 3x3 tensor of each particle."""
        numbers = self.numbers(rows, first, 9)
        return [numbers[0:3], numbers[3:6], numbers[6:9]]

    def write(self, rows: Any, first: Any, numbers: list[Any]) -> None:
        """Store some numbers of each particle, from row ``first`` on."""
        for c, number in enumerate(numbers):
            if self.lane is None:
                assign(rows, wide(number), first + c)
            else:
                assign(rows, number, first + c, self.lane)

    def on_bench(self, row: int, count: int) -> list[Any]:
        return self.numbers(self.bench, self.base + row, count)

    def put(self, row: int, numbers: list[Any]) -> None:
        self.write(self.bench, self.base + row, numbers)

    def note(self, row: int, number: Any, most: bool = True) -> None:
        """Keep the largest, or the smallest, that a pass has seen in each lane."""
        (known,) = self.on_bench(row, 1)
        self.put(row, [largest(known, number) if most else smallest(known, number)])


def check_velocity(v: list[Any], s: Setting, group: Group) -> None:
    """Report a particle that was faster than a cell per substep in the one before, or whose velocity is NaN."""
    step = keep((v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) * s.n.dt * s.n.dt)
    limit = keep(s.n.dx * s.n.dx)
    fast = select(step > limit, 1.0, 0.0)
    wrong = select(step <= limit, 0.0, 2.0 - fast)
    if group.lane is None:
        group.note(Bench.SPEED, wrong)
    else:
        report(s, wrong, 0.0)


def check_stencil(cell: list[Any], outside: Any, s: Setting, group: Group) -> None:
    """Report a particle whose stencil was moved into the grid; keep the span of the others."""
    if group.lane is None:
        group.note(Bench.OUTSIDE, outside)
        for axis in AXES:
            group.note(Bench.LOW + axis, cell[axis], most=False)
            group.note(Bench.HIGH + axis, cell[axis])
    else:
        report(s, 0.0, outside)


@ti.func
def report(s: ti.template(), speed, outside):
    """Keep the first substep with a cause of failure, as ``check_velocity`` and ``check_stencil`` number them."""
    if speed == 2.0:
        ti.atomic_min(s.call.status[0], s.substep - 1)
    if speed == 1.0:
        ti.atomic_min(s.call.status[1], s.substep - 1)
    if outside > 0.0:
        ti.atomic_min(s.call.status[2], s.substep)


def begin_pass(group: Group) -> None:
    """Clear what a pass keeps on the bench."""
    new_scope()
    group.put(Bench.SPEED, [0.0, 0.0, *[float(NOT_YET)] * 3, *[-3.0] * 3])


@ti.func
def end_pass(group: ti.template(), s: ti.template(), t):
    """Report what a pass has kept on the bench, and store the span of slice ``t``."""
    for lane in range(LANES):
        report(s, group.bench[group.base + Bench.SPEED][lane], group.bench[group.base + Bench.OUTSIDE][lane])
    for axis in ti.static(range(3)):
        low, high = NOT_YET, -3
        for lane in range(LANES):
            low = ti.min(low, int(group.bench[group.base + Bench.LOW + axis][lane]))
            high = ti.max(high, int(group.bench[group.base + Bench.HIGH + axis][lane]))
        s.call.spans[6 * t + axis] = low
        s.call.spans[6 * t + 3 + axis] = high


@ti.func
def reach(call: ti.template()):
    """First and last node within reach of any particle, over all slices; one more along z, where rows end."""
    low, high = ti.Vector([NOT_YET, NOT_YET, NOT_YET]), ti.Vector([-1, -1, -1])
    for r in range(call.slices):
        for a in ti.static(range(3)):
            low[a] = ti.min(low[a], call.spans[6 * r + a])
            high[a] = ti.max(high[a], call.spans[6 * r + 3 + a] + 2)
    high[2] += 1
    return low, high


@ti.func
def total(field: ti.template(), s: ti.template(), i, o, atomic: ti.template()):
    """Sum over the slices of the four numbers of node ``o``, in plane ``i``, cleared for the next substep; where sums
    are atomic, they lie as :mod:`~pacnerf_lpo.mpm.transfer_single` puts them.
    """
    zero = ti.Vector.zero(float, 4)
    q = zero
    if ti.static(atomic):
        for c in ti.static(range(4)):
            place = c * s.dims.nodes + o
            q[c] = field[place // 4][place % 4]
            field[place // 4][place % 4] = 0.0
    else:
        for r in range(s.call.slices):
            if s.call.spans[6 * r] <= i <= s.call.spans[6 * r + 3] + 2:
                q += field[r * s.dims.nodes + o]
                field[r * s.dims.nodes + o] = zero
    return q
