"""Isotropic plasticity in principal space: a law maps three log-strains, and the tensors around it are done here, once.

With b = F Fᵀ = U diag(beta) Uᵀ and e = ln(beta)/2, a flow rule says which share k of the deviator of e stays, and which
mean strain m; then f = m + k dev(e), and of Hencky's energy

    F_new = F + U diag(exp(f - e) - 1) Uᵀ F,     tau = U diag(2 mu f + lambda tr(f)) Uᵀ.

(In exact arithmetic the first is U diag(exp(f - e)) Uᵀ F. But rounded eigenvectors are not quite orthonormal, from one
substep to the next in the same way, and an elastic particle multiplied by U Uᵀ would slowly change its volume.)

Along the principal axes the adjoint is that of the flow rule. Across them, rotating the axes changes U diag(g) Uᵀ by
the divided differences (g_i - g_j)/(beta_i - beta_j). As k and m are isotropic, f_i - f_j = k (e_i - e_j), so these
follow from (e_i - e_j)/(beta_i - beta_j), for nearly equal stretches by series: nothing is singular or cancels.
"""

from collections.abc import Callable
from typing import Any

from pacnerf_lpo.mpm.differentiation import Record, exp, maximum, plain, sqrt
from pacnerf_lpo.mpm.lanes import absolute, keep, kept, largest, log, select, smallest
from pacnerf_lpo.mpm.lanes import sqrt as root
from pacnerf_lpo.mpm.taichi_calls import compiling_double
from pacnerf_lpo.mpm.tensors import AXES, Tensor3, added, determinant, dot, flat, minor, mirrored, product, transposed

LOG_SMALLEST_STRETCH = -2.995732273553991
"""ln 0.05."""
SMALLEST_STRETCH_SQUARE = 0.0025
SMALLEST_BETA = 1e-12
"""Keeps the logarithm finite where rounding makes a vanishing eigenvalue negative."""
SMALLEST_SQUARE = 1e-36
"""Of the deviator of b; below, b counts as isotropic. A normal number in float32."""
TINY = 1e-15
"""Makes the rotation of two equal eigenvalues the identity."""
NEAR = 0.02
"""Relative gap of two eigenvalues below which a series of their divided differences is exact to 1e-15."""

Flow = Callable[[list[Any], Any, Any], tuple[Any, Any]]
"""Principal log-strains, their mean and the norm of their deviator -> share k of the deviator that stays, new mean."""


def symmetric_eigen(b: Tensor3) -> tuple[list[Any], Tensor3]:
    """Eigenvalues of a symmetric 3x3 matrix and eigenvectors (columns), accurate to rounding also when some are equal.

    The best separated eigenvalue is the root of 4 c^3 - 3 c = r in [sqrt(3)/2, 1], by Newton from a polynomial within
    2e-5; the other two follow from one rotation in the plane across its vector, without a test or a branch on how close
    they are. After D. Eberly, "A robust eigensolver for 3x3 symmetric matrices", 2014; orthonormal basis of the plane:
    Duff et al., "Building an orthonormal basis, revisited", 2017. Emitted number by number: as small vectors and
    matrices the same takes a fifth longer.
    """
    mean = keep((b[0][0] + b[1][1] + b[2][2]) * (1.0 / 3.0))
    S = _symmetric(lambda i, j: b[i][j] - mean if i == j else b[i][j])
    size = root(largest(_squares(S) * (1.0 / 6.0), SMALLEST_SQUARE))
    inverse = keep(1.0 / size)
    S = _symmetric(lambda i, j: S[i][j] * inverse)
    half = keep(0.5 * determinant(S))
    r = smallest(absolute(half), 1.0)
    c = keep(0.86603443 + r * (0.16637630 + r * (-0.04585719 + r * (0.01750433 - r * 0.00406467))))
    for _ in range(2 if compiling_double() else 1):
        c = keep(c - (c * (4.0 * c * c - 3.0) - r) / (12.0 * c * c - 3.0))
    distinct = select(half < 0.0, -2.0 * c, 2.0 * c)
    a = _kernel(_symmetric(lambda i, j: S[i][j] - distinct if i == j else S[i][j]))
    side = select(a[2] < 0.0, -1.0, 1.0)
    tilt = keep(-1.0 / (side + a[2]))
    twist = keep(a[0] * a[1] * tilt)
    p = [keep(1.0 + side * a[0] * a[0] * tilt), keep(side * twist), keep(-side * a[0])]
    q = [twist, keep(side + a[1] * a[1] * tilt), keep(-a[1])]
    Sp = [keep(dot(row, p)) for row in S]
    pp, pq = keep(dot(p, Sp)), keep(dot(q, Sp))
    d = keep(-0.5 * distinct - pp)  # half of q·Sq - p·Sp; the trace is zero
    h = root(d * d + pq * pq)
    cosine, sine = keep(absolute(d) + h + TINY), select(d < 0.0, -pq, pq)
    scale = keep(1.0 / root(cosine * cosine + sine * sine))
    cosine, sine, h = keep(scale * cosine), keep(scale * sine), select(d < 0.0, -h, h)
    values = [keep(mean + size * x) for x in (distinct, -0.5 * distinct - h, -0.5 * distinct + h)]
    return values, [[a[i], keep(cosine * p[i] - sine * q[i]), keep(cosine * q[i] + sine * p[i])] for i in AXES]


def return_mapped(F: Tensor3, mu: Any, lam: Any, flow: Flow) -> tuple[Tensor3, Tensor3]:
    """New deformation gradient and Kirchhoff stress [Pa] of Hencky elasticity with an isotropic flow rule.

    Stretches below 0.05 count as 0.05 (PAC-NeRF).

    Args:
        F: trial deformation gradient.
        mu: shear modulus [Pa].
        lam: Lamé's first coefficient [Pa].
        flow: what stays of the strain, see :data:`Flow`; it may use any number of the local law.
    """
    record: Record = F[0][0].record
    f = plain(F)
    values, U = symmetric_eigen(_times_transposed(f, f))
    beta = [largest(x, SMALLEST_BETA) for x in values]
    columns = transposed(U)
    turned = kept(product(columns, f))
    across: dict[tuple[int, int], Any] = {}
    stretched: Tensor3 = []

    def strain_adjoint(g: list) -> list:
        along = [0.0 if g[i] is None else keep(g[i] / beta[i]) for i in AXES]
        of_b = _symmetric(lambda i, j: along[i] if i == j else across[i, j])
        of_turned = kept(added(kept(product(of_b, turned)), stretched))
        return flat(kept(product(U, of_turned)))

    operands = flat(F)
    trial = record.step([0.5 * log(x) for x in beta], operands, strain_adjoint)
    strain = [maximum(x, LOG_SMALLEST_STRETCH) for x in trial]
    mean = (strain[0] + strain[1] + strain[2]) * (1.0 / 3.0)
    deviator = [x - mean for x in strain]
    share, new_mean = flow(strain, mean, sqrt(dot(deviator, deviator)))
    pressure, shear = (2.0 * mu + 3.0 * lam) * new_mean, 2.0 * mu * share
    lost, shift = share - 1.0, new_mean - mean  # exactly 0 without flow
    ratio = [exp(lost * d + shift + (y - x)) for d, y, x in zip(deviator, strain, trial, strict=True)]
    stress = [shear * d + pressure for d in deviator]

    def adjoint(g: list) -> list:
        """Adjoints of the three ratios and of the three stresses, from those of F_new and tau.

        What else reaches the strains is left in ``across`` and ``stretched`` for their adjoint, which comes next.
        """
        g = [0.0 if x is None else x for x in g]
        of_new = kept(product(columns, [g[0:3], g[3:6], g[6:9]]))
        of_tau = _symmetric(lambda i, j: 0.5 * (g[9 + 3 * i + j] + g[9 + 3 * j + i]))
        of_T = _times_transposed(kept(product(columns, of_tau)), columns)
        stretched.extend([keep(plain(ratio[k]) * x) for x in of_new[k]] for k in AXES)
        slopes = _slopes(beta, plain(strain), plain(ratio), plain(share))
        for (i, j), (of_ratio, of_strain) in slopes.items():
            of_R = dot(of_new[i], turned[j]) + dot(of_new[j], turned[i])
            across[i, j] = keep(of_R * of_ratio + 2.0 * plain(shear) * of_T[i][j] * of_strain)
        return [*(dot(of_new[i], turned[i]) for i in AXES), *(of_T[i][i] for i in AXES)]

    change = kept(product(U, [[keep((plain(ratio[k]) - 1.0) * x) for x in turned[k]] for k in AXES]))
    new = kept(added(f, change))
    tau = _times_transposed([[keep(x * plain(y)) for x, y in zip(row, stress, strict=True)] for row in U], U)
    out = record.step(flat(new + tau), [*ratio, *stress], adjoint)
    return [out[0:3], out[3:6], out[6:9]], [out[9:12], out[12:15], out[15:18]]


def _slopes(beta: list, strain: list, ratio: list, share: Any) -> dict[tuple[int, int], tuple[Any, Any]]:
    """(ratio_i - ratio_j) / (beta_i - beta_j), and the same of the floored strains, for each pair of axes.

    With x = (beta_i - beta_j) / (beta_i + beta_j), e_i - e_j = artanh x; and the difference of two exponentials is
    their sum times tanh of half the difference of the exponents.
    """
    result = {}
    for i, j in ((0, 1), (0, 2), (1, 2)):
        gap, total = keep(beta[i] - beta[j]), keep(1.0 / (beta[i] + beta[j]))
        x, inverse = keep(gap * total), keep(1.0 / gap)
        near, square = keep(absolute(x) < NEAR), keep(x * x)
        limit = keep(total * (1.0 + square * (1.0 / 3 + square * (1.0 / 5 + square * (1.0 / 7)))))
        floored = select(beta[i] > SMALLEST_STRETCH_SQUARE, limit, 0.0)
        exponent = keep(share * floored - limit)
        y = keep(0.25 * (exponent * gap) * (exponent * gap))
        mean = 0.5 * (ratio[i] + ratio[j]) * (1.0 - y * (1.0 / 3 - y * (2.0 / 15)))
        of_ratio = select(near, mean * exponent, (ratio[i] - ratio[j]) * inverse)
        result[i, j] = of_ratio, select(near, floored, (strain[i] - strain[j]) * inverse)
    return result


def _kernel(M: Tensor3) -> list[Any]:
    """Unit vector in the kernel of a semidefinite matrix of rank 2: its cofactors are c a aᵀ; their longest column."""
    A = _symmetric(lambda i, j: minor(M, i, j))
    first, second = keep((A[0][0] >= A[1][1]) & (A[0][0] >= A[2][2])), keep(A[1][1] >= A[2][2])
    a = [select(first, A[0][k], select(second, A[1][k], A[2][k])) for k in AXES]
    scale = keep(1.0 / root(dot(a, a)))
    return [keep(scale * x) for x in a]


def _squares(a: Tensor3) -> Any:
    """Sum of the squares of a symmetric matrix's entries."""
    off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2]
    return a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2] + 2.0 * off


def _symmetric(entry: Callable[[int, int], Any]) -> Tensor3:
    """:func:`mirrored` entries, which are kept."""
    return mirrored(lambda i, j: keep(entry(i, j)))


def _times_transposed(a: Tensor3, b: Tensor3) -> Tensor3:
    """a bᵀ where that is symmetric."""
    return _symmetric(lambda i, j: dot(a[i], b[j]))
