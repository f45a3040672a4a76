"""How large a Bayes factor has to be: the distribution of the largest of all hypotheses where nothing is missing.

Along any one direction the covariance learnt from a few replicates is off by an unknown factor, most of all along the
smooth motions that effects and numerical errors share. So each replicate is scored under the noise model of the others.
The mean square of its coordinates along a hypothesis is the square of that hypothesis' scale; like every variance from
few samples it is moderated towards the mean of all hypotheses, as if that were LENDING further replicates (Smyth 2004),
and never taken below 1. A residual in units of its scale then has the tails of Student's t, and the selection among
correlated hypotheses is simulated as a whole, of residuals that are as large as the replicates and the data show them:
errors known beforehand may be larger in the noise model than in a recording, and less is no evidence, but no reason
either to expect more by chance than there is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from pacnerf_lpo.inference.decision import believed
from pacnerf_lpo.inference.evidence import Alternative
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.noise import NoiseModel

LENDING = 4.0
"""Prior degrees of freedom of a scale: as many as limma finds in data of this size, where the mean of all hypotheses
informs about as much as a few replicates of its own."""
DRAWS = 5000
"""Simulated selections: a p-value of 0.01 is found to a seventh of itself."""
TAIL_DRAWS = 25
"""Fewer simulated maxima than this beyond a score: the p-value is extrapolated."""


@dataclass(frozen=True)
class Fitted:
    """The data among all that a hypothesis is fitted to.

    rows: which of all data [(D,), bool]
    noise: of these, with the fitted parameters and the discrepancies among its directions
    """

    rows: np.ndarray
    noise: NoiseModel

    def of(self, hypothesis: Hypothesis) -> Hypothesis:
        """What a hypothesis about all data says of these."""
        return replace(hypothesis, alternatives=tuple(change[self.rows] for change in hypothesis.alternatives))

    def among_all(self, whole: NoiseModel, axes: np.ndarray) -> np.ndarray:
        """Directions of these data, standardised by their own noise, among all, standardised by the whole (D, m)."""
        found = np.zeros((len(self.rows), axes.shape[1]))
        found[self.rows] = self.noise.adjoint(axes)
        return whole.inverse_adjoint(found)


@dataclass(frozen=True)
class Calibration:
    """What Bayes factors are compared with.

    scales: factor on the noise along every hypothesis, by name, >= 1
    dof: degrees of freedom of Student's t that a residual in units of its scale follows
    level: family-wise false-alarm rate
    threshold: of the log Bayes factor of the best hypothesis
    draws: simulated log Bayes factors of the best hypothesis where nothing is missing, ascending
    """

    scales: dict[str, float]
    dof: float
    level: float
    threshold: float
    draws: np.ndarray = field(repr=False)

    def p_value(self, log_bayes_factor: float) -> float:
        """Probability that the best of all hypotheses reaches this though nothing is missing.

        Beyond the simulated maxima by the tail of Student's t, x^-dof in the deviate x and so of power -dof/2 in the
        logarithm of a Bayes factor, which is x^2 / 2 more than that of no deviation at all, the least of the maxima.
        """
        beyond = len(self.draws) - int(np.searchsorted(self.draws, log_bayes_factor))
        if beyond >= TAIL_DRAWS:
            return (beyond + 1) / (len(self.draws) + 1)
        least, last = float(self.draws[0]), float(self.draws[-TAIL_DRAWS])
        return (
            TAIL_DRAWS
            / len(self.draws)
            * ((last - least) / max(log_bayes_factor - least, last - least)) ** (self.dof / 2)
        )


def calibrate(
    noise: NoiseModel,
    hypotheses: Sequence[Hypothesis],
    fitted: Sequence[Fitted],
    level: float,
    dispersion: float = 1.0,
    seed: int = 0,
) -> Calibration:
    """Scales, threshold and null distribution for all hypotheses of one decision.

    Args:
        noise: of the residual, with the fitted parameters and the discrepancies among its directions
        hypotheses: all that compete, camera faults and discrepancies included
        fitted: the data that each of them is fitted to
        level: family-wise false-alarm rate
        dispersion: mean square of a standardised residual where nothing is missing, see :func:`dispersion_of`
        seed: of the simulated selections
    """
    names = [hypothesis.name for hypothesis in hypotheses]
    scales = dict(zip(names, moderated_scales(left_out_squares(noise, hypotheses)).tolist(), strict=True))
    dof = len(noise.replicates) - 1 + LENDING / 2
    random = np.random.default_rng(seed)
    draws = np.sort(_simulated_maxima(noise, hypotheses, fitted, scales, dof, dispersion, random))
    return Calibration(scales, dof, level, float(np.quantile(draws, 1 - level)), draws)


def dispersion_of(noise: NoiseModel, residual: np.ndarray) -> float:
    """Mean square of a residual (D,) in units of its noise, or that of left-out replicates, whichever is larger; at
    most 1, as what is missing makes it larger, too.
    """
    pairs = [(noise, residual), *noise.left_out]
    found, *others = [float(np.mean(model.whiten_residual(one) ** 2)) for model, one in pairs]
    return min(1.0, max(found, float(np.mean(others))))


def left_out_squares(noise: NoiseModel, hypotheses: Sequence[Hypothesis]) -> np.ndarray:
    """Mean square of every replicate's coordinates along every hypothesis, by the noise model of the others (T, H).

    Of several coordinates each counts by w^2 / (1 + w^2), the part of it that the hypothesis would explain.
    """

    def square(found: Alternative, left: np.ndarray) -> float:
        counted = found.strengths**2 / (1 + found.strengths**2)
        return float(counted @ (found.axes.T @ left) ** 2 / max(counted.sum(), 1e-300))

    rows = []
    for model, replicate in noise.left_out:
        left, tried = model.whiten_residual(replicate), Alternative.of_all(model, hypotheses)
        rows.append([np.mean([square(one, left) for one in own]) for own in tried])
    return np.array(rows)


def moderated_scales(squares: np.ndarray) -> np.ndarray:
    """Scale of every direction (K,), at least 1, from the squares of left-out replicates along it (T, K)."""
    own = squares.mean(0)
    common = max(float(own.mean()), 1.0)
    return np.sqrt(np.maximum((len(squares) * own + LENDING * common) / (len(squares) + LENDING), 1.0))


def _simulated_maxima(
    noise: NoiseModel,
    hypotheses: Sequence[Hypothesis],
    fitted: Sequence[Fitted],
    scales: Mapping[str, float],
    dof: float,
    dispersion: float,
    random: np.random.Generator,
) -> np.ndarray:
    """Largest log Bayes factor of all hypotheses for every one of :data:`DRAWS` residuals without any of them."""
    whole = [[(one, one.axes) for one in tried] for tried in Alternative.of_all(noise, hypotheses)]
    parts = _in_fitted(noise, hypotheses, fitted)
    directions = [axes for tried in (*whole, *parts) for _, axes in tried]
    basis = np.linalg.qr(np.concatenate(directions, axis=1))[0]
    heavy = np.sqrt(random.chisquare(dof, DRAWS) / dof / dispersion)
    residuals = random.standard_normal((DRAWS, basis.shape[1])) / heavy[:, None]
    squares = dispersion * random.chisquare(max(len(basis) - basis.shape[1], 1), DRAWS) + (residuals**2).sum(1)
    together = residuals @ (basis.T @ np.concatenate(directions, axis=1))
    coordinates = iter(np.split(together, np.cumsum([axes.shape[1] for axes in directions])[:-1], axis=1))

    def factors(one: Hypothesis, tried: Sequence[tuple[Alternative, np.ndarray]]) -> np.ndarray:
        found, scale = [], scales[one.name]
        for alternative, _ in tried:
            u, share = next(coordinates), len(alternative.axes) / len(basis)
            rest = share * squares - (u**2).sum(1)
            found.append(alternative.log_bayes_factor(scale * u, rest, scale, one.one_sided))
        return logsumexp(found, axis=0) - np.log(len(tried))

    of_all, of_part = (
        [factors(one, tried) for one, tried in zip(hypotheses, group, strict=True)] for group in (whole, parts)
    )
    return believed(np.array(of_all), np.array(of_part)).max(0)


def _in_fitted(
    noise: NoiseModel, hypotheses: Sequence[Hypothesis], fitted: Sequence[Fitted]
) -> list[list[tuple[Alternative, np.ndarray]]]:
    """Of every hypothesis: its alternatives in the data that it is fitted to, and their directions among all."""
    found: list[list[tuple[Alternative, np.ndarray]]] = [[] for _ in hypotheses]
    for part in {id(one): one for one in fitted}.values():
        places = [place for place, one in enumerate(fitted) if one is part]
        tried = Alternative.of_all(part.noise, [part.of(hypotheses[place]) for place in places])
        flat = [one.axes for own in tried for one in own]
        ends = np.cumsum([axes.shape[1] for axes in flat])[:-1]
        seen = iter(np.split(part.among_all(noise, np.concatenate(flat, axis=1)), ends, axis=1))
        for place, own in zip(places, tried, strict=True):
            found[place] = [(one, next(seen)) for one in own]
    return found
