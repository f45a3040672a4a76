"""A model without each of its effects: one that was found early may be superfluous once others are in the model."""

from dataclasses import dataclass

from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.refitting import against_without
from pacnerf_lpo.diagnosis.rounds import Round
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
    and those without which the motion is unstable. An effect is superfluous if what it adds is no rarer than a false
    alarm; what was held out can keep it, too, for it has won before.
    """
    assert found.screening is not None
    looks = []
    for effect in found.effects[len(problem.physics.effects) :]:
        kept, name = tuple(other for other in found.effects if other is not effect), name_of(effect)
        try:
            again, known = against_without(problem, kept, effect, name, found.comparison, found.screening)
        except SimulationError:
            continue
        looks.append(Without(name, effect, known, again.p_value >= LEVEL and again.whole <= DECISIVE))
    return looks
