"""A model without each of its effects: one that was found early may be superfluous once others are in the model."""

from dataclasses import dataclass

from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.refitting import against_without
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.screening import Screening
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.decision import DECISIVE, LEVEL
from pacnerf_lpo.mpm.effects.base import Effect


@dataclass(frozen=True)
class Without:
    """A fitted model without one of its effects, fitted again.

    name, effect: that it is without.
    known: values of it [SI]
    superfluous: whether it explains the data as well.
    """

    name: str
    effect: Effect
    known: dict[str, float]
    superfluous: bool


def without_each(problem: Problem, found: Round) -> list[Without]:
    """A fitted model without each of its effects, in the order in which they were added. Those of the run itself stay,
    and those without which the motion is unstable.
    """
    assert found.screening is not None
    added = found.effects[len(problem.physics.effects) :]
    looks = [_without(problem, found, effect, found.screening) for effect in added]
    return [look for look in looks if look is not None]


def newest_is_needed(problem: Problem, before: Round, found: Round) -> bool:
    """Whether the effect that one round has added is still needed in the model of the next one, whose errors were
    learnt again around it: it has won beside those of the model without it.
    """
    assert before.screening is not None
    look = _without(problem, found, found.effects[-1], before.screening)
    return look is None or not look.superfluous


def _without(problem: Problem, found: Round, effect: Effect, screening: Screening) -> Without | None:
    """The model of a round without an effect; None where the motion is unstable then. The effect is superfluous if what
    it adds is no rarer than a false alarm; what was held out can keep it, too, for it has won before.
    """
    kept, name = tuple(other for other in found.effects if other is not effect), name_of(effect)
    try:
        again, known = against_without(problem, kept, effect, name, found.comparison, screening)
    except SimulationError:
        return None
    return Without(name, effect, known, again.p_value >= LEVEL and again.whole <= DECISIVE)
