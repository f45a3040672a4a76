"""Layout of the engine's arrays, by name, and the small pieces of a kernel that read, write and check them."""

from dataclasses import dataclass, fields
from typing import Any

from pacnerf_lpo.mpm.point import LocalLaws
from pacnerf_lpo.mpm.taichi_calls import Emitted, entry, ti

STATE = 24
"""Per particle: position 3, velocity 3, velocity gradient C 9, deformation gradient F 9; the history follows."""
V, C, F = 3, 6, 15
"""Where velocity and the two gradients begin in the state of a particle; the position is first."""
CONSTANTS = 5
"""Per particle: mass [kg], stiffness factor, position at time 0 [m]."""
NOT_YET = 1 << 30
CAUSES = ("NaN in the velocity of a particle", "|v| dt > dx", "a particle left the grid")


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
    """The array ``dims``: how many particles there are, and nodes of the grid along each axis from its first node on.

    The grid is a window of the infinite one whose node (0, 0, 0) lies at the world's origin.
    """

    particles: Any
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
        """Number of nodes."""
        return self.size_x * self.size_y * self.size_z


@dataclass(frozen=True)
class Launch(Emitted):
    """What the passes of a launch have in common, whichever arrays they work on.

    slices: of the particles, ``chunk`` in each; on CUDA there is one of each particle.
    spans: per slice the first and the last node that begins a stencil; status: per cause the first substep it befell.
    """

    numbers: Any
    dims: Any
    spans: Any
    status: Any
    slices: Any
    chunk: Any
    substep: Any


@dataclass(frozen=True)
class Setting(Emitted):
    """What a thread knows of the launch: its numbers by name, the local laws and their coefficients."""

    n: Numbers
    dims: Dims
    laws: LocalLaws
    coefficients: list[Any]
    call: Launch
    cuda: bool

    @classmethod
    def of(cls, call: Launch, laws: LocalLaws, cuda: bool) -> "Setting":
        """Read it from the arrays of a launch."""
        first = len(fields(Numbers))
        coefficients = [entry(call.numbers, first + c) for c in range(len(laws.names))]
        return cls(Numbers.read(call.numbers), Dims.read(call.dims), laws, coefficients, call, cuda)

    @property
    def width(self) -> int:
        """Numbers of a particle's state."""
        return STATE + self.laws.history


@ti.func
def vector(a: ti.template(), o):
    return ti.Vector([a[o], a[o + 1], a[o + 2]])


@ti.func
def matrix(a: ti.template(), o):
    return ti.Matrix([[a[o], a[o + 1], a[o + 2]], [a[o + 3], a[o + 4], a[o + 5]], [a[o + 6], a[o + 7], a[o + 8]]])


@ti.func
def store(a: ti.template(), o, value: ti.template()):
    for i in ti.static(range(3)):
        a[o + i] = value[i]


@ti.func
def store_matrix(a: ti.template(), o, value: ti.template()):
    for i, j in ti.static(ti.ndrange(3, 3)):
        a[o + 3 * i + j] = value[i, j]


@ti.func
def flag(s: ti.template(), cause, substep):
    ti.atomic_min(s.call.status[cause], substep)


@ti.func
def check_velocity(v, s: ti.template(), substep):
    step = v.norm_sqr() * s.n.dt * s.n.dt
    if not step <= s.n.dx * s.n.dx:
        if step > s.n.dx * s.n.dx:
            flag(s, 1, substep)
        else:
            flag(s, 0, substep)


@ti.func
def inside(first, s: ti.template(), substep):
    """Index of the first node of a stencil in this grid, moved into it (and reported) when outside."""
    size, lowest = (s.dims.size_x, s.dims.size_y, s.dims.size_z), (s.dims.first_x, s.dims.first_y, s.dims.first_z)
    cell = ti.Vector([0, 0, 0])
    for a in ti.static(range(3)):
        wanted = first[a] - lowest[a]
        cell[a] = ti.max(0, ti.min(wanted, size[a] - 3))
        if cell[a] != wanted:
            flag(s, 2, substep)
    return cell


@ti.func
def store_span(spans: ti.template(), t, low, high):
    store(spans, 6 * t, low)
    store(spans, 6 * t + 3, high)


@ti.func
def reach(call: ti.template()):
    """First and last node within reach of any particle, over all slices."""
    low, high = ti.Vector([NOT_YET, NOT_YET, NOT_YET]), ti.Vector([-1, -1, -1])
    for r in range(call.slices):
        for a in ti.static(range(3)):
            low[a] = ti.min(low[a], call.spans[6 * r + a])
            high[a] = ti.max(high[a], call.spans[6 * r + 3 + a] + 2)
    return low, high


@ti.func
def total(field: ti.template(), s: ti.template(), i, o):
    """Sum over the slices of the four numbers of node ``o``, in plane ``i``, cleared for the next substep."""
    zero = ti.Vector.zero(float, 4)
    q = zero
    if ti.static(s.cuda):
        q = field[o]
        field[o] = zero
    else:
        for r in range(s.call.slices):
            if s.call.spans[6 * r] <= i <= s.call.spans[6 * r + 3] + 2:
                q += field[r * s.dims.nodes + o]
                field[r * s.dims.nodes + o] = zero
    return q
