"""What every hypothesis would change, by one simulation for each probe, and how well that explains the residual."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from torch import Tensor

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress, each
from pacnerf_lpo.inference.calibration import Calibration, calibrate
from pacnerf_lpo.inference.classes import correlation
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.evidence import Score, score
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.mpm.effects.base import Effect

FORCE, SHAPE = "UnknownForce", "WrongShape"
"""Hypotheses that are no effect of the catalogue: a smooth force on the body, and errors of the reconstruction."""
FORCES = (0.3, 1.0, 3.0, 10.0)
"""Prior standard deviations of an unknown force, with equal probability [m/s^2]: from a breeze to the gravity."""
SHAPES = (2.0, 4.0)
"""The same of errors of the reconstruction, in units of what the outlines at frame 0 let expect; one such unit is part
of every model."""
MEDIAN_DEVIATE = 0.6745
LEAST_CAMERAS = 4
"""Views whose faults of one kind show how large such residuals are by themselves: the median of fewer would be that of
the very fault in question."""
CERTAIN = 1 - 1e-9
"""Probability above which a logarithm of its complement is not taken."""
LEAST_CHANGE = 1e-4
"""A trial that moves no silhouette moment by so much [pixels] changes nothing."""


@dataclass(frozen=True)
class Screening:
    """All hypotheses, ranked by how well their linear change explains the residual.

    scores: best first.
    calibrations: of the fitted data and, where cameras were held out, of the fitted frames of all views.
    outside: names of the faults of held-out cameras, which the second calibration is for.
    correlations: of the signatures, in the order of ``scores`` [(K, K)]
    """

    scores: list[Score]
    calibrations: list[Calibration]
    outside: list[str]
    correlations: np.ndarray

    def score(self, name: str) -> Score | None:
        """Of a hypothesis; None if it changes nothing that can be seen."""
        return next((found for found in self.scores if found.name == name), None)

    def p_value(self, name: str, log_bayes_factor: float) -> float:
        """Probability that the best of all hypotheses reaches this where nothing is missing; both families count, as if
        they were independent (Sidak 1967).
        """
        alone = min(self._calibration(name).p_value(log_bayes_factor), CERTAIN)
        return float(-np.expm1(len(self.calibrations) * np.log1p(-alone)))

    def scale(self, name: str) -> float:
        """Factor on the noise along a hypothesis; that of a typical one where it changes nothing that can be seen."""
        return self._calibration(name).scales.get(name, self.usual_scale)

    @property
    def usual_scale(self) -> float:
        """Factor on the noise along a typical effect; those of camera faults are relative to the other cameras."""
        scales = self.calibrations[0].scales
        return float(np.median([scale for name, scale in scales.items() if "@" not in name]))

    @property
    def threshold(self) -> float:
        """Of the log Bayes factor of the best hypothesis in the fitted data."""
        return self.calibrations[0].threshold

    def _calibration(self, name: str) -> Calibration:
        return self.calibrations[-1 if name in self.outside else 0]


@dataclass(frozen=True)
class Probes:
    """Every candidate as a hypothesis, before anything is judged.

    inside: effects, and faults of the fitted cameras, in the fitted entries.
    outside: faults of held-out cameras, in the fitted frames of all views.
    simulated: simulations that they took.
    """

    inside: list[Hypothesis]
    outside: list[Hypothesis]
    simulated: int


def probe(
    problem: Problem,
    effects: Sequence[Effect],
    comparison: Comparison,
    candidates: Sequence[Candidate],
    progress: Progress,
) -> Probes:
    """Try every candidate at the fitted model, see :func:`probed`."""
    held = {problem.video.view_ids[view] for view in np.flatnonzero(~problem.split.views)}
    outside = [c for c in candidates if c.observes and c.view in held]
    inside = [candidate for candidate in candidates if candidate not in outside]
    null, free = problem.model(effects, comparison.known), comparison.free
    families = [
        probed(problem, effects, null, free, family, mask, progress) if family else ([], 0)
        for family, mask in zip((inside, outside), masks(problem), strict=True)
    ]
    return Probes(families[0][0], families[1][0], families[0][1] + families[1][1])


def masks(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Entries that effects and faults of fitted cameras are judged by, and those for held-out cameras [(R, F, 11)]."""
    return problem.fitted, problem.usable & problem.split.frames[..., None]


def judge(problem: Problem, comparison: Comparison, probes: Probes) -> Screening:
    """Score every hypothesis, the discrepancies among them, and calibrate the selection among all on the replicates.
    What was held out may speak against a discrepancy.
    """
    families = [[*probes.inside, *discrepancies(comparison, problem.fitted)], probes.outside]
    level = 1 - (1 - LEVEL) ** (1 / sum(map(bool, families)))
    scores: list[Score] = []
    calibrations = []
    for hypotheses, mask in zip(families, masks(problem), strict=True):
        if not hypotheses:
            continue
        noise, residual = comparison.marginal(problem, mask), np.nan_to_num(comparison.residual[mask])
        calibration = calibrate(noise, hypotheses, level)
        found = [score(noise, residual, one, calibration.scales[one.name]) for one in hypotheses]
        scales = {name: s * usual_fault(found, name) for name, s in calibration.scales.items()}
        calibrations.append(replace(calibration, scales=scales))
        found = [score(noise, residual, one, scales[one.name]) for one in hypotheses]
        scores += [replace(one, signature=_whole(one.signature, mask)) for one in found]
    scores = contradicted(problem, comparison, scores, calibrations[0])
    scores.sort(key=lambda one: -one.log_bayes_factor)
    signatures = np.stack([one.signature for one in scores])
    outside = [one.name for one in probes.outside]
    return Screening(scores, calibrations, outside, correlation(signatures))


def contradicted(
    problem: Problem, comparison: Comparison, scores: Sequence[Score], calibration: Calibration
) -> list[Score]:
    """Scores in which what is no effect of the catalogue has the log Bayes factor of all data, where that is less than
    that of the fitted ones: what was held out may speak against it, not for it.
    """
    mask = problem.usable
    noise, residual = comparison.marginal(problem, mask), np.nan_to_num(comparison.residual[mask])
    of_all = {
        one.name: score(noise, residual, one, calibration.scales[one.name]).log_bayes_factor
        for one in discrepancies(comparison, mask)
    }
    return [replace(one, log_bayes_factor=min(one.log_bayes_factor, of_all.get(one.name, np.inf))) for one in scores]


def discrepancies(comparison: Comparison, mask: np.ndarray) -> list[Hypothesis]:
    """What is no effect of the catalogue, in the entries of a mask [(R, F, 11), bool]."""
    found = [_discrepancy(FORCE, comparison.force[mask], FORCES)]
    if comparison.shape_errors.shape[-1]:
        found.append(_discrepancy(SHAPE, np.nan_to_num(comparison.shape_errors[mask]), SHAPES))
    return found


def _discrepancy(name: str, changes: np.ndarray, sizes: Sequence[float]) -> Hypothesis:
    return Hypothesis(name, (changes,), (np.ones(changes.shape[1]),), spreads=tuple(sizes))


def probed(
    problem: Problem,
    effects: Sequence[Effect],
    null: Model,
    free: np.ndarray,
    candidates: Sequence[Candidate],
    mask: np.ndarray,
    progress: Progress = lambda _: None,
) -> tuple[list[Hypothesis], int]:
    """Every candidate as a hypothesis about the entries of a mask [(R, F, 11), bool], and the number of simulations.

    The prior standard deviation of a coefficient is its largest probe. A trial whose motion is unstable, or that
    changes nothing there, is left out; so is a candidate without a trial.

    Args:
        problem, effects: the run, and the effects of its model.
        null, free: the fitted model, and its coordinates [(K,)]
        candidates: effects to try in addition to those of the model.
        mask: entries to return.
        progress: called with the name of each candidate.
    """
    path, known = null.path(free), null.physical(free)
    before = null.observe(path, free)
    trials = [list(candidate.trials()) for candidate in candidates]
    models = (
        [problem.model([*effects, candidate.effect], {**known, **trial}) for trial in tried]
        for candidate, tried in zip(candidates, trials, strict=True)
    )
    seen = each(
        _seen, ((tried, (path, before) if c.observes else None) for c, tried in zip(candidates, models, strict=True))
    )
    found = []
    for candidate, tried, predicted in zip(candidates, trials, seen, strict=True):
        progress(candidate.name)
        columns, sizes, widths = [], [], []
        for trial, after in zip(tried, predicted, strict=True):
            change = np.zeros(mask.sum()) if after is None else np.nan_to_num(problem.relative(after - before)[mask])
            if candidate.joint or np.abs(change).max() > LEAST_CHANGE:
                name, size = size_of(candidate, trial)
                columns.append(change)
                sizes.append(size)
                widths.append(1.0 if candidate.discrete else candidate.width(name))
        if columns and np.abs(columns).max() > LEAST_CHANGE:
            arrays = np.stack(columns, axis=1), np.array(sizes), np.array(widths)
            prior = candidate.effect.one_sided, candidate.components, candidate.spreads
            found.append(Hypothesis.of_probes(candidate.name, *arrays, *prior))
    return found, sum(len(tried) for c, tried in zip(candidates, trials, strict=True) if not c.observes)


def _seen(models: Sequence[Model], motion: tuple[Tensor, np.ndarray] | None) -> list[np.ndarray | None]:
    """What models predict at their start [(R, F, 11)]; None where the motion is unstable.

    Args:
        models: one for each trial.
        motion: known already, and its silhouette moments, where the models differ in their cameras only.
    """
    found: list[np.ndarray | None] = []
    for model in models:
        try:
            found.append(model.observe(motion[0], model.start, motion[1]) if motion else model.predict(model.start))
        except SimulationError:
            found.append(None)
    return found


def size_of(candidate: Candidate, trial: dict[str, float]) -> tuple[str, float]:
    """The coefficient that is farthest from its null in a trial, and how far [its unit]; 1 where the null is no number
    that a straight line leads to.
    """
    null = candidate.effect.null
    name = max(null, key=lambda other: abs(trial[other] - null[other]))
    return name, 1.0 if candidate.discrete else trial[name] - null[name]


def usual_fault(scores: Sequence[Score], name: str) -> float:
    """By how much faults of the kind of this one are larger in a typical camera than noise, at least 1.

    Replicates do not know how wrong a shape is where the reconstruction did not look, and that differs from view to
    view; so the cameras themselves are the null (Efron 2004): their median deviate has to be that of a normal one.
    """
    kind, at, _ = name.partition("@")
    deviates = [
        float(np.sqrt(max(one.gain, 0.0) / len(one.coefficient)))
        for one in scores
        if at and one.name.startswith(kind + "@")
    ]
    return max(1.0, float(np.median(deviates)) / MEDIAN_DEVIATE) if len(deviates) >= LEAST_CAMERAS else 1.0


def _whole(signature: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """A signature [(D,)] among all entries of the recording, zero elsewhere."""
    found = np.zeros(mask.shape)
    found[mask] = signature
    return found.ravel()
