"""The run manifest: which phases of a run are done, and where their states and checkpoints lie.

``manifest.json`` is what ``--resume`` reads. It, the states and the checkpoints are replaced whole or not at all, so a
run that is killed at any moment leaves files that can be read.
"""

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from pacnerf_lpo.errors import UserInputError

FORMAT = 1
FILE_NAME = "manifest.json"
INTERVALS_FILE = "intervals.json"
"""Of the weighted fit that follows an identification."""


def write_atomically(path: Path, content: bytes) -> None:
    """Write next to ``path``, flush to disk, then rename over it: ``path`` is the old or the new file, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.part")
    try:
        with open(temporary, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


@dataclass
class PhaseRecord:
    """One phase of a run.

    index, round, phase: position in Algorithm 1; round 0 comes before the first identification.
    status: ``running``, ``done``, ``interrupted`` or ``failed``.
    checkpoint, state: paths relative to the run directory.
    seconds: wall time spent, all sittings together.
    steps: optimiser steps, which place the next phase on TensorBoard's time line.
    error: one line, when it failed.
    copied_from: the run that computed it, when this one started from a copy of its phases.
    held_out_error: after a correction that some training images were held out of, the error in these.
    course: how the phase went, as its :meth:`AbstractPhase.course` says.
    methods: what :func:`pacnerf_lpo.phases.method_comparison.compare_methods` found after an identification.
    before: what the phase itself had identified [SI], where the weighted fit that gives intervals took its place.
    """

    index: int
    round: int
    phase: str
    status: str
    checkpoint: str
    state: str
    seconds: float = 0.0
    steps: int = 0
    error: str | None = None
    copied_from: str | None = None
    held_out_error: float | None = None
    course: dict[str, Any] = field(default_factory=dict)
    methods: dict[str, Any] | None = None
    before: dict[str, float] | None = None

    @property
    def findings(self) -> str:
        """Path of what the phase found in addition to its state, where it found anything."""
        return str(Path(self.state).with_suffix(".json"))


@dataclass
class Manifest:
    """The record of a run, ``status`` one of ``running``, ``interrupted``, ``failed``, ``finished``; ``video`` is the
    fingerprint of what it was made from.
    """

    run_dir: Path
    status: str = "running"
    phases: list[PhaseRecord] = field(default_factory=list)
    video: str | None = None

    @property
    def held_out_errors(self) -> list[float]:
        """Of the rounds in which some images were held out."""
        return [record.held_out_error for record in self.phases if record.held_out_error is not None]

    @property
    def done(self) -> list[PhaseRecord]:
        """Records of the finished phases."""
        return [record for record in self.phases if record.status == "done"]

    @property
    def chosen_round(self) -> int | None:
        """The last round before the held-out error stopped falling; None when no images were held out."""
        errors = self.held_out_errors
        stopped = (done for done in range(1, len(errors)) if not errors[done] < errors[done - 1])
        return next(stopped, len(errors) or None)

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """90 % intervals [SI] of the weighted fit whose values a phase has taken over; none where there was none."""
        path = self.run_dir / INTERVALS_FILE
        if all(record.before is None for record in self.done) or not path.is_file():
            return {}
        found = json.loads(path.read_text())["parameters"]
        return {name: (one["low"], one["high"]) for name, one in found.items()}

    def begin_with(self, source: Path, records: Sequence[PhaseRecord]) -> None:
        """Begin with copies of finished phases of another run, their states and checkpoints; writes no manifest."""
        for record in records:
            for relative in (record.state, record.checkpoint):
                target = self.run_dir / relative
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source / relative, target)
            self.phases.append(replace(record, copied_from=source.name))

    def save(self) -> None:
        """Write ``manifest.json``."""
        phases = [asdict(record) for record in self.phases]
        content = {"format": FORMAT, "status": self.status, "video": self.video, "phases": phases}
        write_atomically(self.run_dir / FILE_NAME, json.dumps(content, indent=1).encode())

    @staticmethod
    def load(run_dir: Path) -> "Manifest":
        """Read ``manifest.json``; UserInputError when the folder is not a run directory."""
        path = run_dir / FILE_NAME
        try:
            content = json.loads(path.read_text())
            if content["format"] != FORMAT:
                raise UserInputError(f"{path}: format {content['format']}, this version reads {FORMAT}")
            records = [PhaseRecord(**record) for record in content["phases"]]
            return Manifest(run_dir, content["status"], records, content.get("video"))
        except FileNotFoundError:
            raise UserInputError(f"{run_dir} is not a run directory: it has no {FILE_NAME}") from None
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise UserInputError(f"{path} cannot be read ({error}); start the fit again in a new folder") from None
