"""The whole diagnosis, what to record next, and the page of a step, asked from a session."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.diagnose import investigate
from pacnerf_lpo.diagnosis.localising import phases_of
from pacnerf_lpo.diagnosis.plan import Proposal, last_open, propose
from pacnerf_lpo.diagnosis.rounds import Round, accepted_names
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.explore.noise import Noise
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.explore.source import Source
from pacnerf_lpo.explore.stepping import Stepper
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report.diagnosis import write_page
from pacnerf_lpo.report.diagnosis_result import RESULT, summary, write
from pacnerf_lpo.report.diagnosis_stages import stages_of, write_pictures
from pacnerf_lpo.report.wording import listed

STATED = "Changed by hand or by a fit; a diagnosis has not judged it."


def diagnose(stepper: Stepper, noise: Noise, progress: Progress) -> tuple[Step, list[str]]:
    """The step that a whole diagnosis ends with, and its verdict in sentences. Raises as :meth:`Session.diagnose`."""
    source, folder = noise.source, noise.source.store.folder
    Settings(list(source.runs), source.phase, source.options).write(folder)
    rounds = _rounds(source, progress)
    progress("writing the page of the diagnosis")
    write_pictures(source.problem, rounds, folder)
    write_page(folder)
    noise.reload()
    last, ended = rounds[-1], stages_of(rounds)[-1]
    found = last.parameters if last.accepted is None else last.accepted.intervals
    ends = {one.name: (one.low, one.high) for one in found if one.identifiable}
    names = accepted_names(rounds)
    title = f"diagnose: {listed(names, 'and') if names else 'nothing added'}"
    notes, effects = (last.accepted or last.comparison).notes, tuple(map(name_of, ended.effects))
    step = Step(0, stepper.history.current.number, title, "diagnose", dict(ended.known), effects, ends, notes=notes)
    verdict = json.loads((folder / RESULT).read_text())["verdict"]
    return stepper.adopt(step), [verdict["sentence"], *verdict["details"]]


def plan(source: Source, progress: Progress) -> list[Proposal]:
    """Recordings to make next, best first. Raises as :meth:`Session.plan`."""
    return propose(source.problem, last_open(_rounds(source, progress)), progress)


def _rounds(source: Source, progress: Progress) -> list[Round]:
    """Of the diagnosis, as far as it is stored; the rest is done now."""
    keep = partial(write, source.problem, source.store.folder)
    return investigate(source.problem, source.store, source.options, progress, keep)


def report(stepper: Stepper, noise: Noise, folder: Path, step: Step, progress: Progress) -> Path:
    """The page of a step, written with its numbers and pictures into a folder. Raises as :meth:`Session.report`."""
    problem, first = stepper.problem, stepper.history.steps[0]
    shown = [first] if step.number == first.number else [first, step]
    rounds = [_as_round(stepper, noise, one, progress) for one in shown]
    for number, found in enumerate(rounds):
        residuals = [earlier.comparison.residual for earlier in rounds[: number + 1]]
        found.errors = found.comparison.excess(problem, residuals)
    result = summary(problem, rounds)
    errors = (("the fitted data", step.fitted), ("the held-out data", step.held_out))
    parts = [f"{what} {value:.3g} {problem.unit[0]}" for what, value in errors if value is not None]
    said = f"Step {step.number}, {step.name}: error of {' and '.join(parts)}."
    result["verdict"] |= {"sentence": said, "details": [STATED, *step.notes]}
    for stage, one in zip(result["stages"], shown, strict=True):
        stage["readable"] = one.name
    write_atomically(folder / RESULT, json.dumps(result, indent=1).encode())
    write_pictures(problem, rounds, folder)
    return write_page(folder)


def _as_round(stepper: Stepper, noise: Noise, step: Step, progress: Progress) -> Round:
    """A step as the comparison of a diagnosis has a model, with the noise that is known and as it stands."""
    problem, effects = stepper.problem, stepper.catalogue.chosen(step.effects)
    progress(f"the page of step {step.number}")
    errors = noise.of(step, progress).comparison.errors
    found = stepper.rolled(step, "refined")
    model = problem.model(effects, step.values)
    residual = problem.residual(found.predicted)
    seen = residual, np.zeros((*residual.shape, len(model.names)))
    at = model, model.start, priors(problem, model), seen, errors, problem.fitted_with(effects)
    stands = Comparison.at(*at, notes=step.notes)
    comparison = replace(stands, known=dict(step.values))
    parts = problem.parts(effects, step.values)
    phases = [phases_of(part, path) for part, path in zip(parts, found.paths, strict=True)]
    ends = {name: step.intervals.get(name, (step.values[name],) * 2) for name in model.names}
    intervals = [
        Interval(name, step.values[name], low, high, (high - low) / 2, name in step.intervals)
        for name, (low, high) in ends.items()
    ]
    return Round(effects, comparison, *comparison.checks(problem), intervals, [], phases)
