"""A step as a page: its model and that of the first step next to the measurement, as a diagnosis draws it."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pacnerf_lpo.diagnosis.localising import phases_of
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report.diagnosis import RESULT_FILE, write_page
from pacnerf_lpo.report.diagnosis_result import summary
from pacnerf_lpo.report.diagnosis_stages import write_pictures

if TYPE_CHECKING:
    from pacnerf_lpo.explore.session import Session

STATED = "Changed by hand or by a fit; a diagnosis has not judged it."


def report(session: "Session", folder: Path, step: Step, progress: Callable[[str], None]) -> Path:
    """Write the page of a step, with its numbers and pictures, into a folder; returns the page.

    Raises:
        SimulationError, UserInputError: a motion is unstable.
    """
    first = session.steps[0]
    shown = [first] if step.number == first.number else [first, step]
    rounds = [_round(session, one, progress) for one in shown]
    for number, found in enumerate(rounds):
        residuals = [earlier.comparison.residual for earlier in rounds[: number + 1]]
        found.errors = found.comparison.errors(session.problem, residuals)
    result = summary(session.problem, rounds)
    parts = [f"{what} {value:.3g} {session.unit}" for what, value in _errors(step)]
    said = f"Step {step.number}, {step.name}: error of {' and '.join(parts)}."
    result["verdict"] |= {"sentence": said, "details": [STATED, *step.notes]}
    for stage, one in zip(result["stages"], shown, strict=True):
        stage["readable"] = one.name
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / RESULT_FILE, json.dumps(result, indent=1).encode())
    write_pictures(session.problem, rounds, folder)
    return write_page(folder)


def _errors(step: Step) -> list[tuple[str, float]]:
    named = (("the fitted data", step.fitted), ("the held-out data", step.held_out))
    return [(name, value) for name, value in named if value is not None]


def _round(session: "Session", step: Step, progress: Callable[[str], None]) -> Round:
    """A step as the comparison of a diagnosis has a model, with the noise that is known and as it stands."""
    problem, effects = session.problem, session.catalogue.chosen(step.effects)
    progress(f"the page of step {step.number}")
    noise = session.noise.of(step, progress).comparison
    found = session.stepper.rolled(step, "refined")
    model = problem.model(effects, step.values)
    residual = problem.residual(found.predicted)
    mean, deviation = priors(problem, model)
    comparison = replace(
        noise,
        names=model.names,
        free=model.start,
        known=dict(step.values),
        mean=mean,
        deviation=deviation,
        cost=0.0,
        residual=residual,
        jacobian=np.zeros((*residual.shape, len(model.names))),
        notes=step.notes,
        rollouts=0,
    )
    parts = problem.parts(effects, step.values)
    phases = [phases_of(part, path) for part, path in zip(parts, found.paths, strict=True)]
    intervals = [_interval(step, name) for name in model.names]
    return Round(effects, comparison, *comparison.checks(problem), intervals, [], phases)


def _interval(step: Step, name: str) -> Interval:
    value = step.values[name]
    low, high = step.intervals.get(name, (value, value))
    return Interval(name, value, low, high, (high - low) / 2, name in step.intervals)
