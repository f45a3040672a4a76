"""Is there more than noise, and where: tests that name no effect, in the residual's own unit (pixels)."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from pacnerf_lpo.diagnosis.statistics.noise import NoiseModel
from pacnerf_lpo.diagnosis.statistics.score import Remainder


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


@dataclass(frozen=True)
class Excess:
    """Error of a group of entries beyond the noise floor.

    label: of the group
    rms: of the residual less the numerical bias and what the fitted parameters explain [px]
    floor: the same of the twins, root mean square [px]
    excess: sqrt(rms^2 - floor^2), 0 where below the floor [px]
    p_value: probability of such an rms where nothing is missing
    """

    label: Hashable
    rms: float
    floor: float
    excess: float
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


def excess_error(
    noise: NoiseModel, residual: np.ndarray, jacobian: np.ndarray, labels: Sequence[Hashable]
) -> list[Excess]:
    """Excess over the noise floor by group, in the order in which the groups first appear.

    What the fitted parameters can still explain is taken out, by weighted least squares, of residual and twins.

    Args:
        noise, residual, jacobian: as of :func:`omnibus`
        labels: the group of every entry (D,): its view, its frame, its phase, or a tuple of them; None: in no group
    """
    left = natural_remainder(noise, residual, jacobian)
    twins = np.array([natural_remainder(model, twin, jacobian) for model, twin in noise.left_out])
    result = []
    for label in dict.fromkeys(label for label in labels if label is not None):
        chosen = np.array([other == label for other in labels])
        square, floors = float((left[chosen] ** 2).mean()), (twins[:, chosen] ** 2).mean(1)
        floor = float(floors.mean())
        p_value = _p_value(square, floors, int(chosen.sum()))
        result.append(Excess(label, square**0.5, floor**0.5, max(square - floor, 0.0) ** 0.5, p_value))
    return result


def natural_remainder(noise: NoiseModel, residual: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """r - mean - J p, p by least squares weighted with the noise [the residual's unit, (D,)]."""
    deviation = residual - noise.mean
    if jacobian.shape[1] == 0:
        return deviation
    steps, *_ = np.linalg.lstsq(noise.whiten(jacobian), noise.whiten(deviation), rcond=1e-10)
    return deviation - jacobian @ steps


def _mean_square(remainder: Remainder, residual: np.ndarray) -> float:
    left = remainder.residual(residual)
    return float(left @ left) / remainder.dof


def _p_value(square: float, twins: np.ndarray, dof: int) -> float:
    """One-sided, of one further draw beside the twins' squares (T,), each a mean over ``dof`` terms."""
    logs, count = np.log(twins), len(twins)
    spread = max(float(logs.std(ddof=1)), np.sqrt(2 / dof))
    return float(student.sf((np.log(max(square, 1e-300)) - logs.mean()) / spread / np.sqrt(1 + 1 / count), count - 1))
