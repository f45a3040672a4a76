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

TINY = 1e-15
"""Makes the rotation of two equal eigenvalues the identity."""

ReturnMap = Callable[[list[Any]], tuple[list[Any], list[Any]]]
"""Three principal log-strains -> three new ones, and three principal Kirchhoff stresses [Pa]."""


@ti.func
def distinct_direction(M):
    """Unit vector in the kernel of a symmetric 3x3 matrix of rank 2: the longest cross product of two rows."""
    r0, r1 = ti.Vector([M[0, 0], M[0, 1], M[0, 2]]), ti.Vector([M[0, 1], M[1, 1], M[1, 2]])
    r2 = ti.Vector([M[0, 2], M[1, 2], M[2, 2]])
    a, b, c = r0.cross(r1), r1.cross(r2), r2.cross(r0)
    na, nb, nc = a.norm_sqr(), b.norm_sqr(), c.norm_sqr()
    first, second = na >= nb and na >= nc, nb >= nc
    norm = ti.max(na, nb, nc)
    scale = 1.0 / ti.sqrt(norm)
    return ti.Vector([scale * ti.select(first, a[k], ti.select(second, b[k], c[k])) for k in ti.static(range(3))])


@ti.func
def symmetric_eigen(b):
    """Eigenvalues of a symmetric 3x3 matrix and eigenvectors (columns), accurate to rounding also when some are equal.

    The best separated eigenvalue is the root of 4 c^3 - 3 c = r in [sqrt(3)/2, 1], by Newton from a polynomial within
    2e-5; the other two follow from one rotation in the plane across its vector, without a test or a branch on how close
    they are. After D. Eberly, "A robust eigensolver for 3x3 symmetric matrices", 2014; orthonormal basis of the plane:
    Duff et al., "Building an orthonormal basis, revisited", 2017.
    """
    mean = b.trace() / 3.0
    S = b - mean * ti.Matrix.identity(float, 3)
    size = ti.sqrt((S * S).sum() / 6.0)
    values, U = ti.Vector([b[0, 0], b[1, 1], b[2, 2]]), ti.Matrix.identity(float, 3)
    if size > 0.0:
        S = S * (1.0 / size)
        half = 0.5 * S.determinant()
        r = ti.min(ti.abs(half), 1.0)
        c = 0.86603443 + r * (0.16637630 + r * (-0.04585719 + r * (0.01750433 - r * 0.00406467)))
        for _ in ti.static(range(2 if compiling_double() else 1)):
            c -= (c * (4.0 * c * c - 3.0) - r) / (12.0 * c * c - 3.0)
        distinct = 2.0 * ti.select(half < 0.0, -c, c)
        a = distinct_direction(S - distinct * ti.Matrix.identity(float, 3))
        side = ti.select(a[2] < 0.0, -1.0, 1.0)
        tilt = -1.0 / (side + a[2])
        p = ti.Vector([1.0 + side * a[0] * a[0] * tilt, side * a[0] * a[1] * tilt, -side * a[0]])
        q = ti.Vector([a[0] * a[1] * tilt, side + a[1] * a[1] * tilt, -a[1]])
        Sp, Sq = S @ p, S @ q
        pp, pq, qq = p.dot(Sp), q.dot(Sp), q.dot(Sq)
        d = 0.5 * (qq - pp)
        h = ti.sqrt(d * d + pq * pq)
        cosine, sine = ti.abs(d) + h + TINY, ti.select(d < 0.0, -pq, pq)
        scale = 1.0 / ti.sqrt(cosine * cosine + sine * sine)
        cosine, sine = scale * cosine, scale * sine
        centre, h = 0.5 * (pp + qq), ti.select(d < 0.0, -h, h)
        values = mean + size * ti.Vector([a.dot(S @ a), centre - h, centre + h])
        U = ti.Matrix.cols([a, cosine * p - sine * q, cosine * q + sine * p])
    return values, U


@ti.func
def divided_differences(mapping: ti.template(), e, ratio, stress, beta, i: ti.template(), j: ti.template()):
    """(ratio_i - ratio_j) / (beta_i - beta_j) and the same for the stresses, at strains at least ``near`` apart."""
    near = ti.static(1e-7 if compiling_double() else 5e-5)
    R, T, B, gap = ratio[i] - ratio[j], stress[i] - stress[j], beta[i] - beta[j], e[i] - e[j]
    if ti.abs(gap) < near:
        mean, half = 0.5 * (e[i] + e[j]), ti.select(gap < 0.0, -0.5, 0.5) * near
        apart = e
        apart[i], apart[j] = mean + half, mean - half
        there = _evaluated(mapping, apart)
        R, T = there[i] - there[j], there[3 + i] - there[3 + j]
        B = 4.0 * half * ti.exp(2.0 * mean)  # exp(2 e_i) - exp(2 e_j) without its cancellation; sinh(near) = near
    return R / B, T / B


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
        known = [keep(ti.Vector([plain(x) for x in values])) for values in (strain, ratio, stress, beta)]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            slope_R, slope_T = divided_differences(floored, *known, i, j)
            across[i, j] = keep(of_R[i][j] * slope_R + of_T[i][j] * slope_T)
        return [*_flat(_product(R, of_new)), *(of_R[i][i] for i in AXES), *(of_T[i][i] for i in AXES)]

    outputs, operands = [*_flat(_product(R, f)), *_flat(tau)], [*(a for row in F for a in row), *ratio, *stress]
    flat = record.step(outputs, operands, adjoint)
    return [flat[0:3], flat[3:6], flat[6:9]], [flat[9:12], flat[12:15], flat[15:18]]


def _evaluated(mapping: ReturnMap, e: Any) -> list[Any]:
    """Ratios exp(f - e), then stresses, of a return mapping at other strains (a 3-vector), without a record."""
    strain, aside = components(e), Record()
    new, stress = mapping([Scalar(aside, x) for x in strain])
    return [*(keep(ti.exp(plain(n) - x)) for n, x in zip(new, strain, strict=True)), *(plain(x) for x in stress)]


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
