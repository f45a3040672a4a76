"""Residuals in units of a noise that replicates show: what hypotheses are compared in, of effects as of laws."""

from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import Effort, Fit
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.noise import NoiseModel

Prior = tuple[np.ndarray, np.ndarray]
WIDEST = 0.5
"""Of the standard deviation of an unknown's prior: how far points are away at most that a line is fitted to."""


class StandardisedObjective:
    """Standardised residual of a model in the entries of a mask, then how far each unknown is from the mean of its
    prior in standard deviations, then the residual itself in all U usable entries, which no fit minimises [(D + K +
    U,)], as a function of free coordinates [(K,)]; raises SimulationError.

    Args:
        problem, model: what is compared.
        mask: entries that are [(R, F, 11), bool].
        noise: of them.
        prior: means and standard deviations of the unknowns [(K,), (K,)]; None: :func:`~.base_fit.priors`.

    Attributes:
        rows: those that a fit minimises [(D + K + U,), bool]
    """

    def __init__(self, problem: Problem, model: Model, mask: np.ndarray, noise: NoiseModel, prior: Prior | None = None):
        self.model, self.noise, self._usable = model, noise, problem.usable
        self.prior = self.mean, self.deviation = prior or priors(problem, model)
        self._residual, self._inside = problem.residual_of(model, problem.usable), mask[problem.usable]
        minimised = self._inside.sum() + len(self.mean)
        self.rows = np.arange(minimised + len(self._inside)) < minimised

    def effort(self, iterations: int) -> Effort:
        """Of a fit that ends with a line through the residual, as wide as the unknowns are known."""
        return Effort(iterations, widest=WIDEST * self.deviation)

    def __call__(self, free: np.ndarray) -> np.ndarray:
        self.model.restart()  # so that it does not depend on which points were unstable before
        return self.rows_of(self._residual(free), free)

    def rows_of(self, residual: np.ndarray, free: np.ndarray) -> np.ndarray:
        """The function at free coordinates [(K,)] where the residual in all usable entries is [pixels, (U,)]."""
        standardised = self.noise.whiten_residual(residual[self._inside])
        return np.concatenate((standardised, (free - self.mean) / self.deviation, residual))

    def derivative(self, changes: np.ndarray) -> np.ndarray:
        """Of the function, where that of the residual is [(R, F, 11, K)]; NaN counts as none."""
        found = np.nan_to_num(changes[self._usable])
        return np.concatenate((self.noise.whiten(found[self._inside]), np.diag(1 / self.deviation), found))

    def standardised(self, found: Fit) -> np.ndarray:
        """Change of the standardised residual by one prior standard deviation of every unknown at a fit [(D, K)]."""
        assert found.jacobian is not None
        return found.jacobian[: self._inside.sum()] * self.deviation

    def seen(self, found: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Residual at a fit and its derivative [(R, F, 11), (R, F, 11, K)]; NaN where not usable."""
        assert found.jacobian is not None
        return spread(found.residual[~self.rows], self._usable), spread(found.jacobian[~self.rows], self._usable)


class Held:
    """An objective of the coordinates at ``places``, all others held where ``full`` has them [(K,)]; other processes
    get a copy.
    """

    def __init__(self, objective: StandardisedObjective, full: np.ndarray, places: Sequence[int]):
        self.objective, self.full, self.places = objective, full, list(places)

    def all(self, some: np.ndarray) -> np.ndarray:
        """All coordinates [(K,)]"""
        found = self.full.copy()
        found[self.places] = some
        return found

    def __call__(self, some: np.ndarray) -> np.ndarray:
        """Rows of the objective. Raises SimulationError."""
        return self.objective(self.all(some))


def noise_of(
    problem: Problem, residuals: np.ndarray, sensor: np.ndarray, mask: np.ndarray, known: np.ndarray | None = None
) -> NoiseModel:
    """The noise model in the entries of a mask [(R, F, 11), bool], as part of that of all usable ones, from replicates
    [(T, R, F, 11)], the sensor noise in them [(R, F, 11)] and, where there are any, errors that are known beforehand
    [(D, M)].
    """
    usable, (own, shared) = problem.usable, problem.noise_parts(sensor)
    found = np.nan_to_num(residuals[:, usable])
    whole = NoiseModel.from_replicates(found, own[usable], problem.layout(usable), shared_sigma=shared[usable])
    part = whole.among(mask[usable])
    return part if known is None else part.with_directions(known)


def spread(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Entries of a mask [(D, ...)] in their places [(R, F, 11, ...)], NaN elsewhere."""
    whole = np.full((*mask.shape, *values.shape[1:]), np.nan)
    whole[mask] = values
    return whole
