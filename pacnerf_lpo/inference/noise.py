"""The error of a comparison where the physics is right: bias and covariance of the residual, learnt from replicates.

A replicate is the residual of data simulated from the fitted null model itself, by a finer grid, with other particle
seeds, a perturbed geometry and fresh sensor noise. There are T of them, 8 to 24, and D >> T entries, so that the sample
covariance alone is singular, and far too small along directions that the replicates did not happen to take. It is
shrunk towards a target without cross-talk between views or kinds (Ledoit and Wolf 2004, with a structured target):

    C = S S^T + c c^T + a G K G + (1 - a) X^T X / (T - 1) + B B^T,    K = rho^|frame - frame'|,

S S^T within one view and frame, c c^T within one view, K within one view and kind: S the sensor noise, which an edge
has in common with the centroid, c that of the frame to which all others of the view are relative, G^2 what else the
replicates vary, smoothed over neighbouring frames and shared between views, X the replicates' deviations with the
sensor noise filtered out, a the shrinkage that makes a left-out replicate most likely, and B the directions of errors
that are known beforehand, each of one standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from scipy.sparse.csgraph import connected_components

from pacnerf_lpo.inference.layout import Layout

LEAST_REPLICATES = 4
SHRINKAGES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9)
LARGEST_CORRELATION = 0.98
WINDOW = 2
"""Variances are averaged over this many frames to either side: errors of a simulation change slowly, and five frames
are seen five times as often as one."""
SHARING = 8.0
"""Number of replicates at which an entry's own variance and that of the same kind in all views weigh the same: the own
one is known to half of itself then."""


@dataclass(frozen=True)
class Series:
    """The entries of a layout as S series, one for every view and group of kinds that have noise in common, with L
    entries each: the kinds one after the other, each in the order of its frames.

    Block-diagonal matrices are (S, L, L). Short series are padded with entries that read 0, or ``fill``.
    index: number of the entry, D where padded (S, L)
    gap: distance in frames of two entries of one kind, infinite between kinds (S, L, L)
    together: whether two entries are of one frame (S, L, L)
    instant: the same number for entries of one frame and kind, whatever the view (D,)
    """

    index: np.ndarray
    gap: np.ndarray
    together: np.ndarray
    instant: np.ndarray

    @staticmethod
    def of(layout: Layout, *roots: np.ndarray) -> Series:
        """Sort the entries of a layout; kinds have noise in common where their entries in a root (D, Q) have columns in
        common.
        """
        kinds, kind = np.unique(layout.kind, return_inverse=True)
        frames, frame = np.unique(layout.frame, return_inverse=True)
        moved = np.concatenate(roots, axis=1) != 0
        of_kinds = np.stack([moved[kind == number].any(0) for number in range(len(kinds))]).astype(float)
        group = connected_components(of_kinds @ of_kinds.T)[1][kind]
        names = [f"{view} {number}" for view, number in zip(layout.view, group, strict=True)]
        _, view, sizes = np.unique(names, return_inverse=True, return_counts=True)
        index = np.full((len(sizes), sizes.max()), len(layout))
        index[np.arange(sizes.max()) < sizes[:, None]] = np.lexsort((frame, kind, view))
        place, time = np.append(kind, len(kinds))[index], np.append(frames, 0.0)[np.append(frame, len(frames))[index]]
        gap = np.where(place[:, :, None] == place[:, None], np.abs(time[:, :, None] - time[:, None]), np.inf)
        instant = np.unique(kind * len(frames) + frame, return_inverse=True)[1]
        return Series(index, gap, time[:, :, None] == time[:, None], instant)

    def gather(self, values: np.ndarray, fill: float = 0.0) -> np.ndarray:
        """Values (D, ...) by series (S, L, ...)."""
        return np.concatenate((values, np.full((1, *values.shape[1:]), fill)))[self.index]

    def scatter(self, values: np.ndarray) -> np.ndarray:
        """Values by series (S, L, ...) in the order of the entries (D, ...)."""
        result = np.empty((len(self.instant) + 1, *values.shape[2:]))
        result[self.index] = values
        return result[:-1]

    def among(self, rows: np.ndarray, blocks: np.ndarray) -> tuple[Series, np.ndarray]:
        """The same of some of the entries [(D,), bool], and what is left of a block-diagonal matrix (S, L, L), which is
        1 where padded.
        """
        numbers = np.append(np.where(rows, np.cumsum(rows) - 1, rows.sum()), rows.sum())
        index = numbers[self.index]
        inside = index < rows.sum()
        kept = inside.any(1)
        left = np.where(inside[:, :, None] & inside[:, None], blocks, np.eye(index.shape[1]))
        return Series(index[kept], self.gap[kept], self.together[kept], self.instant[rows]), left[kept]

    def multiply(self, blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        """A block-diagonal matrix (S, L, L) times vectors (D,) or (D, m)."""
        columns = vectors if vectors.ndim == 2 else vectors[:, None]
        return self.scatter(blocks @ self.gather(columns)).reshape(vectors.shape)


@dataclass(frozen=True)
class Learnt:
    """What replicates have shown of the noise of all entries, before known errors.

    replicates: residuals of simulated nulls (T, D)
    sensor: S S^T + c c^T, by series
    series: the entries as courses in time
    shrinkage: weight a of the structured target
    correlation: rho of neighbouring frames
    """

    replicates: np.ndarray = field(repr=False)
    sensor: np.ndarray = field(repr=False)
    series: Series = field(repr=False)
    shrinkage: float
    correlation: float

    @cached_property
    def parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean (D,), S S^T + c c^T + a G K G by series (S, L, L), and the other directions in which the replicates
        deviate (D, T).
        """
        mean = self.replicates.mean(0)
        deviations = (self.replicates - mean).T
        target = _target(_numerical_spread(deviations, self.sensor, self.series), self.correlation, self.series)
        smooth = _filtered(deviations, target, self.sensor, self.series)
        shown = smooth * np.sqrt((1 - self.shrinkage) / (len(self.replicates) - 1))
        return mean, self.sensor + self.shrinkage * target, shown

    @cached_property
    def left_out(self) -> list[Learnt]:
        """The same without one of the replicates each (T)."""
        kept = [np.delete(self.replicates, index, axis=0) for index in range(len(self.replicates))]
        return [replace(self, replicates=others) for others in kept]

    def __getstate__(self) -> dict:
        """Other processes get what it is made of, and not what was made of it: that is a hundred times as much."""
        return {one.name: getattr(self, one.name) for one in fields(self)}


@dataclass(frozen=True)
class NoiseModel:
    """Mean and covariance of the residual under the null model, in all entries or in some of them.

    learnt: what it was learnt from, of all entries
    rows: which of all entries [(D',), bool]; D of them are
    mean: the model's numerical bias (D,)
    directions: B, one column for each known error (D, M)
    series: the entries as courses in time
    whitener: L^-1 with S S^T + c c^T + a G K G = L L^T, by series
    basis, weights: orthonormal (D, q) and (q,): L^-1 C L^-T = I + basis diag(weights^2) basis^T
    """

    learnt: Learnt
    rows: np.ndarray = field(repr=False)
    mean: np.ndarray
    directions: np.ndarray = field(repr=False)
    series: Series = field(repr=False)
    whitener: np.ndarray = field(repr=False)
    basis: np.ndarray = field(repr=False)
    weights: np.ndarray = field(repr=False)

    @classmethod
    def from_replicates(
        cls,
        replicates: np.ndarray,
        sensor_sigma: np.ndarray,
        layout: Layout,
        directions: np.ndarray | None = None,
        shared_sigma: np.ndarray | None = None,
    ) -> NoiseModel:
        """Learn bias and covariance.

        Args:
            replicates: residuals of simulated nulls, sensor noise included (T, D), T >= 4
            sensor_sigma: standard deviation of the sensor noise (D,), or S, a root of the covariance that entries of
                one view and frame have by it (D, Q)
            layout: view, frame and kind of every entry
            directions: changes of the residual by errors known beforehand, of one standard deviation each (D, M)
            shared_sigma: c, that of noise which all entries of one view have in common, with its sign (D,), or a root
                of the covariance that they have by it (D, Q')

        Raises:
            ValueError: shapes do not agree, fewer than four replicates, values not finite, or a noise that vanishes.
        """
        replicates, own = np.asarray(replicates, float), np.asarray(sensor_sigma, float)
        own = own[:, None] * np.eye(len(own)) if own.ndim == 1 else own
        shared = np.zeros_like(own[:, 0]) if shared_sigma is None else np.asarray(shared_sigma, float)
        shared = shared.reshape(len(shared), -1)
        _check(replicates, own, shared, layout)
        series, deviations = Series.of(layout, own, shared), (replicates - replicates.mean(0)).T
        sensor = _sensor(own, shared, series)
        spread = _numerical_spread(deviations, sensor, series)
        correlation = _frame_correlation(deviations, spread, sensor, series)
        target = _target(spread, correlation, series)
        smooth = _filtered(deviations, target, sensor, series)
        likelihoods = [
            _left_out_likelihood(deviations, smooth, _whitener(sensor + a * target), series, a) for a in SHRINKAGES
        ]
        shrinkage = SHRINKAGES[int(np.argmax(likelihoods))]
        learnt, rows = Learnt(replicates, sensor, series, shrinkage, correlation), np.ones(len(own), bool)
        return cls._of(learnt, rows, np.zeros((len(own), 0)) if directions is None else directions)

    @classmethod
    def _of(cls, learnt: Learnt, rows: np.ndarray, directions: np.ndarray) -> NoiseModel:
        mean, blocks, shown = learnt.parts
        series = learnt.series
        if not rows.all():
            series, blocks = series.among(rows, blocks)
        whitener = _whitener(blocks)
        low_rank = series.multiply(whitener, np.concatenate((shown[rows], directions), axis=1))
        return cls(learnt, rows, mean[rows], directions, series, whitener, *_principal(low_rank))

    @property
    def replicates(self) -> np.ndarray:
        """What it was learnt from (T, D)."""
        return self.learnt.replicates[:, self.rows]

    def among(self, rows: np.ndarray) -> NoiseModel:
        """Of some of its entries [(D,), bool] as they are among all: their block of mean and covariance. Learnt of
        these entries alone, it would be another, and what a whole says beyond its part no conditional probability.
        """
        inside = self.rows.copy()
        inside[self.rows] = rows
        return self._of(self.learnt, inside, self.directions[rows])

    def whiten(self, changes: np.ndarray) -> np.ndarray:
        """Differences of residuals (D,) or (D, m) in units of the noise: W x, with W ((1 + 1/T) C) W^T = I.

        1/T is for the error of the mean that is subtracted from every residual.
        """
        scaled = self.series.multiply(self.whitener, changes)
        shorter = (1 / np.sqrt(1 + self.weights**2) - 1) * self.basis
        return (scaled + shorter @ (self.basis.T @ scaled)) / np.sqrt(1 + 1 / len(self.replicates))

    def whiten_residual(self, residual: np.ndarray) -> np.ndarray:
        """W (r - mean) (D,): standard normal where the null model holds."""
        return self.whiten(residual - self.mean)

    def square(self, residual: np.ndarray) -> float:
        """|W (r - mean)|^2: chi^2 where the null model holds."""
        left = self.whiten_residual(residual)
        return float(left @ left)

    def adjoint(self, values: np.ndarray) -> np.ndarray:
        """W^T x (D,) or (D, m)."""
        shorter = (1 / np.sqrt(1 + self.weights**2) - 1) * self.basis
        turned = values + shorter @ (self.basis.T @ values)
        return self.series.multiply(self.whitener.transpose(0, 2, 1), turned) / np.sqrt(1 + 1 / len(self.replicates))

    def inverse_adjoint(self, values: np.ndarray) -> np.ndarray:
        """W^-T x (D,) or (D, m)."""
        longer = (np.sqrt(1 + self.weights**2) - 1) * self.basis
        turned = self.series.multiply(np.linalg.inv(self.whitener).transpose(0, 2, 1), values)
        return (turned + longer @ (self.basis.T @ turned)) * np.sqrt(1 + 1 / len(self.replicates))

    def with_directions(self, changes: np.ndarray) -> NoiseModel:
        """The same with further known errors, one column for each of one standard deviation (D, M)."""
        shown, directions = self.learnt.parts[2][self.rows], np.concatenate((self.directions, changes), axis=1)
        found = _principal(self.series.multiply(self.whitener, np.concatenate((shown, directions), axis=1)))
        return replace(self, directions=directions, basis=found[0], weights=found[1])

    @cached_property
    def left_out(self) -> list[tuple[NoiseModel, np.ndarray]]:
        """For each replicate: the model learnt from the others (shrinkage and correlation kept), and itself (D,)."""
        return [
            (self._of(others, self.rows, self.directions), replicate)
            for others, replicate in zip(self.learnt.left_out, self.replicates, strict=True)
        ]


def _principal(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left singular vectors and singular values of columns (D, q), by the smaller of their two Gram matrices: values
    below 3e-8 of the largest are lost, and count for nothing next to the unit they are added to.
    """
    if columns.shape[1] > columns.shape[0]:
        basis, weights, _ = np.linalg.svd(columns, full_matrices=False)
        return basis, weights
    squares, turn = np.linalg.eigh(columns.T @ columns)
    kept = squares > 1e-15 * max(float(squares[-1]), 1e-300)
    weights = np.sqrt(squares[kept])
    return columns @ turn[:, kept] / weights, weights


def _check(replicates: np.ndarray, own: np.ndarray, shared: np.ndarray, layout: Layout) -> None:
    if replicates.ndim != 2 or len(replicates) < LEAST_REPLICATES:
        raise ValueError(
            f"replicates have shape {replicates.shape}; at least {LEAST_REPLICATES} residual vectors are needed"
        )
    arrays = {
        "sensor_sigma": own[:, 0],
        "shared_sigma": shared[:, 0],
        "layout.view": layout.view,
        "layout.frame": layout.frame,
    }
    for name, array in arrays.items():
        if np.shape(array) != replicates.shape[1:]:
            raise ValueError(
                f"{name} has shape {np.shape(array)}, but the replicates have {replicates.shape[1]} entries"
            )
    noise = (own**2).sum(1) + (shared**2).sum(1)
    if not (np.isfinite(replicates).all() and np.isfinite(noise).all() and (noise > 0).all()):
        raise ValueError("replicates and noise must be finite, and every entry must have a noise")


def _sensor(own: np.ndarray, shared: np.ndarray, series: Series) -> np.ndarray:
    """S S^T + c c^T, by series (S, L, L), with S (D, Q) and c (D, Q')."""
    alone, common = series.gather(own), series.gather(shared)
    padded = (series.index == len(own))[:, None] * np.eye(series.index.shape[1])
    found = series.together * (alone @ alone.transpose(0, 2, 1)) + common @ common.transpose(0, 2, 1)
    return np.where(padded, 1.0, found)


def _numerical_spread(deviations: np.ndarray, sensor: np.ndarray, series: Series) -> np.ndarray:
    """G (D,): root of the replicates' variance less the sensor's, averaged over neighbouring frames and over views."""
    count = deviations.shape[1]
    excess = (deviations**2).sum(1) / (count - 1) - series.scatter(np.diagonal(sensor, axis1=1, axis2=2))
    near = (series.gap <= WINDOW) * series.gather(np.ones_like(excess))[:, None]
    smooth = series.multiply(near / np.maximum(near.sum(2, keepdims=True), 1), excess)
    shared = (np.bincount(series.instant, smooth) / np.bincount(series.instant))[series.instant]
    own = count / (count + SHARING)
    return np.sqrt(np.maximum(own * smooth + (1 - own) * shared, 0.0))


def _frame_correlation(deviations: np.ndarray, spread: np.ndarray, sensor: np.ndarray, series: Series) -> float:
    """Correlation of the numerical error between neighbouring frames; sensor noise does not contribute."""
    courses, spreads = series.gather(deviations), series.gather(spread)
    same = np.isfinite(np.diagonal(series.gap, 1, axis1=1, axis2=2))  # kind
    product = (courses[:, :-1] * courses[:, 1:])[same].sum() / (deviations.shape[1] - 1)
    product -= np.diagonal(sensor, 1, axis1=1, axis2=2)[same].sum()
    scale = (spreads[:, :-1] * spreads[:, 1:])[same].sum()
    return float(np.clip(product / scale, 0.0, LARGEST_CORRELATION)) if scale > 0 else 0.0


def _target(spread: np.ndarray, correlation: float, series: Series) -> np.ndarray:
    """G K G, by series (S, L, L)."""
    spreads = series.gather(spread)
    return correlation**series.gap * spreads[:, :, None] * spreads[:, None]


def _whitener(blocks: np.ndarray) -> np.ndarray:
    """L^-1 with L L^T = S^2 + c c^T + a G K G, by series (S, L, L)."""
    return np.linalg.inv(np.linalg.cholesky(blocks))


def _filtered(deviations: np.ndarray, target: np.ndarray, sensor: np.ndarray, series: Series) -> np.ndarray:
    """Wiener filter: the part of the deviations (D, T) that the target explains and the sensor noise does not."""
    gain = np.linalg.solve(sensor + target, target)
    return series.multiply(gain.transpose(0, 2, 1), deviations)


def _left_out_likelihood(
    deviations: np.ndarray, smooth: np.ndarray, whitener: np.ndarray, series: Series, shrinkage: float
) -> float:
    """Log-likelihood, up to a constant, of every replicate under mean and low-rank part of the others, summed; by the
    deviations of all from their mean, as they are and filtered (D, T), with the ``whitener`` of a ``shrinkage``.
    """
    whitened = series.multiply(whitener, np.concatenate((deviations, smooth), axis=1))
    gram, count = whitened.T @ whitened, deviations.shape[1]
    total = 2 * count * float(np.log(np.diagonal(whitener, axis1=1, axis2=2)).sum())
    for replicate in range(count):
        # From the mean of the others: replicate i deviates by x_i T/(T-1), replicate j by x_j + x_i/(T-1).
        others = np.delete(np.arange(count), replicate)
        mix = np.zeros((2 * count, count))
        mix[replicate, 0] = count / (count - 1)
        mix[count + others, np.arange(1, count)] = 1.0
        mix[count + replicate, 1:] = 1 / (count - 1)
        mix[:, 1:] *= np.sqrt((1 - shrinkage) / (count - 2))
        small = mix.T @ gram @ mix
        inner = np.eye(count - 1) + small[1:, 1:]
        square = small[0, 0] - small[0, 1:] @ np.linalg.solve(inner, small[1:, 0])
        total -= square * (count - 1) / count + np.linalg.slogdet(inner)[1]
    return total / 2
