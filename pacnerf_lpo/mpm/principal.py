"""Isotropic plasticity in principal space: a law maps three log-strains, and the tensors around it are done here, once.

With b = F Fᵀ = U diag(beta) Uᵀ and e = ln(beta)/2, a return mapping e -> (f, tau) gives

    F_new = U diag(exp(f - e)) Uᵀ F,     tau = U diag(tau) Uᵀ.

Along the principal axes the adjoint is that of the return mapping. Across them, rotating the axes changes U diag(g)
Uᵀ by the divided differences (g_i - g_j)/(beta_i - beta_j). Where two stretches come closer than ``near``, the return
mapping is evaluated at two strains that far apart, with the same mean: for an isotropic law the error is of second
order, and nothing is singular.
"""

from collections.abc import Callable
from typing import Any

from pacnerf_lpo.mpm.differentiation import Record, Scalar, exp, maximum, plain
from pacnerf_lpo.mpm.runtime import compiling_double, components, entries, keep, ti
from pacnerf_lpo.mpm.tensors import AXES, Tensor3

LOG_SMALLEST_STRETCH = -2.995732273553991
"""ln 0.05."""
SMALLEST_BETA = 1e-12
"""Keeps the logarithm finite where rounding makes a vanishing eigenvalue negative."""

ReturnMap = Callable[[list[Any]], tuple[list[Any], list[Any]]]
"""Three principal log-strains -> three new ones, and three principal Kirchhoff stresses [Pa]."""


@ti.func
def symmetric_eigen(b):
    """Eigenvalues of a symmetric 3x3 matrix and eigenvectors (columns), accurate to rounding also when some are equal.

    The best separated eigenvalue is the root of 4 c^3 - 3 c = r in [sqrt(3)/2, 1], by Newton from a close guess; its
    vector is the longest cross product of two rows; the other two follow from one rotation in the plane across. After
    D. Eberly, "A robust eigensolver for 3x3 symmetric matrices", 2014.
    """
    mean = b.trace() / 3.0
    S = b - mean * ti.Matrix.identity(float, 3)
    size = ti.sqrt((S * S).sum() / 6.0)
    values, U = ti.Vector([b[0, 0], b[1, 1], b[2, 2]]), ti.Matrix.identity(float, 3)
    if size > 0.0:
        S = S / size
        half = 0.5 * S.determinant()
        r = ti.min(ti.abs(half), 1.0)
        c = 0.8660254 + r * (0.1655 - 0.0316 * r)
        for _ in ti.static(range(3 if compiling_double() else 2)):
            c -= (c * (4.0 * c * c - 3.0) - r) / (12.0 * c * c - 3.0)
        distinct = 2.0 * c
        if half < 0.0:
            distinct = -distinct
        M = S - distinct * ti.Matrix.identity(float, 3)
        r0, r1, r2 = (
            ti.Vector([M[0, 0], M[0, 1], M[0, 2]]),
            ti.Vector([M[1, 0], M[1, 1], M[1, 2]]),
            ti.Vector([M[2, 0], M[2, 1], M[2, 2]]),
        )
        a, n01, n12, n20 = r0.cross(r1), r0.cross(r1).norm_sqr(), r1.cross(r2).norm_sqr(), r2.cross(r0).norm_sqr()
        if n12 > n01 and n12 >= n20:
            a = r1.cross(r2)
        elif n20 > n01:
            a = r2.cross(r0)
        a = a / a.norm()
        p = ti.Vector([0.0, a[2], -a[1]]) if ti.abs(a[0]) < 0.6 else ti.Vector([-a[2], 0.0, a[0]])
        p = p / p.norm()
        q = a.cross(p)
        Sp = S @ p
        pp, pq, qq = p.dot(Sp), q.dot(Sp), q.dot(S @ q)
        d = 0.5 * (qq - pp)
        reach = ti.abs(d) + ti.sqrt(d * d + pq * pq)
        t = 0.0
        if reach > 0.0:
            t = pq / reach
            if d < 0.0:
                t = -t
        cosine = 1.0 / ti.sqrt(1.0 + t * t)
        u, w = cosine * (p - t * q), cosine * (q + t * p)
        values = mean + size * ti.Vector([a.dot(S @ a), pp - t * pq, qq + t * pq])
        U = ti.Matrix.cols([a, u, w])
    return values, U


def return_mapped(F: Tensor3, mapping: ReturnMap) -> tuple[Tensor3, Tensor3]:
    """New deformation gradient and Kirchhoff stress [Pa] of an isotropic law given in principal log-strains.

    Stretches below 0.05 count as 0.05 (PAC-NeRF).

    Args:
        F: trial deformation gradient.
        mapping: the law, see :data:`ReturnMap`; it may use any number of the local law.
    """
    record: Record = F[0][0].record
    f = [[plain(a) for a in row] for row in F]
    values, vectors = symmetric_eigen(ti.Matrix(_symmetric(lambda i, j: _dot(f[i], f[j]))))
    U, beta = entries(keep(vectors)), [keep(ti.max(x, SMALLEST_BETA)) for x in components(keep(values))]
    columns = _transposed(U)
    across: dict[tuple[int, int], Any] = {}

    def strain_adjoint(g: list) -> list:
        along = [0.0 if g[i] is None else 0.5 * g[i] / beta[i] for i in AXES]
        middle = _symmetric(lambda i, j: along[i] if i == j else across.get((i, j), 0.0))
        of_b = _symmetric(_rotation(U, middle))
        return [2.0 * a for a in _flat(_product(of_b, f))]

    strain = record.step([0.5 * ti.log(x) for x in beta], [a for row in F for a in row], strain_adjoint)

    def floored(e: list[Any]) -> tuple[list[Any], list[Any]]:
        return mapping([maximum(x, LOG_SMALLEST_STRETCH) for x in e])

    new, stress = floored(strain)
    ratio = [exp(new[i] - strain[i]) for i in AXES]
    R, tau = (_symmetric(_spectrum(U, [plain(x) for x in g])) for g in (ratio, stress))

    def adjoint(g: list) -> list:
        """Adjoints of F, of the three ratios and of the three stresses, from those of F_new and tau.

        What rotates the axes is left in ``across`` for the adjoint of the strains, which comes next.
        """
        g = [0.0 if x is None else x for x in g]
        of_new, of_tau = [g[0:3], g[3:6], g[6:9]], g[9:]
        of_R = _symmetric(lambda i, j: 0.5 * (_dot(of_new[i], f[j]) + _dot(of_new[j], f[i])))
        of_T = _symmetric(lambda i, j: 0.5 * (of_tau[3 * i + j] + of_tau[3 * j + i]))
        of_R, of_T = (_symmetric(_rotation(columns, a)) for a in (of_R, of_T))
        for i, j in ((0, 1), (0, 2), (1, 2)):
            slope_R, slope_T = _divided_differences(floored, [x.value for x in strain], i, j)
            across[i, j] = keep(of_R[i][j] * slope_R + of_T[i][j] * slope_T)
        return [*_flat(_product(R, of_new)), *(of_R[i][i] for i in AXES), *(of_T[i][i] for i in AXES)]

    outputs, operands = [*_flat(_product(R, f)), *_flat(tau)], [*(a for row in F for a in row), *ratio, *stress]
    flat = record.step(outputs, operands, adjoint)
    return [flat[0:3], flat[3:6], flat[6:9]], [flat[9:12], flat[12:15], flat[15:18]]


def _divided_differences(mapping: ReturnMap, e: list, i: int, j: int) -> tuple[Any, Any]:
    """(ratio_i - ratio_j) / (beta_i - beta_j) and the same for the stresses, at strains kept at least ``near``
    apart.
    """
    near = 1e-5 if compiling_double() else 3e-3
    mean, gap = keep(0.5 * (e[i] + e[j])), keep(e[i] - e[j])
    half = keep(ti.select(gap < 0.0, -0.5, 0.5) * ti.max(ti.abs(gap), near))
    apart = list(e)
    apart[i], apart[j] = keep(mean + half), keep(mean - half)
    aside = Record()
    new, stress = mapping([Scalar(aside, x) for x in apart])
    ratio_i, ratio_j = (ti.exp(plain(new[k]) - apart[k]) for k in (i, j))
    by_beta = keep(1.0 / (ti.exp(2.0 * apart[i]) - ti.exp(2.0 * apart[j])))
    return keep((ratio_i - ratio_j) * by_beta), keep((plain(stress[i]) - plain(stress[j])) * by_beta)


def _dot(a: list, b: list) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _symmetric(entry: Callable[[int, int], Any]) -> Tensor3:
    """The symmetric tensor with these entries on and above the diagonal."""
    upper = {(i, j): keep(entry(i, j)) for i in AXES for j in range(i, 3)}
    return [[upper[min(i, j), max(i, j)] for j in AXES] for i in AXES]


def _spectrum(U: Tensor3, values: list) -> Callable[[int, int], Any]:
    """Entries of U diag(values) Uᵀ."""
    scaled = [[keep(U[i][k] * values[k]) for k in AXES] for i in AXES]
    return lambda i, j: _dot(scaled[i], U[j])


def _rotation(U: Tensor3, a: Tensor3) -> Callable[[int, int], Any]:
    """Entries of U a Uᵀ for symmetric a."""
    left = [[keep(_dot(U[i], a[k])) for k in AXES] for i in AXES]
    return lambda i, j: _dot(left[i], U[j])


def _product(a: Tensor3, b: Tensor3) -> Tensor3:
    columns = _transposed(b)
    return [[keep(_dot(a[i], columns[j])) for j in AXES] for i in AXES]


def _transposed(a: Tensor3) -> Tensor3:
    return [[a[j][i] for j in AXES] for i in AXES]


def _flat(a: Tensor3) -> list:
    return [x for row in a for x in row]
