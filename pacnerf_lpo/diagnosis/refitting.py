"""Fit all parameters with one more effect, and score it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate, name_of
from pacnerf_lpo.diagnosis.comparison import BENT, Comparison, intervals_in_si, reporter, standardised
from pacnerf_lpo.diagnosis.screening import Screening
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.base_fit import base_fit, notes
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import Effort, Fit, column, fit, fit_or_none
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress, prefixed
from pacnerf_lpo.identification.standardised import StandardisedObjective
from pacnerf_lpo.inference.checks import Prediction, prediction
from pacnerf_lpo.inference.decision import (
    DECISIVE,
    LEVEL,
    Contender,
    believed,
    explains_most,
    log_bayes_factor,
    log_occam_factor,
    log_spread_factor,
)
from pacnerf_lpo.inference.evidence import Score
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.mpm.effects.base import Effect

ITERATIONS, QUICK = 24, Effort(8, confirm=False, remeasured=1)
How = Literal["quickly", "thoroughly", "searched", "beside"]
GIVE_UP = 1.2
"""A fit that is still so much worse than the best one after a few iterations is given up."""


@dataclass(frozen=True)
class Refit:
    """A model with one more effect, fitted.

    name: of the effect.
    known: every value [SI]
    intervals: of all unknowns [SI]
    residual: measured minus predicted [pixels, (R, F, 11)]
    cost_without, cost: sums of squares of the standardised residual and of the priors' terms in the fitted entries,
        without the effect at the best optimum known.
    log_bayes_factor: of the effect against the model without it, of all data.
    occam: logarithm of the part of the prior of the coefficients that the data leave.
    held_without, held: what the two predict of the held-out data.
    p_value: of the whole procedure.
    notes: sentences about estimates at a bound or far from what was expected.
    simulated: simulations that it took.
    sizes: numbers of the data that it is fitted to, and of all.
    better: values at which the model without the effect is decisively better than where it was fitted, found from where
        this fit ended [SI]; None: there are none, or the effect explains most of what that leaves, too.
    whole: logarithm of the Bayes factor of all data as it is, whether the fitted ones alone say anything for the effect
        or not.
    """

    name: str
    known: dict[str, float]
    intervals: list[Interval]
    residual: np.ndarray
    cost_without: float
    cost: float
    log_bayes_factor: float
    occam: float
    held_without: Prediction
    held: Prediction
    p_value: float
    notes: tuple[str, ...]
    simulated: int
    sizes: tuple[int, int]
    better: dict[str, float] | None = None
    whole: float = 0.0

    @property
    def contender(self) -> Contender:
        """As a decision sees it."""
        return Contender(self.name, self.cost + self.held.cost, self.occam + self.held.occam, self.p_value)

    def against(self, cost_without: float, held_without: Prediction, screening: Screening) -> Refit:
        """The same against another optimum of the model without the effect, and what that predicts."""
        scale, without = screening.scale(self.name), cost_without + held_without.cost
        occam = self.occam + self.held.occam - held_without.occam
        fitted = log_bayes_factor(cost_without, self.cost, self.sizes[0], self.occam, scale)
        whole = log_bayes_factor(without, self.cost + self.held.cost, self.sizes[1], occam, scale)
        factor = float(believed(whole, fitted))
        p_value = screening.p_value(factor)
        again = replace(self, cost_without=cost_without, held_without=held_without, whole=whole)
        return replace(again, log_bayes_factor=factor, p_value=p_value)


class Ahead(NamedTuple):
    """How far fits with other effects have come.

    cost: of the best; a fit that stays far above it is given up.
    known: values of the best model, where a fit begins first [SI]; None: nowhere. What a model without either effect
        had to bend, neither has to.
    """

    cost: float = np.inf
    known: dict[str, float] | None = None


def refit(
    problem: Problem,
    effects: Sequence[Effect],
    comparison: Comparison,
    candidate: Candidate,
    screening: Screening,
    progress: Progress,
    ahead: Ahead | None = None,
    how: How = "thoroughly",
) -> Refit | None:
    """Fit all parameters with the effect added, from one or more starts, and score it.

    A fault of a held-out camera is fitted in the fitted frames of all views. The model without the effect is fitted
    again from where the best of all ends: an optimum that it missed is no evidence for the effect.

    Args:
        problem, effects, comparison: the run, the effects of its model, and that model fitted.
        candidate: the effect to add.
        screening: of it.
        ahead: other effects; None: there is none.
        how: searched: the whole parameter space of the model with the effect is searched first. Quickly: a few steps
            from the first start, with sensitivities that are measured again once at most: enough to see which effects
            can win, not to decide between them. Beside: from nowhere but where the best other one ended.

    Returns:
        None if the motion is unstable from every start.
    """
    ahead = ahead or Ahead()
    fits = _Fits(problem, effects, comparison, candidate, screening)
    linear = screening.score(candidate.name)
    begun, rollouts = _starts(fits.model, comparison, candidate, linear, fits.objective.mean), 0
    measured = 0
    if ahead.known is not None:
        near = fits.beside(begun[0], ahead.known)
        begun, measured = [near] if how == "beside" else [near, *begun], 1
    if how == "searched":
        try:
            guess = {**problem.first_guess, **candidate.effect.guess}
            found = base_fit(problem, fits.effects, guess, progress, followed=True)
        except SimulationError:
            return None
        begun, rollouts, measured = [found.free], found.rollouts, 1
    quick = how == "quickly"
    effort = QUICK if quick else fits.objective.effort(ITERATIONS)
    best, used = fits.best(begun[:1] if quick else begun, progress, ahead.cost, measured, effort)
    if best is None:
        return None
    again = fits.scored(best, screening, rollouts + used)
    if not quick and again.p_value < LEVEL and again.cost < ahead.cost:
        null = problem, effects, comparison, again.known, fits.without, fits.mask
        without = better_null(*null, fits.seen(best), prefixed(progress, "without it again, "))
        again = replace(again, simulated=again.simulated + without.rollouts)
        again = again.against(without.cost, without.held or again.held_without, screening)
        if again.p_value >= LEVEL or not explains_most(without.cost, again.cost, fits.size):
            again = replace(again, better=without.known)
    return again


class _Fits:
    """Fits of a model with one more effect; arguments as of :func:`refit`."""

    def __init__(
        self,
        problem: Problem,
        effects: Sequence[Effect],
        comparison: Comparison,
        candidate: Candidate,
        screening: Screening,
    ):
        self.problem, self.comparison = problem, comparison
        self.name, self.spreads, self.effects = candidate.name, candidate.spreads, [*effects, candidate.effect]
        self.one_sided = candidate.effect.one_sided and not candidate.discrete
        outside = candidate.name in screening.outside
        self.mask = problem.of_all_cameras if outside else comparison.fitted
        self.whole = comparison.noise(problem, problem.usable)
        self.noise = self.whole.among(self.mask[problem.usable])
        self.without = _cost_without(problem, comparison, self.mask) if outside else comparison.cost
        self.model = problem.model(self.effects, {**comparison.known, **candidate.effect.guess})
        self.objective = StandardisedObjective(problem, self.model, self.mask, self.noise)
        self.own = np.isin(self.model.names, list(candidate.effect.parameters))
        self.size = int(self.mask.sum())

    def best(
        self, begun: Sequence[np.ndarray], progress: Progress, best_cost: float, measured: int, effort: Effort
    ) -> tuple[Fit | None, int]:
        """The best of the fits from some starts [(K,) each], None where all are unstable, and the rollouts of all; at
        the first so many, which are not near the model without the effect, sensitivities are measured.
        """
        best, cost, rollouts = None, np.inf, 0
        for number, start in enumerate(begun):
            if cost <= min(self.size, GIVE_UP * best_cost):
                break  # no more than noise is left, nor much more than elsewhere: another optimum is not needed
            first = None if number < measured else _begun(self.objective, self.model, self.comparison, start, self.own)
            tried = fit_or_none(
                self.objective,
                start if first is None else first,
                self.model.scales,
                self.model.bounds,
                replace(effort, abort_above=min(self.without, GIVE_UP * best_cost, GIVE_UP * cost)),
                reporter(self.model, progress),
                self.objective.rows,
            )
            rollouts += int(self.own.sum()) + 2 if tried is None else tried.rollouts
            if tried is not None and tried.cost_of(self.objective.rows) < cost:
                best, cost = tried, tried.cost_of(self.objective.rows)
        return best, rollouts

    def beside(self, start: np.ndarray, values: dict[str, float]) -> np.ndarray:
        """A start [(K,)] with all unknowns that another model has as that has them [SI]."""
        shared = {name: values[name] for name in self.model.names if name in values}
        return np.clip(self.model.moved(start, shared), *self.model.bounds)

    def scored(self, best: Fit, screening: Screening, rollouts: int) -> Refit:
        """What a fit says of the effect."""
        jacobian, scale = self.objective.standardised(best), screening.scale(self.name)
        mean, deviation = self.objective.prior
        cost = best.cost_of(self.objective.rows)
        occam = self._log_occam_factor(best.free, jacobian, scale)
        along = scale * float(np.sqrt(max(1.0, cost / self.size)))
        told, _ = intervals_in_si(self.model, best.free, deviation, jacobian, along, self.noise)
        residual, known = self.objective.seen(best)[0], self.model.physical(best.free)
        suspect = tuple(notes(self.model, best.free, mean, deviation))
        without = self.comparison.residual, self.comparison.jacobian, self.comparison.deviation
        held_without = _predicted(self.problem, self.mask, self.whole, *without)
        held = _predicted(self.problem, self.mask, self.whole, *self.objective.seen(best), deviation)
        sizes = self.size, int(self.problem.usable.sum())
        rest = occam, held_without, held, 1.0, suspect, rollouts, sizes
        return Refit(self.name, known, told, residual, 0.0, cost, 0.0, *rest).against(
            self.without, held_without, screening
        )

    def _log_occam_factor(self, free: np.ndarray, jacobian: np.ndarray, scale: float) -> float:
        """Of the coefficients of the effect at coordinates [(K,)], with the prior that its linear change was scored by;
        changes of the standardised residual by one prior standard deviation of each [(D, K)], ``scale`` of the noise.
        """
        changes = jacobian / np.where(self.own, scale, 1.0)
        covariance = np.linalg.inv(np.eye(changes.shape[1]) + changes.T @ changes)[np.ix_(self.own, self.own)]
        mean, deviation = self.objective.prior
        away = ((free - mean) / deviation)[self.own]
        widest = log_occam_factor(changes[:, ~self.own], changes[:, self.own])
        return widest + log_spread_factor(away, covariance, self.spreads, self.one_sided)

    def seen(self, found: Fit) -> np.ndarray:
        """Derivative of the residual at a fit by the unknowns of the model without the effect [(R, F, 11, K)]."""
        return self.objective.seen(found)[1][..., ~self.own]


def against_without(
    problem: Problem, kept: Sequence[Effect], effect: Effect, comparison: Comparison, screening: Screening
) -> tuple[Refit, dict[str, float]]:
    """One effect of a fitted model, scored against the model without it, which is fitted from there; and the values of
    that [SI].

    Args:
        problem, comparison: the run, and its model fitted with the effect.
        kept, effect: effects of the model without it, and it.
        screening: of the model with it, whose threshold counts.

    Raises:
        SimulationError: the motion without it is unstable.
    """
    model = problem.model(kept, comparison.known)
    places = [comparison.names.index(other) for other in model.names]
    prior = comparison.mean[places], comparison.deviation[places]
    at = comparison.free[places], comparison.jacobian[..., places], comparison.errors
    without = standardised(problem, model, *at, lambda _: None, prior=prior)
    fits = _Fits(problem, kept, without, Candidate(name_of(effect), effect), screening)
    places = [comparison.names.index(other) for other in fits.model.names]
    free, jacobian = comparison.free[places], fits.objective.derivative(comparison.jacobian[..., places])
    rows = fits.objective.rows_of(comparison.residual[problem.usable], free)
    again = fits.scored(Fit(free, rows, jacobian), screening, without.rollouts)
    return again, without.known


class BetterNull(NamedTuple):
    """A model fitted again from where a larger one, which contains it, ended.

    cost: the least that is known of it, in the fitted entries.
    known, held: values there [SI], and what it predicts of the other entries, if the model is decisively more probable
        with them than as it was fitted.
    rollouts: that it took.
    """

    cost: float
    known: dict[str, float] | None
    held: Prediction | None
    rollouts: int


def better_null(
    problem: Problem,
    effects: Sequence[Effect],
    comparison: Comparison,
    known: dict[str, float],
    without: float,
    mask: np.ndarray,
    changes: np.ndarray | None = None,
    progress: Progress = lambda _: None,
) -> BetterNull:
    """Fit a model again from where a larger one, which contains it, ended.

    Args:
        problem, effects, comparison: the run, the effects of the model, and that model fitted.
        known: every value of the larger model [SI].
        without: cost of the model where it was fitted, in the entries of
        mask: [(R, F, 11), bool]
        changes: of the residual by the unknowns of the model, for the first steps [(R, F, 11, K)]; None: measured.
    """
    model, whole = problem.model(effects, known), comparison.noise(problem, problem.usable)
    noise = whole.among(mask[problem.usable])
    objective = StandardisedObjective(problem, model, mask, noise, (comparison.mean, comparison.deviation))
    free, rows, none = np.clip(model.start, *model.bounds), objective.rows, BetterNull(without, None, None, 1)
    try:
        now = objective(free)
    except SimulationError:
        return none
    start = Fit(free, now, None if changes is None else objective.derivative(changes), 0, objective)
    if start.jacobian is not None:
        step = np.linalg.lstsq(start.jacobian[rows], -now[rows], rcond=None)[0]
        promised = now[rows] + start.jacobian[rows] @ step
        if promised @ promised > without:
            return none
    effort = Effort(QUICK.iterations, without, confirm=False)
    found = fit(objective, start, model.scales, model.bounds, effort, reporter(model, progress), rows)
    cost, rollouts = found.cost_of(rows), 1 + found.rollouts
    if log_bayes_factor(without, cost, int(mask.sum()), 0.0, 1.0) <= DECISIVE:
        return BetterNull(min(cost, without), None, None, rollouts)
    residual, jacobian = objective.seen(found)
    seen = residual, jacobian if changes is None else changes
    held = _predicted(problem, mask, whole, *seen, comparison.deviation)
    return BetterNull(cost, model.physical(found.free), held, rollouts)


def _predicted(
    problem: Problem,
    mask: np.ndarray,
    whole: NoiseModel,
    residual: np.ndarray,
    jacobian: np.ndarray,
    deviation: np.ndarray,
) -> Prediction:
    """Of the usable entries beyond the mask of those that were fitted [(R, F, 11), bool], with the noise of all usable
    ones, by the residual of a model, its jacobian and the priors of its unknowns [(R, F, 11), (R, F, 11, K), (K,)].
    """
    fitted = mask[problem.usable]
    if fitted.all():
        return Prediction(0.0, 0.0)
    changes = np.nan_to_num(jacobian[problem.usable]) * deviation
    return prediction(whole, np.nan_to_num(residual[problem.usable]), changes, fitted)


def _begun(
    objective: StandardisedObjective, model: Model, comparison: Comparison, start: np.ndarray, own: np.ndarray
) -> Fit | None:
    """The start of a fit [(K,)] with its sensitivities: those of the model without the effect, which a fit corrects on
    its way, and those to its own coefficients [(K,), bool], measured; None where the motion is unstable.
    """
    try:
        now = objective(start)
    except SimulationError:
        return None
    known = {name: comparison.jacobian[..., k] for k, name in enumerate(comparison.names)}
    none = np.zeros(comparison.residual.shape)
    jacobian = objective.derivative(np.stack([known.get(name, none) for name in model.names], axis=-1))
    for index in np.flatnonzero(own):
        jacobian[:, index] = column(objective, start, now, int(index), model.scales[index], model.bounds[1][index])[0]
    return Fit(start, now, jacobian, 1 + int(own.sum()), objective)


def _cost_without(problem: Problem, comparison: Comparison, mask: np.ndarray) -> float:
    """Of the fitted model in the entries of a mask [(R, F, 11), bool], after a linear fit to them."""
    away = (comparison.free - comparison.mean) / comparison.deviation
    return comparison.marginal(problem, mask).square(np.nan_to_num(comparison.residual[mask])) + float(away @ away)


def _starts(
    model: Model, comparison: Comparison, candidate: Candidate, score: Score | None, mean: np.ndarray
) -> list[np.ndarray]:
    """Free coordinates to begin a fit at [(K,) each]: the effect as its score or its probes say, everything else as in
    the model without it; and where that has moved far, as guessed.
    """
    found = [model.moved(model.start, values) for values in starts(candidate, score)]
    if bent(comparison):
        own = np.isin(model.names, list(candidate.effect.parameters))
        found += [np.where(own, start, mean) for start in found]
    return [np.clip(start, *model.bounds) for start in found]


def bent(comparison: Comparison) -> bool:
    """Whether the fitted model has moved far from what was expected: it may stand in for an effect."""
    return bool((np.abs(comparison.free - comparison.mean) / comparison.deviation > BENT).any())


def starts(candidate: Candidate, score: Score | None) -> list[dict[str, float]]:
    """Values of the effect's coefficients to start a fit from [SI]: by its score; the first and the last probe of a
    non-local effect, or of one that has no score. A score is a straight line through the null and its probe; where it
    leads beyond the probe, a start at the probe follows a residual that bends.
    """
    null, probes = candidate.effect.null, candidate.effect.probes
    if candidate.discrete or score is None:
        return [dict(probes[0]), dict(probes[-1])]
    if candidate.joint:
        return [{name: null[name] + c for name, c in zip(null, score.coefficient, strict=True)}]
    probe = probes[min(score.alternative, len(probes) - 1)]
    name = max(null, key=lambda other: abs(probe[other] - null[other]))
    largest = max(abs(p[name] - null[name]) for p in probes)
    far, reach = float(np.clip(score.coefficient[0], -2 * largest, 2 * largest)), abs(probe[name] - null[name])
    near = float(np.clip(far, -reach, reach))
    return [{**probe, name: null[name] + size} for size in dict.fromkeys((near, far))]
