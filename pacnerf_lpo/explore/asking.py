"""The whole diagnosis, and what to record next, asked from a session."""

import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from pacnerf_lpo.diagnosis.catalogue import name_of
from pacnerf_lpo.diagnosis.diagnose import investigate
from pacnerf_lpo.diagnosis.plan import Proposal, last_open, propose
from pacnerf_lpo.diagnosis.rounds import Round, accepted_names
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.report.diagnosis import write_page
from pacnerf_lpo.report.diagnosis_result import RESULT, write
from pacnerf_lpo.report.diagnosis_stages import stages_of, write_pictures
from pacnerf_lpo.report.wording import listed

if TYPE_CHECKING:
    from pacnerf_lpo.explore.session import Session


def diagnose(session: "Session", progress: Callable[[str], None]) -> tuple[Step, list[str]]:
    """The step that a whole diagnosis ends with, and its verdict in sentences. Raises as :meth:`Session.diagnose`."""
    source, folder = session.source, session.source.store.folder
    Settings(list(source.runs), source.phase, source.options).write(folder)
    rounds = _rounds(session, progress)
    progress("writing the page of the diagnosis")
    write_pictures(session.problem, rounds, folder)
    write_page(folder)
    session.noise.reload()
    last, ended = rounds[-1], stages_of(rounds)[-1]
    found = last.parameters if last.accepted is None else last.accepted.intervals
    ends = {one.name: (one.low, one.high) for one in found if one.identifiable}
    names = accepted_names(rounds)
    title = f"diagnose: {listed(names, 'and') if names else 'nothing added'}"
    notes = last.comparison.notes if last.accepted is None else last.accepted.notes
    effects = tuple(name_of(effect) for effect in ended.effects)
    step = Step(0, session.current.number, title, "diagnose", dict(ended.known), effects, ends, notes=notes)
    verdict = json.loads((folder / RESULT).read_text())["verdict"]
    return session.stepper.adopt(step), [verdict["sentence"], *verdict["details"]]


def plan(session: "Session", progress: Callable[[str], None]) -> list[Proposal]:
    """Recordings to make next, best first. Raises as :meth:`Session.plan`."""
    return propose(session.problem, last_open(_rounds(session, progress)), progress)


def _rounds(session: "Session", progress: Callable[[str], None]) -> list[Round]:
    """Of the diagnosis, as far as it is stored; the rest is done now."""
    source, problem = session.source, session.problem
    keep = partial(write, problem, source.store.folder)
    return investigate(problem, source.store, source.options, progress, keep)
