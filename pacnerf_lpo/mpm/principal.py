"""Isotropic plasticity in principal space: a law maps three log-strains, and the tensors around it are done here, once.

With b = F Fᵀ = U diag(beta) Uᵀ and e = ln(beta)/2, a return mapping e -> (f, tau) gives

    F_new = U diag(exp(f - e)) Uᵀ F,     tau = U diag(tau) Uᵀ.

Along the principal axes the adjoint is that of the return mapping. Across them, rotating the axes changes U diag(g) Uᵀ by the
divided differences (g_i - g_j)/(beta_i - beta_j). Where two stretches come closer than ``near``, the return mapping is evaluated
at two strains that far apart, with the same mean: for an isotropic law the error is of second order, and nothing is singular.
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

    The best separated eigenvalue is the root of 4 c^3 - 3 c = r in [sqrt(3)/2, 1], by Newton from a close guess; its vector
    is the longest cross product of two rows; the other two follow from one rotation in the plane across.
    After D. Eberly, "A robust eigensolver for 3x3 symmetric matrices", 2014.
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
        for _ in ti.static(range(3)):
            c -= (c * (4.0 * c * c - 3.0) - r) / (12.0 * c * c - 3.0)
        distinct = 2.0 * c
        if half < 0.0:
            distinct = -distinct
        M = S - distinct * ti.Matrix.identity(float, 3)
        r0, r1, r2 = ti.Vector([M[0, 0], M[0, 1], M[0, 2]]), ti.Vector([M[1, 0], M[1, 1], M[1, 2]]), ti.Vector([M[2, 0], M[2, 1], M[2, 2]])
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


@ti.func
def product(a, b):
    return a @ b


@ti.func
def left_cauchy_green(F):
    return F @ F.transpose()


@ti.func
def rotated(U, a):
    """U a Uᵀ."""
    return U @ a @ U.transpose()


@ti.func
def unrotated(U, a):
    """Uᵀ a U."""
    return U.transpose() @ a @ U


@ti.func
def product_transposed(a, b):
    return a @ b.transpose()


def return_mapped(F: Tensor3, mapping: ReturnMap) -> tuple[Tensor3, Tensor3]:
    """New deformation gradient and Kirchhoff stress [Pa] of an isotropic law given in principal log-strains.

    Stretches below 0.05 count as 0.05 (PAC-NeRF).

    Args:
        F: trial deformation gradient.
        mapping: the law, see :data:`ReturnMap`; it may use any number of the local law.
    """
    record: Record = F[0][0].record
    flat_F = [a for row in F for a in row]
    plain_F = _matrix([plain(a) for a in flat_F])
    values, U = (keep(x) for x in symmetric_eigen(left_cauchy_green(plain_F)))
    beta = [keep(ti.max(x, SMALLEST_BETA)) for x in components(values)]

    def strain_adjoint(g: list) -> list:
        along = _diagonal([0.0 if g[i] is None else g[i] / beta[i] for i in AXES])
        return _flat(product(rotated(U, along), plain_F))

    strain = record.step([0.5 * ti.log(x) for x in beta], flat_F, strain_adjoint)

    def floored(e: list[Any]) -> tuple[list[Any], list[Any]]:
        return mapping([maximum(x, LOG_SMALLEST_STRETCH) for x in e])

    new, stress = floored(strain)
    ratio = [exp(new[i] - strain[i]) for i in AXES]
    R, tau = (keep(rotated(U, _diagonal([plain(x) for x in g]))) for g in (ratio, stress))

    def adjoint(g: list) -> list:
        """Adjoints of F, of the three ratios and of the three stresses, from those of F_new and tau."""
        of_new, of_tau = _matrix(g[:9]), _matrix(g[9:])
        of_R = entries(unrotated(U, product_transposed(of_new, plain_F)))
        of_T = entries(unrotated(U, of_tau))
        across = [[0.0] * 3 for _ in AXES]
        for i, j in ((0, 1), (1, 2), (2, 0)):
            slope_R, slope_T = _divided_differences(floored, [x.value for x in strain], i, j)
            half = 0.5 * ((of_R[i][j] + of_R[j][i]) * slope_R + (of_T[i][j] + of_T[j][i]) * slope_T)
            across[i][j] = across[j][i] = keep(half)
        by_axes = product(rotated(U, ti.Matrix(across)), plain_F)
        of_F = [a + 2.0 * b for a, b in zip(_flat(product(R, of_new)), _flat(by_axes), strict=True)]
        return [*of_F, *(of_R[i][i] for i in AXES), *(of_T[i][i] for i in AXES)]

    flat = record.step([*_flat(product(R, plain_F)), *_flat(tau)], [*flat_F, *ratio, *stress], adjoint)
    return [flat[0:3], flat[3:6], flat[6:9]], [flat[9:12], flat[12:15], flat[15:18]]


def _divided_differences(mapping: ReturnMap, e: list, i: int, j: int) -> tuple[Any, Any]:
    """(ratio_i - ratio_j) / (beta_i - beta_j) and the same for the stresses, at strains kept at least ``near`` apart."""
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


def _diagonal(x: list) -> Any:
    return ti.Matrix([[x[0], 0.0, 0.0], [0.0, x[1], 0.0], [0.0, 0.0, x[2]]])


def _matrix(flat: list) -> Any:
    filled = [0.0 if x is None else x for x in flat]
    return keep(ti.Matrix([filled[0:3], filled[3:6], filled[6:9]]))


def _flat(matrix: Any) -> list:
    return [x for row in entries(keep(matrix)) for x in row]
