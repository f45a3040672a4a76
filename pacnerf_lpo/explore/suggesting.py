"""What would help a model as it stands: every effect of the catalogue, scored by the change that it would make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.refitting import starts
from pacnerf_lpo.diagnosis.screening import judge, probe
from pacnerf_lpo.explore.noise import comparison_at
from pacnerf_lpo.explore.records import Step, Suggestion
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.evidence import Score
from pacnerf_lpo.report.wording import readable

if TYPE_CHECKING:
    from pacnerf_lpo.explore.session import Session

NORMAL = 1.645
"""Standard deviations to either side in which nine tenths of a normal distribution lie."""


def suggest(session: Session, step: Step, progress: Callable[[str], None]) -> list[Suggestion]:
    """Every effect that could be added to a step and changes something, best first.

    What is left is that of the fine body; what effects and parameters change is that of the coarse one, which small
    changes move alike. Scores, their noise and the p-value of the selection are those of a diagnosis' screening.

    Raises:
        SimulationError, Stopped: as :meth:`Session.suggest`.
    """
    problem, effects = session.problem, session.catalogue.chosen(step.effects)
    noise = session.noise.of(step, progress).comparison
    progress("what is left of the residual")
    residual = problem.residual(session.rolled(step, "refined").predicted)
    now = comparison_at(problem, effects, step.values, residual)
    kept = {name: getattr(noise, name) for name in ("replicates", "sensor", "shape_errors", "discretisation", "force")}
    comparison = replace(now, **kept)
    candidates = session.catalogue.candidates(step.effects)
    probes = probe(problem, effects, comparison, candidates, progress, problem.coarse_model)
    progress("scores of all effects")
    screening = judge(problem, comparison, probes)
    by_name = {candidate.name: candidate for candidate in candidates}
    return [
        _suggestion(by_name[score.name], score, screening.p_value(score.name, score.log_bayes_factor))
        for score in screening.scores
        if score.name in by_name
    ]


def _suggestion(candidate: Candidate, score: Score, p_value: float) -> Suggestion:
    effect, null = candidate.effect, candidate.effect.null
    values = {name: _within(candidate, name, value) for name, value in starts(candidate, score)[0].items()}
    intervals = {}
    if not candidate.discrete and (candidate.joint or len(null) == 1):
        for name, error in zip(null, score.error, strict=True):
            intervals[name] = values[name] - NORMAL * error, values[name] + NORMAL * error
    return Suggestion(
        candidate.name,
        readable(candidate.name),
        score.log_bayes_factor,
        p_value,
        p_value < LEVEL and score.log_bayes_factor > 0,
        values,
        intervals,
        {name: parameter.unit for name, parameter in effect.parameters.items()},
        effect.signature,
        effect.confused_with,
        effect.separating_experiment,
    )


def _within(candidate: Candidate, name: str, value: float) -> float:
    """A value that the effect can have."""
    low, high = candidate.effect.parameters[name].bounds
    inside = 1e-6 * (high - low)
    return float(np.clip(value, low + inside, high - inside)) if np.isfinite(inside) else value
