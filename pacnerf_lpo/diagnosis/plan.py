"""The recording to make next: which one would best separate the hypotheses that a diagnosis could not tell apart.

Every hypothesis is a fitted model. It predicts what a further recording would show, mu_h, and how far its parameters,
within their posterior, and what is the new recording's own (its velocity, its ground), within its prior, could change
that: A_h A_h^T, with noise of unit variance. If h is true, the log Bayes factor of h against h' that the recording adds
is expected to be about

    D/2 log(1 + |Delta|^2 / D),    |Delta|^2 = (mu_h - mu_h')^T (I + A_h' A_h'^T)^-1 (mu_h - mu_h'),

as what the parameters of h' can imitate does not count (a Kullback-Leibler divergence, with the covariance of h' for
both, and a dispersion of the noise that is not known beforehand, as :mod:`~pacnerf_lpo.inference.evidence` has it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from pacnerf_lpo.diagnosis.contributions import entries_of_each
from pacnerf_lpo.diagnosis.recipes import Proposed, Recipe, recipes_for, work_out
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.least_squares import sensitivities
from pacnerf_lpo.identification.problem import Part, Problem, relative
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.identification.silhouette_moments import KINDS
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT

MOST_HYPOTHESES = 4
"""So many of the hypotheses are compared, the most probable first."""
ENOUGH = float(np.log(1000.0))
"""Recordings that are expected to reach such a log Bayes factor are equally good; the easiest to make comes first."""
LEAST_NOISE = 0.05
"""Standard deviation of a silhouette moment that is always there [pixels]."""


@dataclass(frozen=True)
class Odds:
    """What a recording is expected to say where ``true`` is true.

    against: the hypothesis that it separates from it.
    log_bayes_factor: expected.
    """

    true: str
    against: str
    log_bayes_factor: float


@dataclass(frozen=True)
class Proposal:
    """A recording to make, and what is expected of it.

    words: what to do.
    higher: factor on the height of the drop.
    score: expected log Bayes factor of the true hypothesis against the one that is hardest to separate from it, a mean
        over the hypotheses.
    odds: of every ordered pair.
    """

    words: str
    higher: float
    score: float
    odds: tuple[Odds, ...]


@dataclass(frozen=True)
class _Believed:
    """A hypothesis after the recordings that there are.

    name: of the effect.
    part: its fitted model, as the first recording has it.
    spread: by the name of each parameter that the object has in every recording, the changes of its free coordinate by
        the columns of a root of the posterior covariance [(K,)]
    probability: relative to that of the others.
    """

    name: str
    part: Part
    spread: dict[str, np.ndarray]
    probability: float


def last_open(rounds: Sequence[Round]) -> Round:
    """The last round that left several hypotheses. Raises UserInputError where none did."""
    found = [one for one in rounds if len(one.indistinguishable) > 1]
    if not found:
        raise UserInputError("plan: nothing is left to separate: the diagnosis names one cause, or none")
    return found[-1]


def propose(
    problem: Problem, found: Round, progress: Progress, recipes: Sequence[Recipe] | None = None
) -> list[Proposal]:
    """Recordings that would separate the hypotheses of a round that were not told apart, best first; of those that are
    expected to do so with odds of more than a thousand to one, the easiest first, as ``recipes`` are listed; None: all.

    Raises:
        UserInputError: there are no two hypotheses to tell apart.
    """
    if not problem.views:
        raise UserInputError("plan: it proposes recordings by cameras; the measured flights of a diagnosis have none")
    names, found = last_open([found]).indistinguishable[:MOST_HYPOTHESES], found.second or found
    believed = [_believed(problem, found, name) for name in names]
    first = believed[0].part
    quiet = _Noise.of(problem, found)
    proposals = []
    effects = [effect for one in believed for effect in one.part.effects]
    for recipe in recipes_for(effects) if recipes is None else recipes:
        try:
            proposed = work_out(recipe, first)
            if proposed is None:
                continue
            views = [_seen(proposed, one) for one in believed]
        except SimulationError:
            progress(f"{recipe.name}: left out, its motion is unstable")
            continue
        proposals.append(_judged(proposed, believed, views, quiet))
        progress(f"{proposals[-1].words}: log Bayes factor {proposals[-1].score:.1f}")
    return sorted(proposals, key=lambda one: -min(one.score, ENOUGH))


def _believed(problem: Problem, found: Round, name: str) -> _Believed:
    """A hypothesis with the posterior of its parameters, by the sensitivities at its optimum."""
    again = next(one for one in found.refits if one.name == name)
    effects: list[Effect] = [*found.effects, found.candidate(name).effect]
    model, mask = problem.model(effects, again.known), problem.fitted_with(effects)
    everywhere = problem.residual_of(model, mask)
    jacobian = sensitivities(everywhere, model.start, everywhere(model.start), model.scales, model.bounds)
    deviation = priors(problem, model)[1]
    whitened = found.comparison.noise(problem, mask).whiten(jacobian) * deviation
    dispersion = max(1.0, again.cost / len(whitened))
    precision = whitened.T @ whitened / dispersion + np.eye(len(deviation))
    root = deviation[:, None] * np.linalg.inv(np.linalg.cholesky(precision)).T
    part = problem.parts(effects, again.known)[0]
    shared = [*part.recording.physics.material.free_names]
    shared += [name for effect in part.effects if not effect.of_recording for name in effect.parameters]
    spread = {name: root[model.names.index(name)] for name in shared if name in model.names}
    least = max(one.log_bayes_factor for one in found.refits)
    return _Believed(name, part, spread, float(np.exp(again.log_bayes_factor - least)))


def _seen(proposed: Proposed, one: _Believed) -> tuple[np.ndarray, np.ndarray]:
    """What a hypothesis predicts of a recording: moments [pixels, (V, F, 10)], and their changes by what is not known
    [(V, F, 10, K)]. Raises SimulationError.
    """
    model = proposed.model(one.part)
    shape = (*model.shape, len(KINDS))

    def moments(free: np.ndarray) -> np.ndarray:
        return np.nan_to_num(relative(model.predict(free))[..., : len(KINDS)]).ravel()

    now = moments(model.start)
    jacobian = sensitivities(moments, model.start, now, model.scales, model.bounds)
    root = np.zeros((len(model.names), len(next(iter(one.spread.values())))))
    own = np.zeros(len(model.names))
    for index, unknown in enumerate(model.unknowns):
        if unknown.name in one.spread:
            root[index] = one.spread[unknown.name]
        elif unknown.name == GROUND_HEIGHT.name:
            own[index] = unknown.scale
        else:
            own[index] = unknown.prior(one.part.recording.guess.get(unknown.name, 0.0))[1]
    changes = jacobian @ np.concatenate((root, np.diag(own)[:, own > 0]), axis=1)
    return now.reshape(shape), changes.reshape(*shape, -1)


@dataclass(frozen=True)
class _Noise:
    """Noise of the silhouette moments in a recording like the one that there is.

    sensor: standard deviation of each kind [pixels, (10,)]
    numerical: by frame [pixels, (F, 10)];  times: of the frames [s, (F,)]
    correlation: of the numerical error between neighbouring frames.
    inflation: factor on the variance with which this simple noise sees the fitted parameters as sharply as the full
        noise of the comparison does, which knows that errors are common to all views.
    """

    sensor: np.ndarray
    numerical: np.ndarray
    times: np.ndarray
    correlation: float
    inflation: float

    @staticmethod
    def of(problem: Problem, found: Round) -> _Noise:
        """Of the first recording of a problem."""
        comparison, kinds = found.comparison, slice(len(KINDS))
        recording = problem.parts(found.effects, comparison.known)[0].recording
        views = slice(recording.views)
        replicates = problem.part_of(comparison.errors.replicates, 0, axis=1)[:, views, :, kinds]
        squares = (problem.part_of(comparison.errors.known, 0)[views, :, kinds] ** 2).sum(-1)
        sensor = np.sqrt(np.nanmedian(problem.part_of(comparison.errors.sensor, 0)[views, :, kinds] ** 2, axis=(0, 1)))
        variance = np.nan_to_num(np.nanmean(replicates.var(0, ddof=1) + squares, axis=0))
        numerical = np.sqrt(np.maximum(variance - sensor**2, 0.0)) + LEAST_NOISE
        mask = entries_of_each(problem, comparison.fitted)[0]
        full = comparison.noise(problem, mask)
        times = recording.video.times.numpy() - float(recording.video.times[0])
        simple = _Noise(sensor, numerical, times, full.learnt.correlation, 1.0)
        own = problem.part_of(mask, 0)[..., None]
        changes = np.nan_to_num(np.where(own, problem.part_of(comparison.jacobian, 0), 0.0))
        ours, theirs = simple.whiten(changes[views, :, kinds]), full.whiten(comparison.jacobian[mask])
        ours, theirs = (ours**2).sum(0), (theirs**2).sum(0)
        told = (ours > 0) & (theirs > 0)
        return replace(simple, inflation=max(1.0, float(np.median(ours[told] / theirs[told]))))

    def whiten(self, changes: np.ndarray, proposed: Proposed | None = None) -> np.ndarray:
        """Changes of the moments [(V, F, 10, K)] in units of the noise [(V F 10, K)], in the recording that there is or
        in a proposed one, whose numerical errors are those at the same time after the contact.
        """
        at, rho, scale = np.arange(len(self.times)), self.correlation, 1.0
        if proposed is not None:
            ours = proposed.video.times.numpy() - proposed.contact[1] + proposed.contact[0]
            at = np.abs(ours[:, None] - self.times).argmin(1)
            rho, scale = rho ** (1 / proposed.recipe.faster), 1 / proposed.scale
        gap = np.abs(np.arange(len(at))[:, None] - np.arange(len(at)))
        found = np.empty_like(changes)
        for kind in range(len(KINDS)):
            error = scale * self.numerical[at, kind]
            covariance = rho**gap * error[:, None] * error + self.sensor[kind] ** 2 * np.eye(len(at))
            whitener = np.linalg.inv(np.linalg.cholesky(self.inflation * covariance))
            found[:, :, kind] = np.einsum("ef,vfk->vek", whitener, changes[:, :, kind])
        return found.reshape(-1, changes.shape[-1])


def _judged(
    proposed: Proposed, believed: Sequence[_Believed], views: Sequence[tuple[np.ndarray, np.ndarray]], noise: _Noise
) -> Proposal:
    """Expected log Bayes factors of a recording, of which every hypothesis predicts a view."""
    odds = []
    for (true, (seen, _)), (other, (imitated, free)) in permutations(zip(believed, views, strict=True), 2):
        moved = noise.whiten((seen - imitated)[..., None], proposed)[:, 0]
        changes = noise.whiten(free, proposed)
        inner = np.eye(changes.shape[1]) + changes.T @ changes
        along = changes.T @ moved
        square, size = float(moved @ moved - along @ np.linalg.solve(inner, along)), len(moved)
        odds.append(Odds(true.name, other.name, size / 2 * float(np.log1p(max(square, 0.0) / size))))
    total = sum(one.probability for one in believed)
    hardest = [min(o.log_bayes_factor for o in odds if o.true == one.name) * one.probability for one in believed]
    return Proposal(proposed.words, proposed.recipe.higher, sum(hardest) / total, tuple(odds))
