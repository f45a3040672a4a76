"""How noisy the sensor is, measured in the residual itself: what changes from frame to frame without a cause."""

import numpy as np
from scipy.stats import chi2

LEAST_ENTRIES = 30
"""From fewer the noise would be known to no better than a third, as it is without them."""
FACTORS = np.geomspace(0.1, 10.0, 93)
"""Tried, in steps of 5 %: a twentieth is finer than hundreds of entries can resolve."""
CLIPPED = 4.0
"""A square counts as so many variances at most (Huber 1964, proposal 2): it bends the estimate no more, and costs a
twentieth of what the data say."""


def sensor_scale(residual: np.ndarray, errors: np.ndarray, root: np.ndarray) -> float:
    """Factor on the presumed standard deviation of the sensor noise.

    A second difference in time of white noise has six times its variance, and hardly anything of a smooth motion. What
    the model itself errs by is smaller than the presumed noise in *quiet* entries: those before contact, as a rule. Of
    the frames that have such entries the first half counts, as what a model lacks grows with time, and a contact may
    come earlier than the model says. The factor is the one with which the clipped squares are on average as large as
    those of normal deviates. 1 where less than thirty entries are left.

    Args:
        residual: measured minus predicted [(V, F, K)], NaN where there is none, in frame 0 in a way of its own
        errors: of the model, as T replicates without sensor noise show them [(T, V, F, K)]
        root: of the presumed covariance of the K entries of a frame, invertible where it is finite [(V, F, K, K)]
    """
    count, bias, inverse = len(errors), errors.mean(0), np.linalg.pinv(np.nan_to_num(root[:, 2:-1]))
    numerical = (_fast(errors - bias, inverse) ** 2).sum(0) / (count - 1)
    numerical = np.broadcast_to(np.nan_to_num(numerical, nan=np.inf).mean(0), numerical.shape)
    squares = _fast(residual - bias, inverse) ** 2
    quiet = (numerical < 1) & np.isfinite(squares)
    frames = np.flatnonzero(quiet.any(axis=(0, 2)))
    quiet[:, frames[(len(frames) + 1) // 2 :]] = False
    if quiet.sum() < LEAST_ENTRIES:
        return 1.0
    ratios = squares[quiet] / ((1 + 1 / count) * numerical[quiet] + FACTORS[:, None] ** 2)
    expected = chi2.cdf(CLIPPED, 3) + CLIPPED * chi2.sf(CLIPPED, 1)
    return float(FACTORS[np.abs(np.log(np.minimum(ratios, CLIPPED).mean(1) / expected)).argmin()])


def _fast(values: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Second differences in time of values [(..., V, F, K)] after frame 0, in units of those of the noise, independent
    of each other in a frame; ``inverse`` of its root in the frames between [(V, F - 3, K, K)].
    """
    changes = np.diff(values[..., 1:, :], 2, axis=-2) / np.sqrt(6)
    return np.einsum("vfqk,...vfk->...vfq", inverse, changes)
