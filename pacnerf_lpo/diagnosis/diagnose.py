"""The five steps, repeated until nothing more is missing: compare, localise, screen, refit, accept."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import yaml

from pacnerf_lpo.diagnosis import localising, pictures, wording
from pacnerf_lpo.diagnosis.catalogue import (
    Candidate,
    as_config,
    class_path,
    name_of,
    read_candidates,
    whole_catalogue,
)
from pacnerf_lpo.diagnosis.comparison import Comparison, compare, intervals, more_than_noise, searched
from pacnerf_lpo.diagnosis.profiles import profile
from pacnerf_lpo.diagnosis.refitting import Refit, refine, refit, worth_refitting
from pacnerf_lpo.diagnosis.residual_force import ResidualForce, residual_force
from pacnerf_lpo.diagnosis.rounds import (
    Round,
    above_floor,
    asks_for_an_effect,
    fires,
    leaves_more_than_noise,
)
from pacnerf_lpo.diagnosis.run_problem import RunProblem
from pacnerf_lpo.diagnosis.screening import FALSE_ALARMS, Screening, screen
from pacnerf_lpo.diagnosis.statistics.intervals import Interval
from pacnerf_lpo.diagnosis.statistics.omnibus import Omnibus
from pacnerf_lpo.diagnosis.store import FOLDER, Store
from pacnerf_lpo.diagnosis.verdict import removed_by, unexplained, verdict
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.identification.problem import PARTICLES, Problem
from pacnerf_lpo.identification.processes import check_jobs, processes
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import Parameter

Step = Literal["compare", "localise", "screen", "refit"]
RESULT, OVERLAY = "diagnosis.json", "effects.yaml"
LEAST_REFITS = 3
"""Effects on the body that are refitted, whatever their score, where the residual is more than noise."""
DECISIVE = 0.9
"""Accepted effects that remove more of the held-out error than this leave nothing for what no score singles out."""
ALIKE = 0.02
"""Shares of the held-out error that differ by no more than this count as the same."""


@dataclass
class Options:
    """Settings of a diagnosis.

    candidates: YAML list of the effects to try; None: all that the package knows.
    twins: simulated nulls, 8 to 24.
    effects: at most so many are added.
    until: last step to do; of the first round only, unless it is refit.
    seed: of the twins.
    particles: the body is sampled by about so many.
    profile: an unknown whose interval is found by profile likelihood at the end, too.
    tracks: CSV of tracked points, and
    clouds: folder of point clouds, in place of the run's own; None: as the run has them.
    images: False: only points are compared.
    jobs: processes at once; None: as many as torch may use threads, at most 8.
    """

    candidates: str | None = None
    twins: int = 20
    effects: int = 3
    until: Step = "refit"
    seed: int = 1
    particles: int = PARTICLES
    profile: str | None = None
    tracks: str | None = None
    clouds: str | None = None
    images: bool = True
    jobs: int | None = None


def diagnose(run_dir: str | Path, stem: str | None, options: Options, progress: Callable[[str], None]) -> Path:
    """Find what is missing in the model of a run; writes ``RUN/diagnosis/`` and returns it.

    Raises:
        UserInputError: no such run or phase, too few views, an unknown effect in the list of candidates.
        SimulationError: the run's own motion is unstable at the resolution of the diagnosis.
    """
    if not 4 <= options.twins <= 200:
        raise UserInputError(f"diagnose: twins = {options.twins}; give 4 to 200, 8 to 24 are enough")
    check_jobs(options.jobs, "diagnose")
    if options.particles < 300:
        raise UserInputError(f"diagnose: particles = {options.particles}; give at least 300, 4000 are a good number")
    problem = RunProblem(Run(run_dir), stem, options.particles, options.tracks, options.clouds, options.images)
    check(problem, options)
    what = {k: v for k, v in asdict(options).items() if k in ("twins", "seed", "particles")}
    what["candidates"] = None if options.candidates is None else Path(options.candidates).read_text()
    store = Store(problem.run.run_dir / FOLDER, problem.fingerprint, what)
    with processes(options.jobs):
        if problem.stage.record.phase in ("static", "velocity"):  # nothing was identified yet
            step = partial(searched, problem, problem.physics.effects, problem.first_guess, progress)
            problem.first_guess = store.once("search", step)
        rounds = investigate(problem, store, options, progress)
    pictures.write_pictures(problem, rounds, store.folder)
    return store.folder


def investigate(problem: Problem, store: Store, options: Options, progress: Callable[[str], None]) -> list[Round]:
    """The steps of a diagnosis, repeated; writes its results into the store's folder.

    Raises:
        SimulationError: the first motion is unstable at the resolution of the diagnosis.
    """
    effects, known = tuple(problem.physics.effects), problem.first_guess
    rounds: list[Round] = []
    for number in range(1, options.effects + 2):
        told = _prefixed(progress, f"round {number}, ")
        settled = removed_by(rounds) > DECISIVE
        found = _round(problem, store, options, number, effects, known, settled, told)
        rounds.append(found)
        write(problem, store.folder, rounds)
        if found.accepted is None or number > options.effects:
            break
        effects, known = (*effects, found.accepted.candidate.effect), found.accepted.known
    last = rounds[-1]
    first = fires(last) or asks_for_an_effect(last)
    asked = leaves_more_than_noise(last) if len(rounds) > 1 else first  # as the verdict does
    if options.until == "refit" and asked:
        last.force = store.once(f"{len(rounds)}_force", partial(residual_force, problem, last.comparison, progress))
        write(problem, store.folder, rounds)
    if options.profile is not None:
        told = _prefixed(progress, "profile likelihood: ")
        step = partial(profile, problem, last.comparison, options.profile, told)
        last.profiles[options.profile] = store.once(f"{len(rounds)}_profile_{options.profile}", step)[:2]
        write(problem, store.folder, rounds)
    return rounds


def check(problem: Problem, options: Options) -> None:
    """Raise UserInputError for a mistake in the list of candidates, or when no model of the diagnosis can have the
    unknown that is to be profiled: before any long work.
    """
    candidates = candidates_for(problem, options, problem.physics.effects)
    known = problem.model(problem.physics.effects, problem.first_guess).names
    names = [*known, *(name for candidate in candidates for name in candidate.effect.parameters)]
    if options.profile is not None and options.profile not in names:
        raise UserInputError(
            f"diagnose: --profile {options.profile}: no such unknown; choose from {', '.join(known)}, or a coefficient "
            "of an effect that may be found"
        )


def candidates_for(problem: Problem, options: Options, installed: tuple[Effect, ...]) -> list[Candidate]:
    """What may be added to a model with these effects."""
    material = problem.physics.material
    if options.candidates is not None:
        return read_candidates(Path(options.candidates), material, installed)
    return whole_catalogue(material, problem.video.view_ids, installed)


def _round(
    problem: Problem,
    store: Store,
    options: Options,
    number: int,
    effects: tuple[Effect, ...],
    known: dict[str, float],
    settled: bool,
    progress: Callable[[str], None],
) -> Round:
    told = _prefixed(progress, "compare: ")
    comparison = store.once(
        f"{number}_compare", lambda: compare(problem, effects, known, options.twins, options.seed, told)
    )
    noise = comparison.noise(problem, problem.fitted)
    parameters, undetermined = intervals(problem, comparison, noise)
    found = Round(
        comparison,
        *more_than_noise(problem, comparison),
        localising.mean_excess(problem, comparison.residual, comparison),
        parameters,
        undetermined,
        store.once(f"{number}_localise", lambda: localising.phases(problem, comparison)),
    )
    if options.until in ("compare", "localise") or number > options.effects:
        return found
    candidates = found.candidates = candidates_for(problem, options, effects)
    if not candidates:
        return found
    told = _prefixed(progress, "screen: ")
    found.screening = store.once(f"{number}_screen", lambda: screen(problem, comparison, candidates, told))
    if options.until == "screen":
        return found
    if fires(found) and not above_floor(found):  # whether that matters depends on what it looks like
        found.force = store.once(f"{number}_force", partial(residual_force, problem, comparison, progress))
    if not _suspicious(found):
        return found
    found.refits = _refitted(problem, store, number, found, settled, progress)
    for again in ranked(found.refits):  # a finer grid is dear: only for those that would be accepted
        told = _prefixed(progress, "refit: ")
        step = partial(refine, problem, comparison, again, told)
        checked = again if again.candidate.discrete else store.once(f"{number}_refine_{again.candidate.name}", step)
        found.refits = [checked if other is again else other for other in found.refits]
        if checked.verdict.accepted:
            found.accepted = checked
            break
    return found


def _refitted(
    problem: Problem, store: Store, number: int, found: Round, settled: bool, progress: Callable[[str], None]
) -> list[Refit]:
    """With one more effect each: the best, and what the best of them is known to be taken for.

    Args:
        problem, store, number: of the round.
        found: by its steps before.
        settled: whether nothing is left to explain for effects that no score singles out.
        progress: told what happens.
    """
    assert found.screening is not None
    screening, untried = found.screening, list(found.candidates)
    refits: list[Refit] = []

    def try_out(candidate: Candidate) -> None:
        best = rival(refits, candidate)
        told = _prefixed(progress, f"refit with {wording.readable(candidate.name)}: ")
        score = next((s for s in screening.scores if s.name == candidate.name), None)
        least, named = math.inf if best is None else best.misfit, screening.names(candidate)
        trial = partial(refit, problem, found.comparison, candidate, score, told, least, named)
        again = store.once(f"{number}_refit_{candidate.name}", trial)
        refits.extend([] if again is None else [again])
        untried.remove(candidate)

    at_least = LEAST_REFITS if asks_for_an_effect(found) and not settled else 0
    for candidate in worth_refitting(found.candidates, screening, at_least):
        best = rival(refits, candidate)
        decisive = settled or (best is not None and best.verdict.removed > DECISIVE)
        if not decisive or not candidate.discrete or screening.singles_out(candidate):
            try_out(candidate)
    while neighbours := lookalikes(refits, untried):
        for candidate in neighbours:
            try_out(candidate)
    return refits


def _suspicious(found: Round) -> bool:
    """Whether the residual asks for an effect, or one stands out."""
    assert found.screening is not None
    return asks_for_an_effect(found) or min(found.screening.p_values, default=1.0) < FALSE_ALARMS


def ranked(refits: list[Refit]) -> list[Refit]:
    """The accepted refits, that which removes most of the held-out error first, of those that remove about as much the
    one that fits best; physics before a camera, which does as well in its own view.
    """
    accepted = [again for again in refits if again.verdict.accepted]
    physics = [again.verdict.removed for again in accepted if not again.candidate.observes]

    def order(again: Refit) -> tuple[bool, bool, float]:
        if again.candidate.observes or again.verdict.removed <= max(physics) - ALIKE:
            return again.candidate.observes, True, -again.verdict.removed
        return False, False, again.misfit

    return sorted(accepted, key=order)


def rival(refits: list[Refit], candidate: Candidate) -> Refit | None:
    """The best accepted refit whose misfit can be compared with that of a candidate: a fault of one camera is fitted to
    other frames than everything else.
    """
    return next((again for again in ranked(refits) if again.candidate.view is None is candidate.view), None)


def lookalikes(refits: list[Refit], untried: list[Candidate]) -> list[Candidate]:
    """Those of the untried candidates that are known to be taken for the best accepted refit, or it for them: a model
    without the effect bends its parameters to stand in for it, and there the score may name a neighbour alone.
    """
    best = next((again.candidate for again in ranked(refits)), None)
    return [other for other in untried if best is not None and _confused(best, other) and other.view == best.view]


def _confused(one: Candidate, other: Candidate) -> bool:
    names = type(one.effect).__name__, type(other.effect).__name__
    return names[1] in one.effect.confused_with or names[0] in other.effect.confused_with


def write(problem: Problem, folder: Path, rounds: list[Round]) -> None:
    """Write diagnosis.json and, when effects were accepted and explain enough, the overlay effects.yaml."""
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / RESULT, json.dumps(summary(problem, rounds), indent=1).encode())
    accepted = [found.accepted for found in rounds if found.accepted is not None]
    if accepted and not unexplained(rounds):
        write_atomically(folder / OVERLAY, overlay(problem, accepted).encode())
    else:
        (folder / OVERLAY).unlink(missing_ok=True)


def overlay(problem: Problem, accepted: list[Refit]) -> str:
    """A configuration file that adds the accepted effects to a run, with the values found."""
    values = accepted[-1].known
    effects = [*problem.physics.effects, *(again.candidate.effect for again in accepted)]
    material = {name: float(f"{values[name]:.6g}") for name in problem.physics.material.free_names}
    section = {
        "physics": {
            "material": {"class_path": class_path(problem.physics.material), "init_args": material},
            "effects": [as_config(effect, values) for effect in effects],
        }
    }
    head = "# Effects found by diagnose; use it after the configuration of the run.\n"
    return head + yaml.safe_dump(section, sort_keys=False)


def summary(problem: Problem, rounds: list[Round]) -> dict:
    """Everything a report shows, as plain numbers."""
    video, split = problem.video, problem.split
    said, force = verdict(problem, rounds), rounds[-1].force
    return {
        "format": 1,
        "scene": problem.scene,
        "views": list(video.view_ids),
        "frames": list(video.frame_ids),
        "times": video.times.tolist(),
        "held_views": [video.view_ids[v] for v in np.flatnonzero(~split.views)],
        "held_frames": [video.frame_ids[f] for f in np.flatnonzero(~split.frames)],
        "verdict": said,
        "unit": problem.unit[0],
        "points": [] if problem.points is None else problem.points.names,
        "stages": pictures.stages(problem, rounds),
        "rounds": [_round_summary(problem, found) for found in rounds],
        "residual_force": _force(force) if force is not None and (said["rest"] or said["kind"] == "unknown") else None,
    }


def _round_summary(problem: Problem, found: Round) -> dict:
    comparison = found.comparison
    unknowns = problem.model(comparison.effects, comparison.known).unknowns
    return {
        "effects": [name_of(effect) for effect in comparison.effects],
        "parameters": _intervals(found.parameters, unknowns),
        "undetermined": found.undetermined,
        "profiles": {name: list(ends) for name, ends in found.profiles.items()},
        "omnibus": _omnibus(found.omnibus),
        "omnibus_held": _omnibus(found.held),
        "phases": found.phases,
        "excess": _matrix(localising.excess(comparison.residual, comparison)[: problem.views]),
        "floor": _matrix(localising.mean_of_outlines(localising.floor(comparison)[1][: problem.views])),
        "error": _errors(problem, comparison.residual, comparison),
        "screen": None if found.screening is None else _screen(found.screening, found.candidates),
        "refits": [_refit(problem, again, comparison) for again in found.refits],
        "accepted": None if found.accepted is None else found.accepted.candidate.name,
    }


def _omnibus(test: Omnibus) -> dict:
    return {"statistic": test.statistic, "twins": test.twins.tolist(), "p_value": test.p_value}


def _errors(problem: Problem, residual: np.ndarray, comparison: Comparison) -> dict:
    """Excess error in the fitted and in the held-out views and frames [the problem's unit]."""
    squares = localising.mean_excess(problem, residual, comparison)
    return {name: problem.unit[1] * localising.signed_root(square) for name, square in squares.items()}


def _screen(screening: Screening, candidates: list[Candidate]) -> dict:
    by_name = {candidate.name: candidate for candidate in candidates}
    return {
        "threshold": screening.threshold,
        "false_alarms": FALSE_ALARMS,
        "groups": [list(group) for group in screening.groups if len(group) > 1],
        "correlations": np.round(screening.correlations[:30, :30], 3).tolist(),
        "candidates": [
            {
                "name": score.name,
                "readable": wording.readable(score.name),
                "camera": "@" in score.name,
                "z": float(score.z),
                "p_value": p,
                "coefficient": list(score.coefficient),
                "interval": [list(pair) for pair in screening.intervals[score.name]],
                "fraction": score.fraction,
                "snr": score.snr,
                **pictures.described(by_name[score.name], len(score.coefficient), score.probe),
            }
            for score, p in zip(screening.scores, screening.p_values, strict=True)
        ],
    }


def _refit(problem: Problem, again: Refit, comparison: Comparison) -> dict:
    unknowns = problem.model([*comparison.effects, again.candidate.effect], again.known).unknowns
    return {
        "name": again.candidate.name,
        "readable": wording.readable(again.candidate.name),
        "camera": again.candidate.observes,
        "signature": again.candidate.effect.signature,
        "values": {told["name"]: told for told in _intervals(again.intervals, unknowns)},
        "refined": again.refined,
        "misfit_before": again.misfit_before,
        "misfit": again.misfit,
        "accepted": again.verdict.accepted,
        "removed": again.verdict.removed,
        "z": again.verdict.z,
        "reasons": [[passed, sentence] for passed, sentence in again.verdict.reasons],
        "excess": _matrix(localising.excess(again.residual, comparison)[: problem.views]),
        "error": _errors(problem, again.residual, comparison),
    }


def _force(force: ResidualForce) -> dict:
    return {
        "times": force.times.tolist(),
        "mean": np.round(force.mean, 4).tolist(),
        "field": np.round(force.field, 4).tolist(),
        "explained": force.explained,
        "held_removed": force.held.removed,
        "held_z": force.held.z,
        "terms": [asdict(term) for term in force.law.terms],
        "terms_explain": force.law.explained,
    }


def _intervals(intervals: Sequence[Interval], unknowns: Sequence[Parameter]) -> list[dict]:
    described = {parameter.name: parameter for parameter in unknowns}
    return [
        {
            "name": interval.name,
            "value": interval.value,
            "low": interval.low,
            "high": interval.high,
            "identifiable": interval.identifiable,
            "unit": described[interval.name].unit,
            "label": described[interval.name].label,
        }
        for interval in intervals
    ]


def _matrix(values: np.ndarray) -> list[list[float | None]]:
    """Rows of numbers, None where there is none."""
    return [[round(float(x), 5) if np.isfinite(x) else None for x in row] for row in values]


def _prefixed(progress: Callable[[str], None], prefix: str) -> Callable[[str], None]:
    return lambda text: progress(prefix + text)
