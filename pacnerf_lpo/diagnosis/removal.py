"""A model without each of its effects: one that was found early may be superfluous once others are in the model."""

from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.refitting import against_without
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.screening import Screening
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.decision import DECISIVE, LEVEL, LINEAR, log_bayes_factor, log_occam_factor
from pacnerf_lpo.mpm.effects.base import Effect


@dataclass(frozen=True)
class Without:
    """A fitted model without one of its effects, fitted again.

    name, effect: that it is without.
    known: values of it [SI]
    superfluous: whether it explains the data as well.
    simulated: simulations that it took.
    """

    name: str
    effect: Effect
    known: dict[str, float]
    superfluous: bool
    simulated: int = 0


def without_each(problem: Problem, found: Round) -> list[Without]:
    """A fitted model without each of its effects, in the order in which they were added. Those of the run itself stay,
    and those without which the motion is unstable.
    """
    assert found.screening is not None
    added = found.effects[len(problem.physics.effects) :]
    looks = [_without(problem, found, effect, found.screening) for effect in added]
    return [look for look in looks if look is not None]


def newest_is_needed(problem: Problem, before: Round, found: Round) -> tuple[bool, int]:
    """Whether the effect that one round has added is still needed in the model of the next one, whose errors were
    learnt again around it: it has won beside those of the model without it. And the simulations that it took.
    """
    screening = before.screening
    assert screening is not None
    if screening.p_value(LINEAR * _by_a_line(problem, found, screening)) < LEVEL:
        return True, 0
    look = _without(problem, found, found.effects[-1], screening)
    return (True, 0) if look is None else (not look.superfluous, look.simulated)


def _by_a_line(problem: Problem, found: Round, screening: Screening) -> float:
    """Log Bayes factor of the newest effect of a model by the slopes at its fit; 0 where no line leads to the null."""
    effect, comparison, mask = found.effects[-1], found.comparison, found.comparison.fitted
    if effect.discrete:
        return 0.0
    unknowns = problem.model(found.effects, comparison.known).unknowns
    own = np.isin(comparison.names, list(effect.parameters))
    nulls = [one.transform.to_free(effect.null[one.name]) for one, new in zip(unknowns, own, strict=True) if new]
    away = (comparison.free[own] - nulls) / comparison.deviation[own]
    rows = comparison.noise(problem, mask).whiten(comparison.changes(mask))
    covariance = np.linalg.inv(rows.T @ rows + np.eye(len(own)))[np.ix_(own, own)]
    without = comparison.cost + float(away @ np.linalg.solve(covariance, away))
    occam = log_occam_factor(rows[:, ~own], rows[:, own])
    return log_bayes_factor(without, comparison.cost, int(mask.sum()), occam, screening.scale(name_of(effect)))


def _without(problem: Problem, found: Round, effect: Effect, screening: Screening) -> Without | None:
    """The model of a round without an effect; None where the motion is unstable then. The effect is superfluous if what
    it adds is no rarer than a false alarm; what was held out can keep it, too, for it has won before.
    """
    kept = tuple(other for other in found.effects if other is not effect)
    try:
        again, known = against_without(problem, kept, effect, found.comparison, screening)
    except SimulationError:
        return None
    return Without(again.name, effect, known, again.p_value >= LEVEL and again.whole <= DECISIVE, again.simulated)
