"""What a fitted model may get wrong where nothing is missing: noise, errors of body and solver, a small force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.replicates import replicates
from pacnerf_lpo.identification.shape_errors import discretisation_errors, measuring_errors, shape_errors
from pacnerf_lpo.identification.smooth_force import contact_accelerations, force_changes
from pacnerf_lpo.identification.standardised import noise_of
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.inference.sizes import size_of_errors
from pacnerf_lpo.mpm.effects.base import Effect

FORCE = 0.02
"""Prior standard deviation of the unknown smooth force in every model [m/s^2]: a five-hundredth of gravity, which no
recording of a soft body is good enough to be believed about."""
CONTACT = 0.02
"""The same in units of the acceleration by contact: solvers agree about flight, and differ in how a body meets the
ground. Of videos of three bodies that other codes have simulated, 1.5 to 3 % are the most likely."""
FORCES = (0.3, 1.0, 3.0, 10.0)
"""Prior standard deviations of an unknown force, with equal probability [m/s^2]: from a breeze to the gravity."""
SHAPES = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Sizes of errors of the reconstruction, with equal probability, in units of what the outlines at frame 0 let expect.
Every model has some of up to one such unit; larger ones are a hypothesis, as a missing effect is."""


@dataclass(frozen=True)
class ModelErrors:
    """Changes of the residual by what may be wrong, learnt by simulations around a model.

    replicates: residuals of simulated nulls [(T, R, F, 11)]
    sensor: standard deviation of the sensor noise in them [(R, F, 11)]
    shape: by errors of the reconstructed body of unit size: as large as outlines at frame 0 let expect [(R, F, 11, M)]
    measuring: by errors of a measurement as a whole [(R, F, 11, M')]
    solver: by errors of resolution, dissipation and opacity, and the bias of a wrong shape [(R, F, 11, E)]
    force: by a smooth unknown force, per m/s^2 of each of its Q coefficients [(R, F, 11, Q)]
    contact: acceleration of the body by contact when each of them acts [m/s^2, (Q,)]
    bias: what a wrong shape changes on average [(R, F, 11)]
    size: of the errors of the shape, in units of ``shape``.
    """

    replicates: np.ndarray
    sensor: np.ndarray
    shape: np.ndarray
    measuring: np.ndarray
    solver: np.ndarray
    force: np.ndarray
    contact: np.ndarray
    bias: np.ndarray
    size: float = 1.0

    @staticmethod
    def learn(
        problem: Problem,
        effects: Sequence[Effect],
        model: Model,
        free: np.ndarray,
        settings: tuple[int, int],
        progress: Progress,
    ) -> ModelErrors:
        """By simulations around a model at free coordinates [(K,)]; ``settings``: number of replicates, and their seed.

        Raises:
            SimulationError: the motion is unstable on finer grids, or on the coarse one.
        """
        found, sensor, bias = replicates(problem, model, free, *settings, progress)
        shape, solver = shape_errors(problem, model, free, progress), discretisation_errors(problem, model, free, bias)
        at = problem, effects, model.physical(free)
        force = force_changes(*at, progress), contact_accelerations(*at)
        return ModelErrors(found, sensor, shape, measuring_errors(*at), solver, *force, bias)

    @property
    def simulations(self) -> int:
        """How many all of them took, but for two or three of each recording."""
        return self.shape.shape[-1] + self.solver.shape[-1] + self.force.shape[-1] + 2 * len(self.replicates)

    def solver_at(self, problem: Problem, model: Model, free: np.ndarray) -> ModelErrors:
        """The same with the errors of the solver where a fit has ended [(K,)]. Raises SimulationError."""
        return replace(self, solver=discretisation_errors(problem, model, free, self.bias))

    @property
    def known(self) -> np.ndarray:
        """All but the noise, one standard deviation each, without NaN [(R, F, 11, M'')]."""
        usual = np.hypot(FORCE, CONTACT * self.contact)
        parts = self.size * self.shape, self.measuring, self.solver, usual * self.force
        return np.nan_to_num(np.concatenate(parts, axis=-1))

    @property
    def reconstruction(self) -> np.ndarray:
        """Errors of what was reconstructed or measured, each of unit size, without NaN [(R, F, 11, M + M')]."""
        return np.nan_to_num(np.concatenate((self.shape, self.measuring), axis=-1))

    @property
    def but_of_solver(self) -> ModelErrors:
        """The same without errors of the solver."""
        return replace(self, solver=self.solver[..., :0])

    def noise(self, problem: Problem, mask: np.ndarray) -> NoiseModel:
        """Of the residual in the entries of a mask [(R, F, 11), bool], with all that may be wrong."""
        return noise_of(problem, self.replicates, self.sensor, mask, self.known[mask])

    def sized(self, problem: Problem, residual: np.ndarray, changes: np.ndarray, mask: np.ndarray) -> ModelErrors:
        """The same with errors of the shape, where there are any, as large as some entries show them.

        Args:
            residual: where all unknowns have the means of their priors [(R, F, 11)]
            changes: of it by one prior standard deviation of each unknown [(R, F, 11, K)]
            mask: entries that are fitted [(R, F, 11), bool]
        """
        if not self.shape.shape[-1]:
            return self
        noise = replace(self, size=0.0).noise(problem, mask).with_directions(np.nan_to_num(changes[mask]))
        shape, force = np.nan_to_num(self.shape[mask]), np.nan_to_num(self.force[mask])
        usual = [size for size in SHAPES if size <= 1]
        return replace(self, size=size_of_errors(noise, residual[mask], shape, usual, force, FORCES))
