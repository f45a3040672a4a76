"""Fit the model as it is, and learn what its residual may be where nothing is missing."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy.stats import norm

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.base_fit import EXPLAINED, base_fit, notes
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import CLOSE, Effort, Fit, fit
from pacnerf_lpo.identification.model_errors import ModelErrors
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.standardised import Prior, StandardisedObjective
from pacnerf_lpo.inference.checks import Check, check_fitted, check_held_out
from pacnerf_lpo.inference.intervals import Interval, disagreement, posterior_intervals, spread_along
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.mpm.effects.base import Effect

WHITENED_ITERATIONS = 24
"""Of a fit that another one follows."""
BENT = 1.0
"""Prior standard deviations by which an unknown has moved far; so far it goes by itself in one of three recordings."""
CONFIDENCE = 0.9
"""Of all intervals."""


@dataclass(frozen=True)
class Error:
    """By how much the mean square of a standardised residual exceeds that of the replicates.

    held, fitted: in the held-out entries, 0 where there are none, and in the fitted ones.
    """

    held: float
    fitted: float


@dataclass(frozen=True)
class Comparison:
    """A fitted model and the measurements.

    names: of the model's unknowns.
    free: their free coordinates at the best fit [(K,)]
    known: every value there [SI]
    mean, deviation: of the unknowns' priors, in free coordinates [(K,)]
    cost: sum of squares of the standardised residual and of the priors' terms in the fitted entries.
    residual: measured minus predicted [pixels, (R, F, 11)]; NaN where not usable
    jacobian: change of the residual by the unknowns [(R, F, 11, K)]
    errors: what it may get wrong where nothing is missing.
    notes: sentences about estimates at a bound or far from what was expected.
    rollouts: simulations that it took.
    fitted: entries that it is fitted to [(R, F, 11), bool]
    dispersion: of the unknowns, in units of their variances: by how far they have moved then, at least 1.
    """

    names: tuple[str, ...]
    free: np.ndarray
    known: dict[str, float]
    mean: np.ndarray
    deviation: np.ndarray
    cost: float
    residual: np.ndarray
    jacobian: np.ndarray
    errors: ModelErrors
    notes: tuple[str, ...]
    rollouts: int
    fitted: np.ndarray
    dispersion: float = 1.0

    @staticmethod
    def at(
        model: Model,
        free: np.ndarray,
        prior: Prior,
        seen: tuple[np.ndarray, np.ndarray],
        errors: ModelErrors,
        fitted: np.ndarray,
        notes: tuple[str, ...] = (),
    ) -> "Comparison":
        """A model at free coordinates [(K,)], with its residual and jacobian as ``seen``."""
        return Comparison(model.names, free, model.physical(free), *prior, 0.0, *seen, errors, notes, 0, fitted)

    def noise(self, problem: Problem, mask: np.ndarray) -> NoiseModel:
        """Of the entries of a mask [(R, F, 11), bool], with the discrepancies that every model has."""
        return self.errors.noise(problem, mask)

    def changes(self, mask: np.ndarray) -> np.ndarray:
        """Of the residual in the entries of a mask, by one prior standard deviation of each unknown [(D, K)]."""
        return np.nan_to_num(self.jacobian[mask]) * self.deviation

    @property
    def at_priors(self) -> tuple[np.ndarray, np.ndarray]:
        """The residual where all unknowns have the means of their priors, by its slopes [pixels, (R, F, 11)], and its
        changes by one prior standard deviation of each [(R, F, 11, K)].
        """
        return self.residual - self.jacobian @ (self.free - self.mean), self.jacobian * self.deviation

    def error_scales(self, problem: Problem) -> np.ndarray:
        """Factor on the standard deviation of each unknown, at least 1, by what left-out replicates, the residual and
        the data that were held out show [(K,)].
        """
        mask = self.fitted
        found = spread_along(self.noise(problem, mask), self.residual[mask], self.changes(mask))
        return found * np.sqrt(self.dispersion)

    def marginal(self, problem: Problem, mask: np.ndarray) -> NoiseModel:
        """The same with the unknowns of the model, which move with their priors."""
        return self.noise(problem, mask).with_directions(self.changes(mask))

    def checks(self, problem: Problem) -> tuple[Check, Check]:
        """Whether the residual is what the model predicts: in the fitted entries, and in the held-out ones."""
        fitted, usable = self.fitted, problem.usable
        whole = self.marginal(problem, usable)
        found = check_fitted(whole.among(fitted[usable]), self.residual[fitted])
        return found, check_held_out(whole, self.residual[usable], fitted[usable])

    def excess(self, problem: Problem, residuals: Sequence[np.ndarray]) -> tuple[Error, ...]:
        """Of residuals of this and of other models [(R, F, 11) each], in units of the noise of this one."""

        def of(mask: np.ndarray) -> list[float]:
            if not mask.any():
                return [0.0] * len(residuals)
            noise = self.noise(problem, mask)
            return [check_fitted(noise, np.nan_to_num(residual[mask])).excess for residual in residuals]

        return tuple(map(Error, of(problem.usable & ~problem.fitted), of(problem.fitted)))


def compare(
    problem: Problem,
    effects: Sequence[Effect],
    known: dict[str, float],
    settings: tuple[int, int],
    searched: bool,
    progress: Progress,
    others: Sequence[dict[str, float]] = (),
) -> Comparison:
    """Fit material, effects and velocity to the fitted views and frames; simulate replicates at the best fit.

    First with the same weight for all silhouette moments, then standardised by the noise that the replicates show, and
    once more with errors of the shape as large as the recording shows them there, and with what the solver may get
    wrong there: an effect is believed for what is left of it beside that, so the two have to be of the same motion. If
    the standardised fit moves far from where errors were simulated, they are simulated again.

    Args:
        known: values to start from [SI].
        settings: number of replicates, and their seed.
        searched: whether the whole parameter space is searched first; else the fit starts from ``known``, and it is
            searched where the best fit leaves far more than the errors of the model.
        others: values to start from, too; the fit goes on from whichever start explains the standardised data best.

    Raises:
        SimulationError: the motion is unstable at every start.
    """
    model, rollouts = problem.model(effects, known), 0
    free = model.start
    if searched:
        base = base_fit(problem, effects, known, progress, followed=True)
        model, free, rollouts = base.model, base.free, base.rollouts
    errors = ModelErrors.learn(problem, effects, model, free, settings, progress)
    rough = partial(standardised, problem, model, changes=None, errors=errors, progress=progress, how="rough")
    begun = [rough(free)]
    for values in others:
        with suppress(SimulationError):  # there is another start
            begun.append(rough(problem.model(effects, values).start))
    if not searched and min(found.cost for found in begun) > EXPLAINED * begun[0].fitted.sum():
        progress("nothing explains the outlines yet; searching the whole parameter space")
        with suppress(SimulationError):
            base = base_fit(problem, effects, known, progress, followed=True)
            begun.append(rough(base.free))
            rollouts += base.rollouts
    first = min(begun, key=lambda found: found.cost)
    rollouts += sum(found.rollouts for found in begun) - first.rollouts
    if np.any(np.abs(first.free - free) > BENT * first.deviation):
        progress("the fit has moved far; errors are learnt again where it is")
        rollouts += errors.simulations + first.rollouts
        errors = ModelErrors.learn(problem, effects, model, first.free, settings, progress)
        first = standardised(problem, model, first.free, first.jacobian, errors, progress, "rough")
    progress("errors of resolution and dissipation there")
    errors = errors.solver_at(problem, model, first.free).sized(problem, *first.at_priors, first.fitted)
    comparison = standardised(problem, model, first.free, first.jacobian, errors, progress)
    simulated = errors.simulations + errors.solver.shape[-1] + rollouts + first.rollouts
    return replace(comparison, rollouts=comparison.rollouts + simulated)


def standardised(
    problem: Problem,
    model: Model,
    free: np.ndarray,
    changes: np.ndarray | None,
    errors: ModelErrors,
    progress: Progress,
    how: Literal["", "rough", "whole"] = "",
    prior: Prior | None = None,
) -> Comparison:
    """A model fitted from free coordinates [(K,)], standardised by its errors; ``changes`` of the residual by the
    unknowns there [(R, F, 11, K)], where they are known; rough: another fit follows; whole: to all data.
    """
    mask = problem.usable if how == "whole" else problem.fitted_with(model.effects)
    objective = StandardisedObjective(problem, model, mask, errors.noise(problem, mask), prior)
    start = free if changes is None else Fit(free, objective(free), objective.derivative(changes), 1, objective)
    report = reporter(model, progress)
    effort = Effort(WHITENED_ITERATIONS, confirm=False) if how == "rough" else objective.effort(WHITENED_ITERATIONS)
    best = fit(objective, start, model.scales, model.bounds, effort, report, objective.rows)
    doubts, cost = tuple(notes(model, best.free, *objective.prior)), best.cost_of(objective.rows)
    found = Comparison.at(model, best.free, objective.prior, objective.seen(best), errors, mask, doubts)
    return replace(found, cost=cost, rollouts=best.rollouts)


def estimate(problem: Problem, effects: Sequence[Effect], comparison: Comparison, progress: Progress) -> Comparison:
    """A model fitted to all data, from where it was fitted to those that are not held out: all of them may tell apart
    what these cannot. For its values and intervals alone, once it is decided which model that is: it holds nothing out.
    How far the values move tells how well the intervals know how wrong they may be.
    """
    model = problem.model(effects, comparison.known)
    at = comparison.free, comparison.jacobian, comparison.errors
    found = standardised(problem, model, *at, progress, "whole")
    noise, along = found.noise(problem, problem.usable), found.error_scales(problem)
    fitted, changes = comparison.fitted[problem.usable], found.changes(problem.usable) / along
    shift = (found.free - comparison.free) / found.deviation
    moved = disagreement(shift, noise.among(fitted).whiten(changes[fitted]), noise.whiten(changes), CLOSE)
    return replace(found, dispersion=moved)


def intervals(problem: Problem, effects: Sequence[Effect], comparison: Comparison) -> tuple[list[Interval], list[str]]:
    """90 % intervals of every unknown [SI], and what the recording does not determine, in words."""
    mask, model = comparison.fitted, problem.model(effects, comparison.known)
    noise, along = comparison.noise(problem, mask), comparison.error_scales(problem)
    rows = noise.whiten(comparison.changes(mask))
    return intervals_in_si(model, comparison.free, comparison.deviation, rows, along, noise)


@dataclass(frozen=True)
class SolverError:
    """What the discretisation does to an unknown [SI].

    shift: how far it would be from where it is in another solver, one standard deviation.
    low, high: ends of the 90 % interval with that error.
    """

    shift: float
    low: float
    high: float

    def as_json(self) -> dict[str, Any]:
        """As results have it, beside an interval of the solver as it is."""
        return {"solver": self.shift, "with_solver": [self.low, self.high]}


def solver_errors(
    problem: Problem, effects: Sequence[Effect], comparison: Comparison, found: Sequence[Interval]
) -> dict[str, SolverError]:
    """How far each unknown would be from where it is, by name, if the recording came from a coarser grid, from more
    steps, from a solver with more viscosity of its own or with the other errors of
    :func:`~pacnerf_lpo.identification.shape_errors.discretisation_errors`: the root of the sum of the squares. And its
    interval with that error, half the width of which is the root of the sum of the squares of both halves; how large
    errors of the solver are is presumed, and not learnt from a few replicates, so they are normal.

    An interval alone is of the solver as it is: where data show that the recording has not all that another grid
    changes, its stiffness may still be that of another grid. The change of an estimate with the discretisation is the
    usual measure of that error, and independent errors add by their squares (ASME V&V 20, 2009). ``found`` are the
    intervals from :func:`intervals`.
    """
    mask, model = comparison.fitted, problem.model(effects, comparison.known)
    noise = comparison.errors.but_of_solver.noise(problem, mask)
    rows = noise.whiten(comparison.changes(mask))
    targets = noise.whiten(np.nan_to_num(comparison.errors.solver[mask]))
    covariance = np.linalg.inv(rows.T @ rows + np.eye(rows.shape[1]))  # in units of the priors
    moved = covariance @ rows.T @ targets * comparison.deviation[:, None]
    quantile = float(norm.ppf(0.5 + CONFIDENCE / 2))
    own, (lowest, highest), errors = {interval.name: interval for interval in found}, model.bounds, {}
    for index, (parameter, step) in enumerate(zip(model.unknowns, np.linalg.norm(moved, axis=1), strict=True)):
        free, to_free, physical = comparison.free[index], parameter.transform.to_free, parameter.physical
        ends = [to_free(end) for end in (own[parameter.name].low, own[parameter.name].high)]
        half = math.hypot(max(abs(end - free) for end in ends), quantile * step)
        low, high = (physical(float(np.clip(free + side * half, lowest[index], highest[index]))) for side in (-1, 1))
        shift = (physical(free + step) - physical(free - step)) / 2
        errors[parameter.name] = SolverError(shift, low, high)
    return errors


def intervals_in_si(
    model: Model,
    free: np.ndarray,
    deviation: np.ndarray,
    jacobian: np.ndarray,
    along: np.ndarray | float,
    noise: NoiseModel,
    places: Sequence[int] | None = None,
) -> tuple[list[Interval], list[str]]:
    """Posterior intervals of unknowns of a fitted model [SI], and what is not determined, in words.

    Args:
        model: whose unknowns they are.
        free, deviation: coordinates at the fit, standard deviations of their priors [(K,)]
        jacobian: change of the standardised residual by one prior standard deviation of each [(D, K)]
        along: dispersion of the residual along each [(K,)]
        noise: of the fitted entries.
        places: of the K among all unknowns; None: they are all.
    """
    names = model.names if places is None else [model.names[place] for place in places]
    dof = len(noise.replicates) - 1
    found, unknown = posterior_intervals(jacobian, along, free.tolist(), names, deviation.tolist(), CONFIDENCE, dof)
    return [in_si(model, interval) for interval in found], unknown


def in_si(model: Model, interval: Interval) -> Interval:
    """An interval of a free coordinate in SI units, within the bounds of the parameter."""
    index = model.names.index(interval.name)
    inside = np.clip((interval.value, interval.low, interval.high), model.bounds[0][index], model.bounds[1][index])
    physical = model.unknowns[index].physical
    value, low, high = map(physical, inside)
    error = (physical(interval.value + interval.error) - physical(interval.value - interval.error)) / 2
    return Interval(interval.name, value, low, high, error, interval.identifiable)


def reporter(model: Model, progress: Progress) -> Callable[[int, float, np.ndarray], None]:
    """Tells iteration, cost and the parameters with their units."""

    def report(iteration: int, cost: float, free: np.ndarray) -> None:
        values = model.physical(free)
        shown = ", ".join(f"{p.name} {p.show(values[p.name])}" for p in model.unknowns)
        progress(f"iteration {iteration}: cost {cost:.4g}, {shown}")

    return report
