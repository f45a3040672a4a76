"""Step 4, first half: what each effect would change, by one simulation for each probe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student
from torch import Tensor

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.statistics.calibration import calibrate
from pacnerf_lpo.diagnosis.statistics.classes import classes, correlation
from pacnerf_lpo.diagnosis.statistics.intervals import overdispersion
from pacnerf_lpo.diagnosis.statistics.score import Probe, Remainder, Score, score_test
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import each
from pacnerf_lpo.mpm.effects.base import Effect

FALSE_ALARMS = 0.01
"""Probability of a false alarm, over the whole catalogue."""
MEDIAN_DEVIATE = 0.6745
LEAST_CAMERAS = 4
LEAST_CHANGE = 1e-4
"""A trial that moves no summary by so much [pixels] changes nothing."""


def probe_all(
    problem: Problem,
    installed: Sequence[Effect],
    null: Model,
    free: np.ndarray,
    candidates: Sequence[Candidate],
    mask: np.ndarray,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Probe]:
    """The change of the residual by every candidate, in the entries of a mask [(V, F, 11), bool].

    Args:
        problem: the run.
        installed: effects of the null model.
        null: the fitted model.
        free: its coordinates [(K,)]
        candidates: effects to try beside the installed ones.
        mask: entries to return.
        progress: called with the name of each candidate.

    A trial whose motion is unstable, or that changes nothing there, is left out; so is a candidate without a trial.
    """
    path, known = null.path(free), null.physical(free)
    before = null.observe(path, free)
    trials = [list(candidate.trials()) for candidate in candidates]
    models = (
        [problem.model([*installed, candidate.effect], {**known, **trial}) for trial in tried]
        for candidate, tried in zip(candidates, trials, strict=True)
    )
    seen = each(
        _seen,
        ((tried, (path, before) if c.observes else None) for c, tried in zip(candidates, models, strict=True)),
    )
    found = []
    for candidate, tried, predicted in zip(candidates, trials, seen, strict=True):
        progress(candidate.name)
        columns, sizes = [], []
        for trial, after in zip(tried, predicted, strict=True):
            if after is None:
                continue
            change = np.nan_to_num(problem.relative(after - before)[mask])
            if np.abs(change).max() > LEAST_CHANGE:
                columns.append(change)
                sizes.append(size_of(candidate, trial))
        if columns:
            stacked = np.stack(columns, axis=1)
            found.append(Probe(candidate.name, stacked, tuple(sizes), candidate.effect.one_sided, candidate.joint))
    return found


def _seen(models: Sequence[Model], motion: tuple[Tensor, np.ndarray] | None) -> list[np.ndarray | None]:
    """What models predict at their start [(V, F, 11)]; None where the motion is unstable.

    Args:
        models: one for each trial.
        motion: known already, and its summaries, where the models differ in their cameras only.
    """
    found: list[np.ndarray | None] = []
    for model in models:
        try:
            found.append(model.observe(motion[0], model.start, motion[1]) if motion else model.predict(model.start))
        except SimulationError:
            found.append(None)
    return found


def size_of(candidate: Candidate, trial: dict[str, float]) -> float:
    """How far a trial is from the null, in the unit of its coefficient; 1 for alternatives of kind."""
    if candidate.discrete:
        return 1.0
    return max((trial[name] - null for name, null in candidate.effect.null.items()), key=abs)


@dataclass(frozen=True)
class Screening:
    """The catalogue, ranked.

    scores: best first.
    p_values: family-wise, of every score.
    intervals: of every coefficient by name, counted from the null: the bound where nothing is found.
    threshold: of |z|.
    groups: names that cannot be told apart in this recording.
    correlations: of the signatures, in the order of ``scores`` [(K, K)]
    """

    scores: list[Score]
    p_values: list[float]
    intervals: dict[str, list[tuple[float, float]]]
    threshold: float
    groups: list[tuple[str, ...]]
    correlations: np.ndarray

    def group(self, name: str) -> tuple[str, ...]:
        """The names that cannot be told apart from this one, itself among them."""
        return next(group for group in self.groups if name in group)

    def p_value(self, name: str) -> float:
        """Family-wise p-value of an effect; 1 if it changes nothing that can be seen."""
        return next((p for score, p in zip(self.scores, self.p_values, strict=True) if score.name == name), 1.0)

    def singles_out(self, candidate: Candidate) -> bool:
        """Whether the score of an effect is rarer than a false alarm may be."""
        return self.p_value(candidate.name) < FALSE_ALARMS

    def names(self, candidate: Candidate) -> bool:
        """Whether the score test names an effect; of an alternative of kind it says little."""
        return not candidate.discrete and self.singles_out(candidate)


def screen(
    problem: Problem, comparison: Comparison, candidates: Sequence[Candidate], progress: Callable[[str], None]
) -> Screening:
    """Score every candidate at the fitted model (no refit), and calibrate on the twins.

    Physics, and faults of the fitted cameras, are scored in the fitted views and frames. Held-out cameras are scored in
    the fitted frames of all views; half the error level goes to either family.
    """
    held = {problem.video.view_ids[view] for view in np.flatnonzero(~problem.split.views)}
    outside = [c for c in candidates if c.observes and c.view in held]
    inside = [candidate for candidate in candidates if candidate not in outside]
    families = [(inside, problem.fitted)]
    if outside:
        families.append((outside, problem.usable & problem.split.frames[:, None]))
    null = problem.model(comparison.effects, comparison.known)
    scores, p_values, thresholds, intervals = [], [], [], {}
    for family, mask in families:
        probes = probe_all(problem, comparison.effects, null, comparison.free, family, mask, progress)
        if not probes:
            continue
        noise = comparison.noise(problem, mask)
        residual, jacobian = comparison.residual[mask], comparison.jacobian[mask]
        calibration = calibrate(noise, jacobian, probes, FALSE_ALARMS / len(families))
        ranked = score_test(noise, residual, jacobian, probes, calibration.scales)
        remainder = Remainder.of(noise, jacobian)
        statistic = overdispersion(remainder.residual(residual), remainder.dof)
        for score in beside_their_like([_dispersed(score, statistic) for score in ranked], family is outside):
            scores.append(replace(score, signature=_whole(score.signature, mask)))
            p_values.append(min(1.0, len(families) * calibration.p_value(score)))
            intervals[score.name] = calibration.interval(score)
        thresholds.append(calibration.threshold)
    order = sorted(range(len(scores)), key=lambda index: -abs(scores[index].z))
    scores = [scores[index] for index in order]
    signatures, names = np.stack([score.signature for score in scores]), [score.name for score in scores]
    return Screening(
        scores,
        [p_values[index] for index in order],
        intervals,
        max(thresholds),
        classes(signatures, names),
        correlation(signatures),
    )


def _dispersed(score: Score, statistic: float) -> Score:
    """A score in units of what would still be left over, if that is more than noise: the twins do not know every error
    of a reconstruction.

    Args:
        score: of one effect.
        statistic: ||M r||^2 / dof, at least 1.
    """
    factor = np.sqrt(max(1.0, (1 - score.fraction) * statistic))
    return replace(score, z=score.z / factor, error=tuple(factor * error for error in score.error))


def beside_their_like(scores: Sequence[Score], held: bool = False) -> list[Score]:
    """A fault of one camera must stand out among the cameras: scores of the same kind of fault are divided by the
    factor by which their median exceeds that of a normal deviate.

    No twin knows how wrong the shape is where the reconstruction did not look. So for held-out cameras the scale is
    known from the others only, and a score is that of Student's t with as many degrees of freedom as they have
    coefficients.

    Args:
        scores: of one family of effects.
        held: whether its cameras are held out.
    """
    found = []
    for score in scores:
        kind, at, _ = score.name.partition("@")
        alike = [abs(other.z) for other in scores if other.name.startswith(kind + "@")] if at else []
        factor = 1.0
        if len(alike) >= LEAST_CAMERAS:
            factor = max(1.0, float(np.median(alike)) / MEDIAN_DEVIATE)
            if held:
                factor *= _students_excess(score.z / factor, len(score.coefficient) * (len(alike) - 1))
        found.append(replace(score, z=score.z / factor, error=tuple(factor * error for error in score.error)))
    return found


def _students_excess(deviate: float, freedom: int) -> float:
    """How much larger a deviate of Student's t is than a normal one that is as rare."""
    normal = -norm.ppf(student.sf(abs(deviate), freedom))
    return max(1.0, abs(deviate) / normal) if normal > 0 else 1.0


def _whole(signature: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A signature [(D,)] among all entries of the recording, zero elsewhere."""
    found = np.zeros(mask.shape)
    found[mask] = signature
    return found.ravel()
