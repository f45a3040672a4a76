"""What every hypothesis would change, by one simulation for each probe, and how well that explains the residual."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, f
from torch import Tensor

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model, outcome
from pacnerf_lpo.identification.model_errors import FORCES, SHAPES
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress, each
from pacnerf_lpo.identification.standardised import spread
from pacnerf_lpo.inference.calibration import Calibration, Fitted, calibrate, dispersion_of
from pacnerf_lpo.inference.classes import correlation
from pacnerf_lpo.inference.decision import LEVEL, believed
from pacnerf_lpo.inference.evidence import Alternative, Score, score
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.inference.noise import NoiseModel
from pacnerf_lpo.mpm.effects.base import Effect

FORCE, SHAPE = "UnknownForce", "WrongShape"
"""Hypotheses that are no effect of the catalogue: a smooth force on the body, and errors of the reconstruction."""
LEAST_CAMERAS = 4
"""Other views whose faults of one kind show how large such residuals are by themselves: the median of fewer says little
more than one of them."""
EFFICIENCY = 0.37
"""Of a variance by the median: so many degrees of freedom are each other camera's (Rousseeuw and Croux 1993)."""
PARALLEL = 1e-6
"""Part of a fault, of its size, below which another one explains it all."""
LEAST_CHANGE = 1e-4
"""A trial that moves no silhouette moment by so much [pixels] changes nothing."""


@dataclass(frozen=True)
class Screening:
    """All hypotheses, ranked by how well their linear change explains the residual.

    scores: best first.
    calibration: what they are compared with.
    outside: names of the faults of held-out cameras, which are fitted to other data.
    correlations: of the signatures, in the order of ``scores`` [(K, K)]
    """

    scores: list[Score]
    calibration: Calibration
    outside: list[str]
    correlations: np.ndarray

    def score(self, name: str) -> Score | None:
        """Of a hypothesis; None if it changes nothing that can be seen."""
        return next((found for found in self.scores if found.name == name), None)

    def p_value(self, log_bayes_factor: float) -> float:
        """Probability that the best of all hypotheses reaches this where nothing is missing."""
        return self.calibration.p_value(log_bayes_factor)

    def scale(self, name: str) -> float:
        """Factor on the noise along a hypothesis; that of a typical one where it changes nothing that can be seen."""
        return self.calibration.scales.get(name, self.usual_scale)

    @property
    def usual_scale(self) -> float:
        """Factor on the noise along a typical effect; those of camera faults are relative to the other cameras."""
        scales = self.calibration.scales
        return float(np.median([scale for name, scale in scales.items() if "@" not in name]))

    @property
    def threshold(self) -> float:
        """Of the log Bayes factor of the best hypothesis."""
        return self.calibration.threshold


@dataclass(frozen=True)
class Probes:
    """Every candidate as a hypothesis about the usable entries, before anything is judged.

    hypotheses: effects, and faults of all cameras.
    outside: names of the faults of held-out cameras.
    simulated: simulations that they took.
    """

    hypotheses: list[Hypothesis]
    outside: list[str]
    simulated: int


def probe(
    problem: Problem,
    effects: Sequence[Effect],
    comparison: Comparison,
    candidates: Sequence[Candidate],
    progress: Progress,
) -> Probes:
    """Try every candidate at the fitted model, see :func:`probed`."""
    outside = [candidate.name for candidate in candidates if problem.of_held_camera(candidate.effect)]
    null, free = problem.model(effects, comparison.known), comparison.free
    found, simulated = probed(problem, effects, null, free, candidates, problem.usable, progress)
    return Probes(found, outside, simulated)


def judge(problem: Problem, comparison: Comparison, probes: Probes) -> Screening:
    """Score every hypothesis by all data, the discrepancies among them, and calibrate the selection among all on the
    replicates.
    """
    mask = problem.usable
    hypotheses = [*probes.hypotheses, *discrepancies(comparison, mask)]
    noise, residual = comparison.marginal(problem, mask), np.nan_to_num(comparison.residual[mask])
    parts = {}
    for held in {one.name in probes.outside for one in hypotheses}:
        entries = problem.of_all_cameras if held else comparison.fitted
        parts[held] = Fitted(entries[mask], noise.among(entries[mask]))
    fitted = [parts[one.name in probes.outside] for one in hypotheses]
    calibration = calibrate(noise, hypotheses, fitted, LEVEL, dispersion_of(noise, residual))
    usual = usual_faults(noise, residual, hypotheses, calibration.scales)
    factors = {name: found.factor(calibration.dof) for name, found in usual.items()}
    scales = {name: s * factors.get(name, 1.0) for name, s in calibration.scales.items()}
    scores = []
    for one, part in zip(hypotheses, fitted, strict=True):
        found = score(noise, residual, one, scales[one.name])
        own = score(part.noise, residual[part.rows], part.of(one), scales[one.name]).log_bayes_factor
        factor = float(believed(found.log_bayes_factor, own))
        signature = np.nan_to_num(spread(found.signature, mask)).ravel()
        scores.append(replace(found, log_bayes_factor=factor, signature=signature))
    scores.sort(key=lambda one: -one.log_bayes_factor)
    signatures = np.stack([one.signature for one in scores])
    return Screening(scores, replace(calibration, scales=scales), probes.outside, correlation(signatures))


def discrepancies(comparison: Comparison, mask: np.ndarray) -> list[Hypothesis]:
    """What is no effect of the catalogue, in the entries of a mask [(R, F, 11), bool]."""
    errors = comparison.errors
    causes = (FORCE, errors.force, FORCES), (SHAPE, errors.reconstruction, tuple(size for size in SHAPES if size > 1))
    return [
        Hypothesis(name, (changes[mask],), (np.ones(changes.shape[-1]),), spreads=sizes)
        for name, changes, sizes in causes
        if changes.shape[-1]
    ]


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
        effects, null, free: of the fitted model, it, and its coordinates [(K,)]
        candidates: effects to try in addition to those of the model.
        mask: entries to return.
    """
    path, known = null.path(free), null.physical(free)
    before = null.observe(path, free)
    trials = [candidate.trials() for candidate in candidates]
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
        shown: list[tuple[np.ndarray, float, float]] = []
        for trial, after in zip(tried, predicted, strict=True):
            moved = after - before if isinstance(after, np.ndarray) else 0 * before
            change = np.nan_to_num(problem.relative(moved)[mask])
            if candidate.joint or np.abs(change).max() > LEAST_CHANGE:
                name, size = size_of(candidate, trial)
                shown.append((change, size, 1.0 if candidate.discrete else candidate.width(name)))
        if any(np.abs(change).max() > LEAST_CHANGE for change, *_ in shown):
            columns, sizes, widths = zip(*shown, strict=True)
            arrays = np.stack(columns, axis=1), np.array(sizes), np.array(widths)
            prior = candidate.effect.one_sided, candidate.components, candidate.spreads
            found.append(Hypothesis.of_probes(candidate.name, *arrays, *prior))
    return found, sum(len(tried) for c, tried in zip(candidates, trials, strict=True) if not c.observes)


def _seen(models: Sequence[Model], motion: tuple[Tensor, np.ndarray] | None) -> list[np.ndarray | SimulationError]:
    """What the models of some trials predict at their start [(R, F, 11)], or what went wrong. The motion is known, with
    its silhouette moments, where the models differ in their cameras only.
    """
    if motion is None:
        return [outcome(model) for model in models]
    return [model.observe(motion[0], model.start, motion[1]) for model in models]


def size_of(candidate: Candidate, trial: dict[str, float]) -> tuple[str, float]:
    """The coefficient that is farthest from its null in a trial, and how far [its unit]; 1 where the null is no number
    that a straight line leads to.
    """
    null = candidate.effect.null
    name = max(null, key=lambda other: abs(trial[other] - null[other]))
    return name, 1.0 if candidate.discrete else trial[name] - null[name]


class Usual(NamedTuple):
    """How a camera fault compares with those of its kind in the other cameras.

    scale: by how much a typical one is larger than noise, at least 1.
    others: how many tell it.
    square, size: mean square of the fault's own coordinates, in units of the noise, and their number.
    """

    scale: float
    others: int
    square: float
    size: int

    def factor(self, dof: float) -> float:
        """On the scale of the noise along the fault. It makes it as rare by the tails that a selection is simulated
        with, of a variance known with so many degrees of freedom, as it is by its own: of that variance and what the
        other cameras show beyond it, known from a few of them only (Satterthwaite 1946).
        """
        excess, square = self.scale**2 - 1, self.square / self.scale**2
        if excess <= 0 or square <= 0:
            return self.scale
        own = self.scale**4 / (1 / dof + excess**2 / (EFFICIENCY * self.others))
        return self.scale * max(1.0, float(np.sqrt(square / f.isf(f.sf(square, self.size, own), self.size, dof))))


def usual_faults(
    noise: NoiseModel, residual: np.ndarray, hypotheses: Sequence[Hypothesis], scales: Mapping[str, float]
) -> dict[str, Usual]:
    """Every camera fault beside those of its kind in the other cameras.

    Replicates do not know how wrong a shape is where the reconstruction did not look, and that differs from view to
    view; so the other cameras are the null (Efron 2004): their median deviate has to be that of noise. It is taken
    beside the fault in question, which shows in all cameras as the fitted motion gives way to it.

    Args:
        noise, residual: of all data (D,)
        hypotheses: camera faults and others.
        scales: factor on the noise along each.
    """
    faults = [one for one in hypotheses if "@" in one.name]
    if not faults:
        return {}
    tried = Alternative.of_all(noise, faults)
    axes = {one.name: alternatives[0].axes for one, alternatives in zip(faults, tried, strict=True)}
    left, found = noise.whiten_residual(residual), {}
    for name, own in axes.items():
        kind, along = name.partition("@")[0] + "@", own.T @ left
        others = {other: found for other, found in axes.items() if other.startswith(kind) and other != name}
        beside = left - own @ along
        deviates = []
        for other, directions in others.items():
            free = directions - own @ (own.T @ directions)
            change = free @ np.linalg.lstsq(free, beside, rcond=PARALLEL)[0]
            deviates.append(np.sqrt(change @ change / chi2.median(free.shape[1])) / scales[other])
        scale = max(1.0, float(np.median(deviates))) if len(deviates) >= LEAST_CAMERAS else 1.0
        found[name] = Usual(scale, len(deviates), float((along**2).mean()) / scales[name] ** 2, len(along))
    return found
