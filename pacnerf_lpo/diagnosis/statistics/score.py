"""Which effect would explain what the fitted model leaves over: score test with the fitted parameters as nuisance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import gammaln, ndtri_exp
from scipy.stats import chi2

from pacnerf_lpo.inference.noise import NoiseModel

CONFOUNDED = 1e-6
"""An effect of which less than this part is left beside the fitted parameters is one of them."""


@dataclass(frozen=True)
class Probe:
    """What an effect would change in the residual, at one to three sizes or for its components.

    name: of the effect
    change: measurement with the effect minus measurement without it (D, m)
    sizes: of the coefficient, counted from its null [its unit, (m,)]
    one_sided: whether the coefficient can only lie on the side of the null on which ``sizes`` are
    joint: the m columns are components of one effect (a force along x and z), not sizes of one coefficient
    """

    name: str
    change: np.ndarray = field(repr=False)
    sizes: tuple[float, ...]
    one_sided: bool = False
    joint: bool = False

    def __post_init__(self) -> None:
        if self.change.ndim != 2 or self.change.shape[1] != len(self.sizes):
            raise ValueError(
                f"probe {self.name}: change {self.change.shape} has not one column for each of {self.sizes}"
            )


@dataclass(frozen=True)
class Score:
    """How well one effect explains the residual.

    name: of the effect
    probe: number of the column that explains most; 0 if the columns are components
    z: of the effect, in standard deviations; negative where a two-sided coefficient points against its size
    coefficient: estimate counted from the null, by component [unit of the sizes]
    error: its standard error [unit of the sizes]
    fraction: share of ||M r||^2 that is explained [0..1]
    snr: ||M d|| of the probe: its strength, in standard deviations, beside what the fitted parameters can imitate
    signature: M W d, of unit length, of the probe (D,)
    """

    name: str
    probe: int
    z: float
    coefficient: tuple[float, ...]
    error: tuple[float, ...]
    fraction: float
    snr: float
    signature: np.ndarray = field(repr=False)

    @property
    def gain(self) -> float:
        """z^2: by how much the misfit would fall."""
        return self.z**2


@dataclass(frozen=True)
class Remainder:
    """Whitened quantities with all that the fitted parameters can explain taken out: M W x, M = I - J J^+."""

    noise: NoiseModel
    nuisance: np.ndarray

    @staticmethod
    def of(noise: NoiseModel, jacobian: np.ndarray) -> Remainder:
        """For the sensitivities of the residual to the fitted parameters (D, P)."""
        left, strengths, _ = np.linalg.svd(noise.whiten(jacobian / _column_sizes(jacobian)), full_matrices=False)
        return Remainder(noise, left[:, strengths > 1e-10 * strengths.max(initial=0.0)])

    @property
    def dof(self) -> int:
        """Dimension of what is left."""
        return len(self.nuisance) - self.nuisance.shape[1]

    def project(self, whitened: np.ndarray) -> np.ndarray:
        """M x of whitened vectors (D,) or (D, m)."""
        return whitened - self.nuisance @ (self.nuisance.T @ whitened)

    def residual(self, residual: np.ndarray) -> np.ndarray:
        """M W (r - mean) (D,)."""
        return self.project(self.noise.whiten_residual(residual))

    def change(self, change: np.ndarray) -> np.ndarray:
        """M W d (D, m); a column that the fitted parameters imitate is exactly zero."""
        whitened = self.noise.whiten(change)
        left = self.project(whitened)
        lost = np.linalg.norm(left, axis=0) <= CONFOUNDED * np.linalg.norm(whitened, axis=0)
        return np.where(lost, 0.0, left)


def score_test(
    noise: NoiseModel,
    residual: np.ndarray,
    jacobian: np.ndarray,
    probes: Sequence[Probe],
    scales: Mapping[str, float] | None = None,
) -> list[Score]:
    """Rank effects by how well they explain the residual, best first.

    With whitened r, J and d, and M = I - J J^+ (Rao 1948; nuisance as in Neyman 1959): z = d^T M r / ||M d||, and
    coefficient = size d^T M r / ||M d||^2. A one-sided effect counts only where d^T M r > 0. Components are taken
    together: the squared projection ||P r||^2 onto their span is chi^2 with m degrees of freedom, and z is the normal
    deviate of the same two-sided probability.

    Args:
        noise: of the residual
        residual: measured minus model (D,)
        jacobian: sensitivity of the model's summaries to the fitted parameters (D, P)
        probes: the catalogue
        scales: factor on the standard deviation by effect, from :func:`calibrate`; 1 if left out
    """
    remainder = Remainder.of(noise, jacobian)
    left = remainder.residual(residual)
    scales = scales or {}
    scores = [_score(probe, remainder.change(probe.change), left, scales.get(probe.name, 1.0)) for probe in probes]
    return sorted(scores, key=lambda score: -abs(score.z))


def _score(probe: Probe, changes: np.ndarray, left: np.ndarray, scale: float) -> Score:
    total = max(float(left @ left), 1e-300)
    sizes = np.array(probe.sizes)
    if probe.joint:
        inverse = np.linalg.pinv(changes)
        amplitude = inverse @ left
        fit = changes @ amplitude
        gain = float(fit @ fit)
        errors = scale * np.linalg.norm(inverse, axis=1) * np.abs(sizes)
        z = float(equivalent_z(np.array(gain / scale**2), int(np.linalg.matrix_rank(changes))))
        return Score(
            probe.name,
            0,
            z,
            tuple(amplitude * sizes),
            tuple(errors),
            gain / total,
            float(np.linalg.norm(changes)),
            _unit(fit),
        )
    strengths = np.linalg.norm(changes, axis=0)
    safe = np.where(strengths > 0, strengths, 1.0)
    deviates = changes.T @ left / safe
    best = int(np.argmax(deviates if probe.one_sided else np.abs(deviates)))
    z = max(deviates[best], 0.0) if probe.one_sided else deviates[best]
    error = scale / strengths[best] * abs(sizes[best]) if strengths[best] > 0 else np.inf
    return Score(
        probe.name,
        best,
        float(z / scale),
        (float(z / safe[best] * sizes[best]),),
        (float(error),),
        float(z**2 / total),
        float(strengths[best]),
        _unit(changes[:, best]),
    )


def equivalent_z(gain: np.ndarray, dof: int) -> np.ndarray:
    """The z for which a two-sided normal test has the probability that chi^2 with ``dof`` exceeds ``gain``."""
    if dof == 0:
        return np.zeros_like(gain)
    return -ndtri_exp(np.minimum(log_chi2_survival(gain, dof), -1e-12) - np.log(2))


def log_chi2_survival(gain: np.ndarray, dof: int) -> np.ndarray:
    """log P(chi^2_dof > gain); beyond the range of floats by the asymptotic series of the incomplete gamma function."""
    half, x = dof / 2, np.maximum(gain, 1.0) / 2
    far = (half - 1) * np.log(x) - x - gammaln(half) + np.log1p((half - 1) / x * (1 + (half - 2) / x))
    return np.where(gain > 300 + 10 * dof, far, chi2.logsf(np.minimum(gain, 300 + 10 * dof), dof))


def _column_sizes(matrix: np.ndarray) -> np.ndarray:
    sizes = np.linalg.norm(matrix, axis=0)
    return np.where(sizes > 0, sizes, 1.0)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / max(float(np.linalg.norm(vector)), 1e-300)
