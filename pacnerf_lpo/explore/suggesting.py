"""What would help a model as it stands: every effect of the catalogue, scored by the change that it would make.

All on the coarse body, without pictures: such questions take many rollouts, in several processes.
"""

from contextlib import suppress
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison, standardised
from pacnerf_lpo.diagnosis.refitting import Ahead, Refit, refit, starts
from pacnerf_lpo.diagnosis.screening import Screening, judge, probe
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.explore.noise import Noise
from pacnerf_lpo.explore.records import Suggestion
from pacnerf_lpo.explore.stepping import Stepper
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress, each, workers
from pacnerf_lpo.identification.study import StudyProblem
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.evidence import Score
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.report.wording import readable

MOST = 4
"""Effects that are fitted: no more than these move a body in the same way, such as drags, gravity and a wind."""
NORMAL = 1.645
"""Standard deviations to either side in which nine tenths of a normal distribution lie."""
LARGE = ("data", "state", "run", "stage", "_coarse", "_as_reconstructed")
"""What a problem holds and no model of it needs."""


def suggest(stepper: Stepper, noise: Noise, progress: Progress) -> list[Suggestion]:
    """Effects that could be added to the current step and change something, best first. Raises as
    :meth:`Session.suggest`.

    The model is fitted from where it stands, on the coarse body: what is left then is what parameters cannot explain.
    Effects are screened at that fit, and those that could be the best are fitted with all parameters, as a round of a
    diagnosis does it on the fine body.
    """
    step, catalogue = stepper.history.current, stepper.catalogue
    problem, effects = on_coarse_body(stepper.problem), catalogue.chosen(step.effects)
    learnt = noise.of(step, progress).comparison
    progress("fitting the model as it is")
    model = problem.model(effects, step.values)
    known = learnt.names == model.names and learnt.jacobian.shape[-1] == len(model.names)
    changes = learnt.jacobian if known else None
    null = standardised(problem, model, model.start, changes, learnt.errors, progress, "rough")
    candidates = [replace(candidate, quick=True) for candidate in catalogue.candidates(step.effects)]
    screening = judge(problem, null, probe(problem, effects, null, candidates, progress))
    by_name = {candidate.name: candidate for candidate in candidates}
    scores = [score for score in screening.scores if score.name in by_name]
    best = [by_name[score.name] for score in scores if score.log_bayes_factor > 0][:MOST]
    refits = _fitted(problem, effects, null, best, screening, progress)
    found = [_suggestion(by_name[one.name], one, screening, refits.get(one.name)) for one in scores]
    return sorted(found, key=lambda one: (not one.fitted, -one.log_bayes_factor))


def _fitted(
    problem: Problem,
    effects: tuple[Effect, ...],
    null: Comparison,
    chosen: list[Candidate],
    screening: Screening,
    progress: Progress,
) -> dict[str, Refit]:
    """Refits by name, as many at a time as there are processes; one that cannot reach the best so far is given up."""
    found: dict[str, Refit] = {}
    while chosen:
        now, chosen = chosen[: workers()], chosen[workers() :]
        least = min((one.cost for one in found.values()), default=np.inf)
        quickly = partial(refit, progress=lambda _: None, ahead=Ahead(least), how="quickly")
        tried = each(quickly, ((problem, effects, null, one, screening) for one in now))
        for candidate, again in zip(now, tried, strict=True):
            progress(f"fitted with {candidate.name}")
            if again is not None:
                found[candidate.name] = again
    return found


def warm(stepper: Stepper, progress: Progress, copies: int) -> None:
    """Let every process compile the kernels of all effects, by the first frame of a rollout with each."""
    problem, step = on_coarse_body(stepper.problem), stepper.history.current
    effects = stepper.catalogue.chosen(step.effects)
    more = [one.effect for one in stepper.catalogue.candidates(step.effects) if one.effect.acts_on_motion]
    models = [problem.model((*effects, effect), {**step.values, **effect.null}) for effect in more]
    for number, _ in enumerate(each(_first_frame, ((model,) for model in models for _ in range(copies))), 1):
        progress(f"compiling the kernels of all effects: {number} of {copies * len(models)}")


def _first_frame(model: Model) -> None:
    """Roll a model out as far as its kernels need to be compiled; an effect may be unstable at its null."""
    for one in getattr(model, "models", [model]):
        one.frames = 2
        with suppress(SimulationError):
            one.path(one.start)


def _suggestion(candidate: Candidate, score: Score, screening: Screening, again: Refit | None) -> Suggestion:
    effect = candidate.effect
    if again is None:
        factor = score.log_bayes_factor
        p_value = screening.p_value(factor)
        values = {name: _within(candidate, name, value) for name, value in starts(candidate, score)[0].items()}
        intervals = _intervals(candidate, score, values)
    else:
        factor, p_value = again.log_bayes_factor, again.p_value
        values = {name: again.known[name] for name in effect.parameters}
        intervals = {one.name: (one.low, one.high) for one in again.intervals if one.name in values}
    return Suggestion(
        candidate.name,
        readable(candidate.name),
        factor,
        p_value,
        p_value < LEVEL and factor > 0,
        again is not None,
        values,
        intervals,
        {name: parameter.unit for name, parameter in effect.parameters.items()},
        effect.signature,
        effect.confused_with,
        effect.separating_experiment,
    )


def _intervals(candidate: Candidate, score: Score, values: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Of coefficients that a score gives, as far as the effect can have them: none where the value to begin with is
    not that of the score, which is a straight line and leads too far.
    """
    if candidate.discrete or len(score.error) != len(candidate.effect.null):
        return {}
    found = {}
    estimates = zip(candidate.effect.null.items(), score.coefficient, score.error, strict=True)
    for (name, null), coefficient, error in estimates:
        if np.isclose(values[name], null + coefficient):
            ends = (values[name] - NORMAL * error, values[name] + NORMAL * error)
            found[name] = (_within(candidate, name, ends[0]), _within(candidate, name, ends[1]))
    return found


def _within(candidate: Candidate, name: str, value: float) -> float:
    """A value that the effect can have."""
    low, high = candidate.effect.parameters[name].bounds
    inside = 1e-6 * (high - low)
    return float(np.clip(value, low + inside, high - inside)) if np.isfinite(inside) else value


def on_coarse_body(problem: Problem) -> Problem:
    """A copy whose models move the coarse body. How that differs from the fine one is among the errors of resolution
    that every noise model knows, as one standard deviation.
    """
    found = copy(problem)
    if isinstance(found, StudyProblem):
        found.recordings = [on_coarse_body(recording) for recording in found.recordings]
        return found
    for name in LARGE:
        vars(found).pop(name, None)
    vars(found).update(body=problem.coarse_body, first_guess=problem.first_guess, video=problem.without_pictures)
    return found
