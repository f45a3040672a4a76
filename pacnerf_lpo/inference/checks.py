"""Is what is left of a residual what the model predicts? Posterior predictive checks against left-out replicates."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from pacnerf_lpo.inference.decision import half_log_volume
from pacnerf_lpo.inference.noise import NoiseModel


@dataclass(frozen=True)
class Check:
    """Size of a residual relative to what the model predicts.

    statistic: mean square of the standardised residual; about 1 where the model is right
    replicates: the same of every replicate under the noise model of the others (T,)
    p_value: probability of a residual as large where the model is right
    """

    statistic: float
    replicates: np.ndarray
    p_value: float

    @property
    def excess(self) -> float:
        """Mean square above that of the replicates."""
        return self.statistic - float(np.mean(self.replicates))

    @property
    def times_noise(self) -> float:
        """Mean square relative to that of the replicates."""
        return self.statistic / float(np.mean(self.replicates))


def check_fitted(noise: NoiseModel, residual: np.ndarray) -> Check:
    """Of the fitted entries: a residual, measured minus predicted (D,), and its noise, with the fitted parameters and
    the discrepancies among its directions.
    """
    return _check(noise.square(residual), [model.square(one) for model, one in noise.left_out], len(residual))


def check_held_out(whole: NoiseModel, residual: np.ndarray, fitted: np.ndarray) -> Check:
    """Of held-out entries, given the fitted ones: the square of a Gaussian's conditional deviation is the square of the
    whole less that of the part.

    Args:
        whole: noise of all entries, with the fitted parameters and the discrepancies among its directions
        residual: measured minus predicted, all entries (D,)
        fitted: which entries were fitted [(D,), bool]
    """

    def conditional(noise: NoiseModel, values: np.ndarray) -> float:
        return noise.square(values) - noise.among(fitted).square(values[fitted])

    replicates = [conditional(*left_out) for left_out in whole.left_out]
    return _check(conditional(whole, residual), replicates, len(residual) - int(fitted.sum()))


@dataclass(frozen=True)
class Prediction:
    """How well a model that was fitted to a part of the data predicts the others: together with the likelihood of that
    part, it is the likelihood of all data.

    cost: square of the standardised deviation of the held-out data, given the fitted ones
    occam: minus half the logarithm of how much wider the parameters' errors make their distribution
    """

    cost: float
    occam: float


def prediction(whole: NoiseModel, residual: np.ndarray, changes: np.ndarray, fitted: np.ndarray) -> Prediction:
    """Of held-out entries, given the fitted ones.

    Args:
        whole: noise of all entries, the discrepancies among its directions, the parameters not
        residual: measured minus predicted, all entries (D,)
        changes: of it by one prior standard deviation of every parameter (D, K)
        fitted: which entries were fitted [(D,), bool]
    """
    pairs = [
        (noise.with_directions(changes[rows]).square(residual[rows]), half_log_volume(noise.whiten(changes[rows])))
        for noise, rows in ((whole, np.ones_like(fitted)), (whole.among(fitted), fitted))
    ]
    return Prediction(pairs[0][0] - pairs[1][0], pairs[1][1] - pairs[0][1])


def _check(square: float, replicates: list[float], size: int) -> Check:
    """The logarithm of the statistic is compared with that of the left-out replicates by Student's t for one further
    draw. Its spread is not believed to be below that of chi^2 with as many degrees of freedom, nor its mean below that
    of the noise model: errors known beforehand may be larger than the replicates happen to have them.
    """
    squares, least = np.maximum(replicates, 1e-6 * size) / size, 1e-6
    logs, count = np.log(squares), len(replicates)
    spread = max(float(logs.std(ddof=1)), np.sqrt(2 / size))
    deviate = (np.log(max(square / size, least)) - max(logs.mean(), 0.0)) / spread / np.sqrt(1 + 1 / count)
    return Check(square / size, squares, float(student.sf(deviate, count - 1)))
