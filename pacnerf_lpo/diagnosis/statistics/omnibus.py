"""Is there more than noise: a test that names no effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from pacnerf_lpo.diagnosis.statistics.score import Remainder
from pacnerf_lpo.inference.noise import NoiseModel


@dataclass(frozen=True)
class Omnibus:
    """Size of the residual against that of the twins.

    statistic: ||M r||^2 / dof, whitened; about 1 under the null
    twins: the same of every twin under the noise model of the others (T,)
    p_value: probability of a residual as large where nothing is missing
    """

    statistic: float
    twins: np.ndarray
    p_value: float


def omnibus(noise: NoiseModel, residual: np.ndarray, jacobian: np.ndarray) -> Omnibus:
    """Non-directed test of ||M W (r - mean)||^2.

    The log of the statistic is compared with that of the left-out twins by Student's t for one further draw; its spread
    is not believed to be below that of chi^2 with the same degrees of freedom.

    Args:
        noise: of the residual, with its twins
        residual: measured minus model (D,)
        jacobian: sensitivities to the fitted parameters (D, P)
    """
    remainder = Remainder.of(noise, jacobian)
    statistic = _mean_square(remainder, residual)
    twins = np.array([_mean_square(Remainder.of(model, jacobian), twin) for model, twin in noise.left_out])
    return Omnibus(statistic, twins, _p_value(statistic, twins, remainder.dof))


def _mean_square(remainder: Remainder, residual: np.ndarray) -> float:
    left = remainder.residual(residual)
    return float(left @ left) / remainder.dof


def _p_value(square: float, twins: np.ndarray, dof: int) -> float:
    """One-sided, of one further draw beside the twins' squares (T,), each a mean over ``dof`` terms."""
    logs, count = np.log(twins), len(twins)
    spread = max(float(logs.std(ddof=1)), np.sqrt(2 / dof))
    return float(student.sf((np.log(max(square, 1e-300)) - logs.mean()) / spread / np.sqrt(1 + 1 / count), count - 1))
