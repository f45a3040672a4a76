"""Material, motion and shape fitted together, where the errors of a reconstruction are too large for straight lines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.least_squares import LONGEST_STEP, Effort, Fit, fit
from pacnerf_lpo.identification.problem import StateProblem
from pacnerf_lpo.identification.standardised import StandardisedObjective
from pacnerf_lpo.mpm.effects.base import Effect

ITERATIONS = 20
SCALE = 1 / LONGEST_STEP
"""Of an error of the shape in standard deviations: the first step changes none by more than one of them."""


@dataclass(eq=False)
class JointObjective:
    """Standardised residual, then how far each unknown and each error of the shape is from the mean of its prior in
    standard deviations [(D + K + M,)], as a function of free coordinates and errors [(K + M,)]; raises SimulationError.

    Args:
        problem: with the shape as it was reconstructed.
        effects, known: of its model, and the values it starts from [SI].
        objective: of that model, whose noise knows nothing of errors of the shape.
        mask: entries that are fitted [(R, F, 11), bool]
        sigma: how far the surface may be from the true one [m].
    """

    problem: StateProblem
    effects: Sequence[Effect]
    known: dict[str, float]
    objective: StandardisedObjective
    mask: np.ndarray
    sigma: float

    def __call__(self, both: np.ndarray) -> np.ndarray:
        free, numbers = np.split(both, [len(self.objective.mean)])
        problem = self.problem.reshaped(self.sigma, numbers)
        if not len(problem.body.positions):
            raise SimulationError(0, 0, "with this shape nothing is left of the body")
        residual = problem.residual_of(problem.model(self.effects, self.known), self.mask)(free)
        away = (free - self.objective.mean) / self.objective.deviation
        return np.concatenate((self.objective.noise.whiten_residual(residual), away, numbers))

    def fit(
        self,
        free: np.ndarray,
        numbers: np.ndarray,
        jacobian: np.ndarray,
        changes: np.ndarray,
        report: Callable[[int, float, np.ndarray], None],
    ) -> tuple[Fit, float]:
        """Where a fit from some coordinates [(K,)] and errors [(M,)] ends, and the cost at its start. The derivative of
        the residual by both [(R, F, 11, K), (R, F, 11, M)] is not measured again on the way, only updated.
        """
        model, whiten = self.objective.model, self.objective.noise.whiten
        moved, caused = (whiten(np.nan_to_num(columns[self.mask])) for columns in (jacobian, -changes))
        priors = np.diag(np.concatenate((1 / self.objective.deviation, np.ones_like(numbers))))
        both = np.concatenate((free, numbers))
        start = Fit(both, self(both), np.concatenate((np.concatenate((moved, caused), axis=1), priors)), 1, self)
        scales = np.concatenate((model.scales, np.full(len(numbers), SCALE)))
        free_of = np.full(len(numbers), np.inf)
        bounds = np.append(model.bounds[0], -free_of), np.append(model.bounds[1], free_of)

        effort = Effort(ITERATIONS, confirm=False, remeasured=0)
        found = fit(self, start, scales, bounds, effort, lambda k, cost, both: report(k, cost, both[: len(free)]))
        return found, start.cost
