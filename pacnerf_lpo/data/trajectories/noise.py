"""How large and how lasting the errors of measured positions are, from what no smooth force could do.

A track x(t) is a smooth path and an error. The path is that of an acceleration which changes evenly in time, a cubic;
what is left of x after the best such path is error: a white part, and one that lasts for some time, as that of a camera
in a hand, of a lens, or of a tracker which follows an edge. What lasts has a velocity, as whatever moves a camera or a
picture has one: its covariance is that of Matern with smoothness 3/2 (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, equation 4.17), under which the tracks of hand-held videos and of a motion capture with cameras
are more likely than under an exponential one. A rougher one takes too little of it for slow changes, which is what a
force looks like. Variances are those that make what is left most likely (restricted maximum likelihood, Patterson and
Thompson 1971), and so is the time, or the longest one that is about as likely. What a force bends more than a cubic
counts as error, so that noise is rather found too large than too small.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import polynomial
from scipy.optimize import minimize_scalar

ORDER = 3
"""Of the smooth path."""
LEAST_SIGMA = 1e-5
"""[m]"""
LEAST_FREE = 3
"""Samples more than smooth paths have coefficients: fewer show no noise."""
MOST_SHARE = 0.99
"""Of the variance that may last: something is always new in a sample, its last digit if nothing else."""
PLACES = 13
"""Times that errors may last, from that between two samples to half a track, evenly in their logarithm."""
OPEN = 1.0
"""Of times that a few tracks hardly separate, by twice the logarithm of their likelihoods (one standard error), the
longest is believed: too slow an error widens intervals, too fast a one makes a force of what is none."""


@dataclass(frozen=True)
class Noise:
    """Errors of one coordinate.

    white: standard deviation of the part that is new in every sample [m]
    slow: of the part that lasts [m];  lasting: for how long: its correlation falls to a half [s]
    """

    white: float
    slow: float
    lasting: float

    @property
    def size(self) -> float:
        """Standard deviation of both [m]."""
        return math.hypot(self.white, self.slow)

    def covariance(self, times: np.ndarray) -> np.ndarray:
        """[m^2, (F, F)] at some times [s, (F,)]."""
        return self.white**2 * np.eye(len(times)) + self.slow**2 * self._correlation(times)

    def slow_root(self, times: np.ndarray) -> np.ndarray:
        """A with A A^T = the covariance of the part that lasts [m, (F, F)]."""
        return self.slow * np.linalg.cholesky(self._correlation(times) + 1e-9 * np.eye(len(times)))

    def _correlation(self, times: np.ndarray) -> np.ndarray:
        """Of the part that lasts [(F, F)]."""
        gap = np.sqrt(3.0) * np.abs(times[:, None] - times) / self.lasting
        return (1 + gap) * np.exp(-gap)


def noise_of(tracks: Sequence[tuple[np.ndarray, np.ndarray]]) -> Noise:
    """Of one coordinate, from times [s, (F,)] and values [m, (F,)] of all recordings that were made in the same way: a
    few dozen samples alone say little of it. A track with fewer samples than a smooth path has coefficients says
    nothing; where all are such, noise counts as a millimetre.
    """
    usable = []
    for times, values in tracks:
        if len(times) > ORDER + 1:
            paths = polynomial.polyvander((times - times[0]) / (times[-1] - times[0]), ORDER)
            basis = np.linalg.svd(paths, full_matrices=True)[0][:, paths.shape[1] :]  # orthonormal, of what is no path
            usable.append((times, basis, basis.T @ values))
    free = sum(len(rest) for _, _, rest in usable)
    if free < LEAST_FREE:
        return Noise(1e-3, 0.0, 1.0)
    shortest = float(np.median(np.concatenate([np.diff(times) for times, _, _ in usable])))
    longest = float(np.median([times[-1] - times[0] for times, _, _ in usable])) / 2

    def lasting(place: float) -> float:
        return shortest * max(longest / shortest, 1.0) ** place

    def square(share: float, place: float) -> tuple[float, float]:
        """Of what is left in units of a total of one, and the logarithm of the determinant."""
        made, size, logarithm = Noise(np.sqrt(1 - share), np.sqrt(share), lasting(place)), 0.0, 0.0
        for times, basis, rest in usable:
            shape = basis.T @ made.covariance(times) @ basis
            size += float(rest @ np.linalg.solve(shape, rest))
            logarithm += float(np.linalg.slogdet(shape)[1])
        return size, logarithm

    def cost(share: float, place: float) -> float:
        """Twice the negative logarithm of the likelihood, at the most likely total."""
        size, logarithm = square(share, place)
        return free * float(np.log(max(size, 1e-300))) + logarithm

    places = np.linspace(0.0, 1.0, PLACES)
    settings: Any = {"bounds": (0.0, MOST_SHARE), "method": "bounded", "options": {"xatol": 3e-3}}
    tried = [minimize_scalar(cost, args=(place,), **settings) for place in places]
    least = min(one.fun for one in tried)
    place, share = max((place, one.x) for place, one in zip(places, tried, strict=True) if one.fun <= least + OPEN)
    total = float(np.sqrt(square(share, place)[0] / free))
    white, slow = (math.sqrt(part) * total for part in (1 - share, share))
    return Noise(max(white, LEAST_SIGMA), slow, float(lasting(place)))
