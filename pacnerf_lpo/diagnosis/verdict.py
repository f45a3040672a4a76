"""The verdict of a diagnosis, in one word and in sentences."""

from __future__ import annotations

from itertools import zip_longest

import numpy as np

from pacnerf_lpo.diagnosis import wording
from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.rounds import (
    Round,
    asks_for_an_effect,
    beyond_noise,
    fails_held_out,
    glaring,
    is_force,
    left_over,
    times_noise,
)
from pacnerf_lpo.diagnosis.screening import FALSE_ALARMS
from pacnerf_lpo.diagnosis.statistics.omnibus import Omnibus
from pacnerf_lpo.identification.problem import Problem

ENOUGH = 0.5
"""Accepted effects that remove less of the held-out error than this do not explain it."""


def verdict(problem: Problem, rounds: list[Round]) -> dict:
    """Its kind (nothing, missing, camera, unknown or unfinished), the effects named, whether more than noise is left
    beside them, or where nothing is missing, and sentences.
    """
    sentences: list[str] = []
    names: list[str] = []
    kind = "nothing"
    for number, found in enumerate(rounds, 1):
        if found.accepted is not None and found.screening is not None:
            again, following = found.accepted, rounds[number] if number < len(rounds) else None
            after = again.known if following is None else following.comparison.known
            alike = _not_told_apart(found)
            p = _chance(found, again.candidate)
            sentences.append(wording.missing(again.candidate, alike, p, removed(found, following), bool(names)))
            described = problem.physics.parameters
            changes = [
                wording.moved(described[i.name], i.value, after[i.name])
                for i in found.parameters
                if i.name in problem.physics.material.free_names
            ]
            sentences.append(f"{'; '.join(changes)}.")
            separation = wording.separation(again.candidate, alike)
            sentences += [separation] if separation else []
            names.append(again.candidate.name)
            kind = "camera" if again.candidate.observes else "missing"
    last = rounds[-1]
    if not names and last.screening is not None and not _unfinished(last):
        kind = "unknown" if unexplained(rounds) else "nothing"
        sentences.append(wording.UNKNOWN if kind == "unknown" else _nothing(last))
    elif not names:
        kind = "unfinished"
        noise = "more than" if beyond_noise(last) else "no more than"
        sentences.append(
            f"The residual is {noise} the model's own numerical error ({wording.probability(last.omnibus.p_value)})."
        )
    elif unexplained(rounds):
        kind = "unknown"
        sentences = [wording.UNKNOWN, wording.nearest(names, removed_by(rounds), _remaining(rounds))]
        names = []
    rest = left_over(last) if names else kind == "nothing" and (beyond_noise(last) or fails_held_out(last))
    if rest and names:
        sentences.append(wording.REST)
    if last.force is not None and (rest or kind == "unknown"):
        sentences += wording.force(last.force.explained, last.force.held.removed, last.force.law)
    return {"kind": kind, "effects": names, "rest": rest, "sentence": sentences[0], "details": sentences[1:]}


def _nothing(last: Round) -> str:
    """What to say where no effect is missing."""
    if beyond_noise(last):
        return wording.FAULTY
    return wording.ASIDE if fails_held_out(last) else wording.NOTHING


def _chance(found: Round, candidate: Candidate) -> float:
    """Family-wise p-value of an effect. One that the score test does not name was refitted because any effect on the
    body stands out or the residual is more than noise: it is as rare as the rarer of these two.
    """
    assert found.screening is not None
    if found.screening.names(candidate):
        return found.screening.p_value(candidate.name)
    standing_out = min((found.screening.p_value(c.name) for c in found.candidates if not c.observes), default=1.0)
    return min(2 * min(standing_out, found.omnibus.p_value), 1.0)


def unexplained(rounds: list[Round]) -> bool:
    """Whether more than noise is left that looks like a smooth force, or that is much more in the held-out data, or
    what was accepted removes less than half of the held-out error.
    """
    last = rounds[-1]
    if all(found.accepted is None for found in rounds):
        return asks_for_an_effect(last) and (glaring(last) or is_force(last))
    return left_over(last) and (is_force(last) or glaring(last) or removed_by(rounds) < ENOUGH)


def _remaining(rounds: list[Round]) -> str:
    """What the accepted effects leave, where that is no explanation."""
    if removed_by(rounds) < ENOUGH:
        return wording.MORE_THAN_HALF
    last = rounds[-1]
    return wording.LIKE_A_FORCE if is_force(last) else wording.times(times_noise(last.held))


def _unfinished(found: Round) -> bool:
    """Whether the diagnosis stopped before effects that passed the threshold were refitted, or before it was asked what
    the residual looks like.
    """
    passed = found.screening is not None and min(found.screening.p_values, default=1.0) < FALSE_ALARMS
    return (passed and not found.refits) or (asks_for_an_effect(found) and found.force is None)


def _not_told_apart(found: Round) -> list[str]:
    """The accepted effect, and those of its class that were accepted as well or not refitted."""
    assert found.accepted is not None and found.screening is not None
    name = found.accepted.candidate.name
    if name not in [score.name for score in found.screening.scores]:
        return [name]
    rejected = {again.candidate.name for again in found.refits if not again.verdict.accepted}
    return [other for other in found.screening.group(name) if other not in rejected]


def removed_by(rounds: list[Round]) -> float:
    """Share of the held-out error of the first model that all accepted effects remove together."""
    kept = 1.0
    for found, after in zip_longest(rounds, rounds[1:]):
        if found.accepted is not None:
            kept *= 1 - removed(found, after)
    return 1 - kept


def removed(found: Round, after: Round | None) -> float:
    """Share of the excess of the held-out error that the accepted effect removes: as the next pass has fitted it, each
    error in units of its own model's noise, for twins of a wrong model may be wrong as well. Where there was no such
    pass or no excess, and for a fault of one camera, as it was added.
    """
    assert found.accepted is not None
    before = excess(found.held)
    if after is None or before <= 0 or found.accepted.candidate.observes:
        return found.accepted.verdict.removed
    return 1 - max(excess(after.held), 0.0) / before


def excess(size: Omnibus) -> float:
    """Mean square of a residual above that of the twins."""
    return size.statistic - float(np.mean(size.twins))
