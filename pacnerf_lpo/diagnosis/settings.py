"""What a diagnosis was asked for, kept with its results, so that a plan can go on from them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import write_atomically

FILE = "settings.json"


@dataclass(frozen=True)
class Settings:
    """Runs, phase and options of a diagnosis."""

    runs: list[str]
    phase: str | None
    options: Options

    def write(self, folder: Path) -> None:
        """Write ``settings.json`` into the folder of the diagnosis."""
        folder.mkdir(parents=True, exist_ok=True)
        runs = [str(Path(run).resolve()) for run in self.runs]
        options = asdict(self.options)
        files = {
            name: str(Path(options[name]).resolve()) for name in ("candidates", "tracks", "clouds") if options[name]
        }
        content = {"runs": runs, "phase": self.phase, "options": {**options, **files}}
        write_atomically(folder / FILE, json.dumps(content, indent=1).encode())

    @staticmethod
    def read(folder: Path) -> Settings:
        """Raises UserInputError where there is no finished diagnosis."""
        path = folder / FILE
        if not path.is_file():
            raise UserInputError(f"{folder}: there is no diagnosis to plan from; run `pacnerf-lpo diagnose` first")
        content = json.loads(path.read_text())
        return Settings(content["runs"], content["phase"], Options(**content["options"]))
