"""How large a score has to be: every effect's own scale, and the threshold over the catalogue, from left-out twins.

Along any one direction the covariance learnt from a few twins is off by an unknown factor, most of all along the
smooth motions that effects and numerical errors share. So each twin is scored under the noise model of the others. The
mean square of an effect's z over the twins is the square of its scale; like every variance from few samples it is
moderated towards the mean of the catalogue, as if that were so many (LENDING) further twins (Smyth 2004), and never
taken below 1. z / scale then has the tails of Student's t, and the largest of a catalogue of correlated effects is
simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import t as student

from pacnerf_lpo.diagnosis.statistics.score import Probe, Remainder, Score, equivalent_z
from pacnerf_lpo.inference.noise import NoiseModel

LENDING = 4.0
DRAWS = 20_000
TAIL_DRAWS = 50
"""Fewer simulated maxima than this beyond a score: Bonferroni's bound is the better p-value."""


@dataclass(frozen=True)
class Calibration:
    """What scores are compared with.

    scales: factor on the standard deviation of every effect's z, >= 1
    dof: degrees of freedom of Student's t that z / scale follows where nothing is missing
    level: family-wise false-alarm rate
    threshold: of |z| / scale of the best of the catalogue
    twin_maxima: the same statistic of every twin, with its own scale left out (T,)
    draws: simulated maxima under the null, ascending
    """

    scales: dict[str, float]
    dof: float
    level: float
    threshold: float
    twin_maxima: np.ndarray = field(repr=False)
    draws: np.ndarray = field(repr=False)

    def p_value(self, score: Score) -> float:
        """Probability that the best of the catalogue reaches this score though nothing is missing.

        The score must have been made with :attr:`scales`.
        """
        beyond = len(self.draws) - int(np.searchsorted(self.draws, abs(score.z)))
        if beyond >= TAIL_DRAWS:
            return (beyond + 1) / (len(self.draws) + 1)
        return min(1.0, 2 * len(self.scales) * float(student.sf(abs(score.z), self.dof)))

    def interval(self, score: Score, level: float = 0.9) -> list[tuple[float, float]]:
        """Interval of every component of the coefficient, counted from the null: the bound where nothing is found."""
        width = float(student.ppf(0.5 + level / 2, self.dof))
        pairs = zip(score.coefficient, score.error, strict=True)
        return [(value - width * error, value + width * error) for value, error in pairs]


def calibrate(
    noise: NoiseModel, jacobian: np.ndarray, probes: Sequence[Probe], level: float = 0.05, seed: int = 0
) -> Calibration:
    """Scales, threshold and null distribution for a catalogue.

    Args:
        noise: of the residual, with its twins
        jacobian: sensitivities to the fitted parameters (D, P)
        probes: the catalogue, camera faults included
        level: family-wise false-alarm rate
        seed: of the simulated maxima
    """
    squares = left_out_squares(noise, jacobian, probes)
    scales = moderated_scales(squares)
    dof = len(noise.twins) - 1 + LENDING / 2
    maxima = np.array(
        [
            np.sqrt((row / moderated_scales(np.delete(squares, twin, axis=0)) ** 2).max())
            for twin, row in enumerate(squares)
        ]
    )
    draws = np.sort(_simulated_maxima(Remainder.of(noise, jacobian), probes, dof, np.random.default_rng(seed)))
    names = [probe.name for probe in probes]
    threshold = float(np.quantile(draws, 1 - level))
    return Calibration(dict(zip(names, scales.tolist(), strict=True)), dof, level, threshold, maxima, draws)


def left_out_squares(noise: NoiseModel, jacobian: np.ndarray, probes: Sequence[Probe]) -> np.ndarray:
    """z^2 per component of every twin under the noise model of the others, averaged over the probe's columns (T, K)."""
    rows = []
    for model, twin in noise.left_out:
        remainder = Remainder.of(model, jacobian)
        left = remainder.residual(twin)
        rows.append([np.mean((direction.T @ left) ** 2) for direction in _directions(remainder, probes)])
    return np.array(rows)


def moderated_scales(squares: np.ndarray) -> np.ndarray:
    """Scale of every direction (K,), at least 1, from the squares of left-out twins along it (T, K)."""
    own = squares.mean(0)
    common = max(float(own.mean()), 1.0)
    return np.sqrt(np.maximum((len(squares) * own + LENDING * common) / (len(squares) + LENDING), 1.0))


def _directions(remainder: Remainder, probes: Sequence[Probe]) -> list[np.ndarray]:
    """Unit vectors of every probe (D, m): one for every size, or an orthonormal basis of the components."""
    changes = remainder.change(np.concatenate([probe.change for probe in probes], axis=1))
    strengths = np.linalg.norm(changes, axis=0)
    units = changes / np.where(strengths > 0, strengths, 1.0)
    result = np.split(units, np.cumsum([len(probe.sizes) for probe in probes])[:-1], axis=1)
    return [_basis(unit) if probe.joint else unit for probe, unit in zip(probes, result, strict=True)]


def _basis(vectors: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the span of vectors (D, m)."""
    left, strengths, _ = np.linalg.svd(vectors, full_matrices=False)
    return left[:, strengths > 1e-6]


def _simulated_maxima(
    remainder: Remainder, probes: Sequence[Probe], dof: float, rng: np.random.Generator
) -> np.ndarray:
    """Largest |z| over the catalogue for white noise, each effect's divided by a scale of its own with ``dof`` (n,)."""
    directions = _directions(remainder, probes)
    _, strengths, mix = np.linalg.svd(np.concatenate(directions, axis=1), full_matrices=False)
    columns = np.split(strengths[:, None] * mix, np.cumsum([d.shape[1] for d in directions])[:-1], axis=1)
    noise = rng.standard_normal((DRAWS, len(strengths)))
    maxima = np.zeros(DRAWS)
    for probe, column in zip(probes, columns, strict=True):
        deviates = noise @ column
        spread = np.sqrt(rng.chisquare(dof, DRAWS) / dof)
        if probe.joint:
            z = equivalent_z((deviates**2).sum(1) / spread**2, column.shape[1])
        else:
            z = (deviates if probe.one_sided else np.abs(deviates)).max(1) / spread
        maxima = np.maximum(maxima, z)
    return maxima
