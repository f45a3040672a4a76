"""The score of every hypothesis: its marginal likelihood relative to that of the null model.

The standardised residual is y = S (r - mean), where S whitens all that may be there without the hypothesis: sensor
noise, numerical error, errors of the reconstruction, a smooth unknown force, and changes of the fitted parameters, each
with its prior (Kennedy and O'Hagan 2001). A hypothesis adds X b with b ~ N(0, I). Along X = U diag(w) V^T the noise is
larger by a factor s that left-out replicates show. With u = U^T y, and a common unknown dispersion of all noise under
Jeffreys' prior, y is Student's t under either model (Zellner 1971), and the log Bayes factor is

    D/2 [log(R + |u/s|^2) - log(R + sum u^2 / (s^2 + w^2))] - 1/2 sum log(1 + w^2 / s^2),    R = |y|^2 - |u|^2.

R is not believed to be below its expectation D - m: residuals that are smaller than the noise are no evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.noise import NoiseModel


@dataclass(frozen=True)
class Alternative:
    """One alternative of a hypothesis in standardised coordinates.

    axes: U (D, m), orthonormal
    strengths: w (m,): standard deviations by which a prior standard deviation moves the residual
    turn: V (m, m)
    """

    axes: np.ndarray = field(repr=False)
    strengths: np.ndarray
    turn: np.ndarray = field(repr=False)

    @staticmethod
    def of_all(noise: NoiseModel, hypotheses: Sequence[Hypothesis]) -> list[list[Alternative]]:
        """Those of every hypothesis, each of them with every spread of its prior, one after the other."""
        widths = [[change.shape[1] for change in one.alternatives] for one in hypotheses]
        changes = np.concatenate([change for one in hypotheses for change in one.alternatives], axis=1)
        columns = iter(np.split(noise.whiten(changes), np.cumsum([width for own in widths for width in own]), axis=1))
        spanned = [[Alternative._spanned(next(columns)) for _ in own] for own in widths]
        return [
            [replace(one, strengths=spread * one.strengths) for one in own for spread in hypothesis.spreads]
            for own, hypothesis in zip(spanned, hypotheses, strict=True)
        ]

    @staticmethod
    def _spanned(whitened: np.ndarray) -> Alternative:
        if whitened.shape[1] == 1:  # the same without a decomposition, and with the sign of the coefficient
            length = np.linalg.norm(whitened, axis=0)
            return Alternative(whitened / np.maximum(length, 1e-300), length, np.ones((1, 1)))
        axes, strengths, turn = np.linalg.svd(whitened, full_matrices=False)
        return Alternative(axes, strengths, turn.T)

    def log_bayes_factor(self, coordinates: np.ndarray, rest: np.ndarray, scale: float, one_sided: bool) -> np.ndarray:
        """Of the hypothesis against the null.

        Args:
            coordinates: u = U^T y (..., m)
            rest: R (...)
            scale: s
            one_sided: whether the coefficient is positive
        """
        count = len(self.axes)
        squares, w = (coordinates / scale) ** 2, self.strengths / scale
        rest = np.maximum(rest, count - len(w))
        null, other = rest + squares.sum(-1), rest + (squares / (1 + w**2)).sum(-1)
        found = count / 2 * np.log(null / other) - 0.5 * np.log1p(w**2).sum()
        if one_sided:
            deviate = (coordinates / scale * w / np.sqrt(1 + w**2))[..., 0]
            found = found + np.log(2) + norm.logcdf(deviate * np.sqrt(count / other))
        return found


@dataclass(frozen=True)
class Score:
    """How well a hypothesis explains the residual, before anything is refitted.

    name: of the hypothesis
    log_bayes_factor: of it against the null
    alternative: number of the alternative that explains most
    coefficient: posterior mean of every coefficient, counted from the null [its unit]
    error: posterior standard deviation [its unit]
    gain: by how much the cost would fall
    strength: standard deviations by which the estimated effect moves the residual
    signature: direction of that change, standardised, of unit length (D,)
    """

    name: str
    log_bayes_factor: float
    alternative: int
    coefficient: tuple[float, ...]
    error: tuple[float, ...]
    gain: float
    strength: float
    signature: np.ndarray = field(repr=False)


def score(noise: NoiseModel, residual: np.ndarray, hypothesis: Hypothesis, scale: float) -> Score:
    """Score one hypothesis.

    Args:
        noise: of the residual, with the fitted parameters and the discrepancies among its directions
        residual: measured minus predicted (D,)
        hypothesis: with changes of the same entries
        scale: s, factor on the noise along the hypothesis
    """
    y = noise.whiten_residual(residual)
    tried = Alternative.of_all(noise, [hypothesis])[0]
    factors = [_factor(alternative, y, scale, hypothesis.one_sided) for alternative in tried]
    best = int(np.argmax(factors))
    number, spread = divmod(best, len(hypothesis.spreads))
    chosen, widths = tried[best], hypothesis.widths[number] * hypothesis.spreads[spread]
    u, w = chosen.axes.T @ y, chosen.strengths
    mean, variance = chosen.turn @ (w * u / (scale**2 + w**2)), scale**2 / (scale**2 + w**2)
    if hypothesis.one_sided:
        mean = np.maximum(mean, 0.0)
    error = np.sqrt((chosen.turn**2) @ variance)
    change = chosen.axes @ (w * (chosen.turn.T @ mean))
    size = float(np.linalg.norm(change))
    return Score(
        hypothesis.name,
        float(logsumexp(factors) - np.log(len(factors))),
        number,
        tuple((mean * widths).tolist()),
        tuple((error * np.abs(widths)).tolist()),
        float(2 * change @ y - change @ change) / scale**2,
        size,
        change / max(size, 1e-300),
    )


def _factor(alternative: Alternative, y: np.ndarray, scale: float, one_sided: bool) -> float:
    u = alternative.axes.T @ y
    return float(alternative.log_bayes_factor(u, y @ y - u @ u, scale, one_sided))
