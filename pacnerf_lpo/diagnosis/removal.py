"""The removal step: an effect that was found early may be superfluous once others are in the model."""

from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.refitting import against_without
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.mpm.effects.base import Effect


def superfluous(problem: Problem, found: Round) -> list[Effect]:
    """Effects of a fitted model without which it explains the data as well: the model is fitted again without each of
    them, and the effect is scored against that as any other. Those of the run itself stay, and those without which the
    motion is unstable.
    """
    assert found.screening is not None
    gone = []
    for effect in found.effects[len(problem.physics.effects) :]:
        kept = tuple(other for other in found.effects if other is not effect)
        try:
            again = against_without(problem, kept, effect, name_of(effect), found.comparison, found.screening)
        except SimulationError:
            continue
        if again.p_value >= LEVEL:
            gone.append(effect)
    return gone
