"""``diagnosis.json`` and ``effects.yaml``: what a diagnosis has found, as plain numbers and sentences."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis import localising
from pacnerf_lpo.diagnosis.catalogue import Candidate, name_of
from pacnerf_lpo.diagnosis.comparison import solver_errors
from pacnerf_lpo.diagnosis.contributions import recordings
from pacnerf_lpo.diagnosis.overlay import overlay
from pacnerf_lpo.diagnosis.refitting import Refit
from pacnerf_lpo.diagnosis.residual_force import ResidualForce
from pacnerf_lpo.diagnosis.rounds import Round, accepted_names, verdict
from pacnerf_lpo.diagnosis.screening import FORCE, SHAPE, Screening, size_of
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.inference.checks import Check
from pacnerf_lpo.inference.decision import LEVEL, log_odds
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.quantities import published
from pacnerf_lpo.report import wording
from pacnerf_lpo.report.diagnosis import FORMAT, RESULT
from pacnerf_lpo.report.diagnosis_stages import errors_of, stages_of
from pacnerf_lpo.report.flights import agreement, flights
from pacnerf_lpo.report.page import plain

OVERLAY, OVERLAY_OF = "effects.yaml", "effects_{}.yaml"
MOST_CORRELATIONS = 30


def write(problem: Problem, folder: Path, rounds: list[Round], finished: bool = True) -> None:
    """Write diagnosis.json and, where effects were found that explain the recording, the overlay effects.yaml;
    ``finished``: whether these are all rounds.
    """
    write_atomically(folder / RESULT, json.dumps(summary(problem, rounds, finished), indent=1).encode())
    if verdict(rounds).kind in ("missing", "camera"):
        values = (rounds[-1].accepted or rounds[-1].best).known
        for part in problem.parts(stages_of(rounds)[-1].effects, values):
            name = OVERLAY if part.recording is problem else OVERLAY_OF.format(part.name)
            write_atomically(folder / name, overlay(part.recording, part.effects, part.known).encode())
    else:
        for path in [folder / OVERLAY, *folder.glob(OVERLAY_OF.format("*"))]:
            path.unlink(missing_ok=True)


def summary(problem: Problem, rounds: list[Round], finished: bool = True) -> dict[str, Any]:
    """Everything a report shows; ``finished``: whether these are all rounds."""
    video, split, force = problem.video, problem.split, rounds[-1].force
    said = verdict(rounds)
    described = [_round(problem, found) for found in rounds]
    last = {one["name"]: published(one) for one in described[-1]["parameters"]}
    sentences = wording.verdict(problem.physics.material, rounds, said, last)
    stages = stages_of(rounds)
    shown = flights(problem, stages, rounds) if not problem.views else []
    turned = agreement(shown)
    sentences += [turned] if turned else []
    sentences += [wording.GOES_ON] if not finished and said.kind != "unfinished" else []
    return {
        "format": FORMAT,
        "scene": problem.scene,
        "views": list(video.view_ids),
        "frames": list(video.frame_ids),
        "times": video.times.tolist(),
        "held_views": [video.view_ids[v] for v in np.flatnonzero(~split.views)],
        "held_frames": [video.frame_ids[f] for f in np.flatnonzero(~np.atleast_2d(split.frames).any(0))],
        "verdict": {
            "kind": said.kind,
            "finished": finished,
            "effects": said.names if said.kind != "unknown" else [],
            "nearest": said.names if said.kind == "unknown" else [],
            "more_than_noise": said.more_than_noise,
            "doubt": said.kind == "nothing" and wording.doubt(rounds[-1]) is not None,
            "removed": said.removed,
            "p_value": _chance(rounds),
            "sentence": sentences[0],
            "details": sentences[1:],
        },
        "unit": problem.unit[0],
        "recordings": recordings(problem, rounds),
        "points": problem.point_names,
        "stages": [errors_of(problem, stage) for stage in stages],
        "flights": shown,
        "rounds": described,
        "residual_force": None if force is None else _force(force, wording.force_is_determined(rounds[-1], said)),
    }


def _chance(rounds: list[Round]) -> float | None:
    """Largest p-value of the effects that were named; where there are none, that of the best of all hypotheses before
    any was fitted, the selection whose chances are simulated; None where the diagnosis stopped before.
    """
    named, screening = accepted_names(rounds), rounds[-1].screening
    found = [r.accepted.p_value for r in rounds if r.accepted and r.accepted.name in named]
    if found or screening is None:
        return max(found, default=None)
    return screening.p_value(screening.scores[0].log_bayes_factor)


def _round(problem: Problem, found: Round) -> dict[str, Any]:
    comparison = found.comparison
    unknowns = problem.model(found.effects, comparison.known).unknowns
    odds, effects = {}, [name_of(effect) for effect in found.effects]
    errors = solver_errors(problem, found.effects, found.best, found.parameters)
    if found.screening is not None:
        contenders = [again.contender for again in found.refits]
        odds = log_odds(contenders, int(problem.usable.sum()), found.screening.usual_scale)
    return {
        "effects": effects,
        "parameters": [{**one, **errors[one["name"]].as_json()} for one in _intervals(found.parameters, unknowns)],
        "notes": list(found.best.notes),
        "left_out": [
            *(wording.unstable(name, name in effects, why) for name, why in found.left_out.items()),
            *map(wording.unconfirmed, found.unconfirmed),
        ],
        "undetermined": found.undetermined,
        "disagreement": found.best.dispersion,
        "profiles": {name: list(ends) for name, ends in found.profiles.items()},
        "check": _check(found.check),
        "check_held": _check(found.held),
        "shape_errors": comparison.errors.size if comparison.errors.shape.shape[-1] else None,
        "phases": found.phases[0],
        "excess": plain(localising.excess(comparison.residual, comparison)[: problem.views]),
        "floor": plain(localising.mean_of_outlines(localising.floor(comparison)[1][: problem.views])),
        "error": _errors(problem, comparison.residual, found),
        "screen": None if found.screening is None else _screen(found.screening, found.candidates),
        "refits": [{**_refit(problem, again, found), "log_odds": odds[again.name]} for again in found.refits],
        "accepted": None if found.accepted is None else found.accepted.name,
        "indistinguishable": found.indistinguishable,
        "plan": [asdict(proposal) for proposal in found.proposals],
        "removed": found.removed,
        "effort": found.effort,
    }


def _check(check: Check) -> dict[str, Any]:
    return {"statistic": check.statistic, "replicates": check.replicates.tolist(), "p_value": check.p_value}


def _errors(problem: Problem, residual: np.ndarray, found: Round) -> dict[str, float]:
    """Excess error in the fitted and in the held-out views and frames, 0 below the floor [the problem's unit]."""
    squares = localising.mean_excess(problem, residual, found.comparison)
    return {name: problem.unit[1] * float(np.sqrt(max(square, 0.0))) for name, square in squares.items()}


def _screen(screening: Screening, candidates: list[Candidate]) -> dict[str, Any]:
    by_name = {candidate.name: candidate for candidate in candidates}
    scores = [score for score in screening.scores if score.name in by_name]
    kept = [k for k, score in enumerate(screening.scores) if score.name in by_name][:MOST_CORRELATIONS]
    return {
        "threshold": screening.threshold,
        "level": LEVEL,
        "correlations": np.round(screening.correlations[np.ix_(kept, kept)], 3).tolist(),
        "discrepancies": {
            name: {"log_bayes_factor": one.log_bayes_factor, "p_value": screening.p_value(one.log_bayes_factor)}
            for name in (FORCE, SHAPE)
            if (one := screening.score(name)) is not None
        },
        "candidates": [
            {
                "name": score.name,
                "readable": wording.readable(score.name),
                "camera": "@" in score.name,
                "log_bayes_factor": score.log_bayes_factor,
                "p_value": screening.p_value(score.log_bayes_factor),
                "coefficient": list(score.coefficient),
                "interval": [
                    [c - 1.645 * e, c + 1.645 * e] for c, e in zip(score.coefficient, score.error, strict=True)
                ],
                "strength": score.strength,
                **described(by_name[score.name], len(score.coefficient), score.alternative),
            }
            for score in scores
        ],
    }


def described(candidate: Candidate, count: int, alternative: int) -> dict[str, Any]:
    """What a reader has to know of a candidate to read its score: of so many coefficients that were estimated, and of
    the trial that explains most.
    """
    effect, trials = candidate.effect, candidate.trials()
    names = list(effect.null)[:count]
    if not candidate.joint:
        names = [size_of(candidate, trials[min(alternative, len(trials) - 1)])[0]]
    parameters = [effect.parameters[name] for name in names]
    return {
        "discrete": candidate.discrete,
        "one_sided": effect.one_sided,
        "signature": effect.signature,
        "separating_experiment": effect.separating_experiment,
        "coefficients": [
            {"name": p.name, "label": p.label, "unit": p.unit, "null": effect.null[p.name]} for p in parameters
        ],
    }


def _refit(problem: Problem, again: Refit, found: Round) -> dict[str, Any]:
    candidate = found.candidate(again.name)
    unknowns = problem.model([*found.effects, candidate.effect], again.known).unknowns
    return {
        "name": again.name,
        "readable": wording.readable(again.name),
        "camera": candidate.observes,
        "signature": candidate.effect.signature,
        "separating_experiment": candidate.effect.separating_experiment,
        "values": {one["name"]: one for one in _intervals(again.intervals, unknowns)},
        "cost_without": again.cost_without,
        "cost": again.cost,
        "held_cost_without": again.held_without.cost,
        "held_cost": again.held.cost,
        "log_bayes_factor": again.log_bayes_factor,
        "p_value": again.p_value,
        "notes": list(again.notes),
        "excess": plain(localising.excess(again.residual, found.comparison)[: problem.views]),
        "error": _errors(problem, again.residual, found),
    }


def _force(force: ResidualForce, determined: bool) -> dict[str, Any]:
    return {
        "determined": determined,
        "times": force.times.tolist(),
        "mean": np.round(force.mean, 4).tolist(),
        "field": np.round(force.field, 4).tolist(),
        "explained": force.explained,
        "terms": [asdict(term) for term in force.law.terms],
        "terms_explain": force.law.explained,
    }


def _intervals(intervals: Sequence[Interval], unknowns: Sequence[Parameter]) -> list[dict[str, Any]]:
    described = {parameter.name: parameter for parameter in unknowns}
    return [
        {**asdict(interval), "unit": described[interval.name].unit, "label": described[interval.name].label}
        for interval in intervals
    ]
