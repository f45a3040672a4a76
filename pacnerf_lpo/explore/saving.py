"""A session on disk: one JSON file that a person can read, with all that cannot be computed again."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.explore.source import open_source
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report.page import plain

if TYPE_CHECKING:
    from pacnerf_lpo.explore.session import Session

FILE, FORMAT = "session.json", 1


def save(session: "Session", folder: Path) -> Path:
    """Write ``session.json`` into a folder, which is made where it is missing; returns the file. Raises UserInputError
    where the folder cannot be written.
    """
    source = session.source
    current = session.current.number  # before the steps: it is among all later ones
    content = {
        "format": FORMAT,
        "source": [str(Path(run).resolve()) for run in source.runs],
        "out": str(source.store.folder.parent.resolve()),
        "phase": source.phase,
        "options": asdict(source.options),
        "candidates": session.listed,
        "own_effects": session.catalogue.declared,
        "current": current,
        "steps": [asdict(step) for step in session.steps],
        "tables": {str(n): plain(table) for n, table in session.history.tables.copy().items()},
    }
    try:
        write_atomically(folder / FILE, json.dumps(content).encode())
    except OSError as error:
        raise UserInputError(f"explore: {folder}: the session cannot be written there ({error})") from error
    return folder / FILE


def reopen(kind: "type[Session]", folder: Path, jobs: int | None) -> "Session":
    """A saved session with its whole history; nothing is simulated before it is looked at. Raises UserInputError where
    the file is damaged or of another version, or what it is about is gone.
    """
    path = folder / FILE
    try:
        content = json.loads(path.read_text())
        if content["format"] != FORMAT:
            raise UserInputError(f"{path}: written by another version; open its source instead: {content['source']}")
        steps = [_step(entry) for entry in content["steps"]]
        tables = {int(n): np.array(table, np.float32) for n, table in content["tables"].items()}
        source = open_source(content["source"], content["phase"], Options(**content["options"]), content["out"])
        session = kind(source, content["candidates"], jobs)
        for entry in content["own_effects"]:
            session.catalogue.declare(entry)
        for step in steps:
            session.catalogue.chosen(step.effects)
        session.history.restore(steps, content["current"], tables)
    except (OSError, ValueError, LookupError, TypeError) as error:
        if isinstance(error, UserInputError):
            raise
        raise UserInputError(f"{path}: it is no session that `save` has written ({error})") from error
    return session


def _step(entry: dict[str, Any]) -> Step:
    intervals = {name: (low, high) for name, (low, high) in entry["intervals"].items()}
    lists = {name: tuple(entry[name]) for name in ("effects", "notes")}
    return Step(**{**entry, **lists, "intervals": intervals})
