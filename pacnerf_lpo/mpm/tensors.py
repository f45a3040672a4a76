"""3x3 tensors inside a law: nested lists of numbers (floats, or :class:`~pacnerf_lpo.mpm.differentiation.Scalar`)."""

from collections.abc import Callable, Sequence
from typing import Any

Tensor3 = list[list[Any]]
AXES = range(3)


def diagonal(x: Any, y: Any, z: Any) -> Tensor3:
    """The tensor with these on its diagonal."""
    return [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]]


def flat(tensor: Tensor3) -> list[Any]:
    """The nine numbers of a tensor."""
    return [x for row in tensor for x in row]


def dot(a: Sequence, b: Sequence) -> Any:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def product(a: Tensor3, b: Tensor3) -> Tensor3:
    """a b."""
    return [[a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j] for j in AXES] for i in AXES]


def transposed(a: Tensor3) -> Tensor3:
    """aᵀ."""
    return [[a[j][i] for j in AXES] for i in AXES]


def mirrored(entry: Callable[[int, int], Any]) -> Tensor3:
    """The symmetric tensor with these entries on and above the diagonal, each computed once."""
    upper = {(i, j): entry(i, j) for i in AXES for j in range(i, 3)}
    return [[upper[min(i, j), max(i, j)] for j in AXES] for i in AXES]


def left_cauchy_green(F: Tensor3) -> Tensor3:
    """b = F Fᵀ."""
    return mirrored(lambda i, j: dot(F[i], F[j]))


def determinant(a: Tensor3) -> Any:
    """det a."""
    return dot(a[0], [minor(a, 0, j) for j in AXES])


def symmetric(a: Tensor3) -> Tensor3:
    """(a + aᵀ) / 2."""
    return [[(a[i][j] + a[j][i]) * 0.5 for j in AXES] for i in AXES]


def add_isotropic(a: Tensor3, scalar: Any) -> Tensor3:
    """a + scalar I."""
    return [[a[i][j] + scalar if i == j else a[i][j] for j in AXES] for i in AXES]


def scaled(a: Tensor3, scalar: Any) -> Tensor3:
    """scalar a."""
    return [[scalar * a[i][j] for j in AXES] for i in AXES]


def added(a: Tensor3, b: Tensor3) -> Tensor3:
    """a + b."""
    return [[x + y for x, y in zip(*rows, strict=True)] for rows in zip(a, b, strict=True)]


def deviator(a: Tensor3) -> Tensor3:
    """a - tr(a) / 3 I."""
    return add_isotropic(a, -(a[0][0] + a[1][1] + a[2][2]) / 3.0)


def contraction(a: Tensor3, b: Tensor3) -> Any:
    """a : b."""
    return sum(a[i][j] * b[i][j] for i in AXES for j in AXES)


def minor(a: Tensor3, i: int, j: int) -> Any:
    """Entry (i, j) of :func:`cofactor`."""
    (p, q), (r, s) = ((i + 1) % 3, (i + 2) % 3), ((j + 1) % 3, (j + 2) % 3)
    return a[p][r] * a[q][s] - a[p][s] * a[q][r]


def cofactor(a: Tensor3) -> Tensor3:
    """det(a) a^-T."""
    return [[minor(a, i, j) for j in AXES] for i in AXES]
