"""Step 4, second half, and step 5: fit with an effect added, and judge it where nothing was fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import (
    Comparison,
    Progress,
    laplace_in_si,
    noise_of_held_out,
    reporter,
    whitened_by,
)
from pacnerf_lpo.diagnosis.screening import Screening
from pacnerf_lpo.diagnosis.statistics.acceptance import (
    LEAST_REMOVED,
    MOST_REMOVED,
    HeldOut,
    Verdict,
    acceptance,
    judge_held_out,
    survival,
)
from pacnerf_lpo.diagnosis.statistics.intervals import Interval, overdispersion
from pacnerf_lpo.diagnosis.statistics.omnibus import omnibus
from pacnerf_lpo.diagnosis.statistics.score import Score
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import LONGEST_STEP, Fit, Residual, fit, sensitivities
from pacnerf_lpo.identification.problem import Problem, StateProblem, absolute
from pacnerf_lpo.inference.noise import NoiseModel

ITERATIONS = 10
REFINED_ITERATIONS = 3
MOST_REFITS = 4
MOST_ALIKE = 3
GIVE_UP = 1.2
"""A start that is still so much worse than another, or than another effect, after a few iterations is given up."""
FINER = 0.85
"""Node spacing of the refinement check, beside that of the diagnosis."""


@dataclass(frozen=True)
class Refit:
    """A model with one more effect, fitted.

    candidate: the effect.
    known: every value [SI]
    intervals: of all unknowns [SI]
    residual: measured minus predicted [pixels, (V, F, 11)]
    misfit_before, misfit: whitened sums of squares in the fitted entries.
    refined: the leading coefficient on a finer grid [SI]; None where that was not tried.
    verdict: of the acceptance on held-out data.
    """

    candidate: Candidate
    known: dict[str, float]
    intervals: list[Interval]
    residual: np.ndarray
    misfit_before: float
    misfit: float
    refined: float | None
    verdict: Verdict


def worth_refitting(candidates: Sequence[Candidate], screening: Screening, at_least: int = 0) -> list[Candidate]:
    """The best of the ranking that their score singles out, at most three of a class, and every alternative of kind,
    because a score at the null says little of those.

    Args:
        candidates: that were screened.
        screening: their ranking.
        at_least: so many effects on the body beside alternatives of kind, whatever their score.
    """
    by_name = {candidate.name: candidate for candidate in candidates}
    ranking = [by_name[score.name] for score in screening.scores]
    chosen: list[Candidate] = []
    for candidate in ranking:
        alike = [other for other in chosen if other.name in screening.group(candidate.name)]
        if screening.singles_out(candidate) and len(chosen) < MOST_REFITS and len(alike) < MOST_ALIKE:
            chosen.append(candidate)
    others = [c for c in ranking if c not in chosen and not c.observes and not c.discrete]
    chosen += others[: max(0, at_least - sum(not c.observes for c in chosen))]
    return chosen + [c for c in candidates if c.discrete and not c.observes and c not in chosen]


def refit(
    problem: Problem,
    comparison: Comparison,
    candidate: Candidate,
    score: Score | None,
    progress: Progress,
    best_misfit: float = np.inf,
    named: bool = True,
) -> Refit | None:
    """Fit all parameters with the effect added, from one or more starts, and judge it on held-out data.

    A fault of one camera is fitted in every other frame of that view too, and judged in the frames between.

    Args:
        problem, comparison: the run and its fitted model.
        candidate: the effect to add.
        score: what the score test says of it; None if it says nothing.
        progress: told what happens.
        best_misfit: of another effect that was accepted; a fit that stays far above it is given up.
        named: whether the score test names the effect.

    Returns:
        None if the motion is unstable from every start.
    """
    fitted, _ = _masks(problem, candidate)
    noise = comparison.noise(problem, fitted)
    before = noise.whiten_residual(np.nan_to_num(comparison.residual[fitted]))
    best: tuple[Fit, Model] | None = None
    abort_above = min(float(before @ before), GIVE_UP * best_misfit)
    for start in starts(candidate, score):
        model = problem.model([*comparison.effects, candidate.effect], {**comparison.known, **start})
        residual = whitened_by(noise, problem.residual_of(model, fitted))
        try:
            found = fit(
                residual,
                _adjusted(model, residual, noise, comparison, fitted),
                model.scales,
                model.bounds,
                ITERATIONS,
                reporter(model, progress),
                abort_above,
            )
        except SimulationError:
            continue
        if best is None or found.cost < best[0].cost:
            best, abort_above = (found, model), min(abort_above, GIVE_UP * found.cost)
    if best is None:
        return None
    found, model = best
    known = model.physical(found.free)
    intervals = _intervals(found, model, noise, problem.residual_of(model, fitted))
    after = problem.residual(model.predict(found.free))
    leading = leading_of(candidate, intervals)
    interval = next(i for i in intervals if i.name == leading)
    verdict = acceptance(
        _held_out(problem, comparison, after, candidate, named),
        (float(before @ before), found.cost),
        float(before @ before) * _noise_share(noise, comparison, fitted),
        len(candidate.effect.null),
        (interval.low, interval.high),
        candidate.effect.null[leading],
        named,
    )
    return Refit(candidate, known, intervals, after, float(before @ before), found.cost, None, verdict)


def refine(problem: Problem, comparison: Comparison, again: Refit, progress: Progress) -> Refit:
    """The same with its leading coefficient followed to a finer grid; unchanged where the motion is unstable there."""
    candidate = again.candidate
    progress(f"{candidate.name} on a finer grid")
    fitted, _ = _masks(problem, candidate)
    noise = comparison.noise(problem, fitted)
    body = problem.sample(FINER * problem.spacing, seed=1)
    model = problem.model([*comparison.effects, candidate.effect], again.known, body)
    residual = whitened_by(noise, problem.residual_of(model, fitted))
    try:
        found = fit(residual, model.start, model.scales, model.bounds, REFINED_ITERATIONS)
    except SimulationError:
        return again
    leading = leading_of(candidate, again.intervals)
    fine = model.physical(found.free)[leading]
    null = candidate.effect.null[leading]
    return replace(again, refined=fine, verdict=survival(again.verdict, again.known[leading] - null, fine - null))


def _noise_share(noise: NoiseModel, comparison: Comparison, fitted: np.ndarray) -> float:
    """What part of the misfit in the fitted entries [(V, F, 11), bool] is noise: the mean square that a fit leaves of
    left-out twins over that which it leaves of the measurement. Above 1 where the measurement fits better than they do.
    """
    size = omnibus(noise, np.nan_to_num(comparison.residual[fitted]), comparison.jacobian[fitted])
    return float(size.twins.mean()) / max(size.statistic, 1e-300)


def _held_out(
    problem: Problem, comparison: Comparison, after: np.ndarray, candidate: Candidate, named: bool
) -> HeldOut:
    mask = problem.usable & _masks(problem, candidate)[1][..., None]
    before = comparison.residual
    if candidate.view is None:
        noise = noise_of_held_out(problem, comparison, mask)
    else:
        view = problem.video.view_ids.index(candidate.view)
        noise = noise_of_held_out(problem, comparison, mask, partial(absolute, view=view))
        before, after = absolute(before, view), absolute(after, view)
    least = least_removed(problem, comparison, candidate, named)
    return judge_held_out(noise, np.nan_to_num(before[mask]), np.nan_to_num(after[mask]), least)


def least_removed(problem: Problem, comparison: Comparison, candidate: Candidate, named: bool) -> float:
    """Share of the excess error that an effect has to remove: more where no score test names it and it is no
    alternative of kind, of which that says little; and where the shape was reconstructed and an error of it looks like
    the effect, or the model has an effect already and errors of the shape are most of what it leaves.
    """
    shape = isinstance(problem, StateProblem) and (candidate.effect.like_shape or bool(comparison.effects))
    return MOST_REMOVED if shape or not (named or candidate.discrete) else LEAST_REMOVED


def _adjusted(
    model: Model, residual: Residual, noise: NoiseModel, comparison: Comparison, fitted: np.ndarray
) -> np.ndarray:
    """Where to start: the other parameters moved as the linear model says they must when the effect is there [(K,)]."""
    before = residual(model.start)
    shift = -np.linalg.lstsq(noise.whiten(comparison.jacobian[fitted]), before, rcond=1e-8)[0]
    start = model.start.copy()
    for name, change in zip(comparison.names, shift, strict=True):
        index = model.names.index(name)
        start[index] += np.clip(change, -LONGEST_STEP * model.scales[index], LONGEST_STEP * model.scales[index])
    start = np.clip(start, *model.bounds)
    try:
        after = residual(start)
    except SimulationError:
        return model.start
    return start if after @ after < before @ before else model.start


def leading_of(candidate: Candidate, intervals: Sequence[Interval]) -> str:
    """The effect's coefficient farthest from its null in standard errors."""
    own = [interval for interval in intervals if interval.name in candidate.effect.parameters]
    null = candidate.effect.null
    return max(own, key=lambda i: abs(i.value - null[i.name]) / max(i.error, 1e-300)).name


def starts(candidate: Candidate, score: Score | None) -> list[dict[str, float]]:
    """Values of the effect's coefficients to start a fit from [SI]: by the score test where it names them, else the
    probes of the class. A score is a straight line through the null and its probe; where it leads beyond the probe, a
    start at the probe follows a valley that bends.
    """
    null, probes = candidate.effect.null, candidate.effect.probes
    if candidate.discrete or score is None:
        return [dict(probes[0]), dict(probes[-1])]
    if candidate.joint:
        names = list(null)[: len(score.coefficient)]
        return [{**null, **{name: null[name] + c for name, c in zip(names, score.coefficient, strict=True)}}]
    probe = probes[min(score.probe, len(probes) - 1)]
    name = max(null, key=lambda n: abs(probe[n] - null[n]))
    largest = max(abs(p[name] - null[name]) for p in probes)
    far, reach = float(np.clip(score.coefficient[0], -2 * largest, 2 * largest)), abs(probe[name] - null[name])
    near = float(np.clip(far, -reach, reach))
    return [{**probe, name: null[name] + size} for size in dict.fromkeys((near, far))]


def _masks(problem: Problem, candidate: Candidate) -> tuple[np.ndarray, np.ndarray]:
    """Entries to fit [(V, F, 11)], and view x frame blocks to judge by [(V, F)]."""
    if candidate.view is None:
        return problem.fitted, problem.split.held
    view = problem.video.view_ids.index(candidate.view)
    fitted, held = problem.split.fitted.copy(), np.zeros_like(problem.split.fitted)
    fitted[view, 0::2], fitted[view, 1::2] = True, False
    held[view, 1::2] = True
    return problem.usable & fitted[..., None], held


def _intervals(found: Fit, model: Model, noise: NoiseModel, residual: Residual) -> list[Interval]:
    """Of all unknowns [SI], from the residual before it is whitened."""
    jacobian = sensitivities(residual, found.free, residual(found.free), model.scales, model.bounds)
    dispersion = overdispersion(found.residual, max(len(found.residual) - len(found.free), 1))
    return laplace_in_si(model, found.free, noise, jacobian, dispersion)[0]
