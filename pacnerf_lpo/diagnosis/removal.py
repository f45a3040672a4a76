"""The removal step: an effect that was found early may be superfluous once others are in the model."""

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import SPREADS, name_of
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.evidence import score
from pacnerf_lpo.inference.hypotheses import Hypothesis
from pacnerf_lpo.mpm.effects.base import Effect


def superfluous(problem: Problem, found: Round) -> list[Effect]:
    """Effects of a fitted model without which it explains the data as well: each is scored as a hypothesis against the
    model in which it stands at its null, by the sensitivities at the fit. Non-local effects, which no straight line
    joins with their null, and those of the run itself stay.
    """
    comparison, mask = found.comparison, problem.fitted
    assert found.screening is not None
    gone = []
    for effect in found.effects[len(problem.physics.effects) :]:
        if effect.discrete:
            continue
        own = np.isin(comparison.names, list(effect.parameters))
        jacobian = comparison.jacobian[mask] * comparison.deviation
        null = problem.model(found.effects, {**comparison.known, **effect.null}).start
        moved = ((null - comparison.free) / comparison.deviation)[own]
        noise = comparison.noise(problem, mask).with_directions(jacobian[:, ~own])
        given = (-jacobian[:, own],), (comparison.deviation[own],)
        hypothesis = Hypothesis(name_of(effect), *given, spreads=SPREADS)
        without = comparison.residual[mask] + jacobian[:, own] @ moved
        scale = found.screening.scale(name_of(effect))
        factor = score(noise, without, hypothesis, scale).log_bayes_factor
        if found.screening.p_value(name_of(effect), factor) >= LEVEL:
            gone.append(effect)
    return gone
