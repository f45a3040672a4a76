"""A run directory, opened for reading: configuration, video, physical model, and what the phases exported."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml
from jsonargparse import ArgumentParser

import pacnerf_lpo.render.camera_faults  # noqa: F401  (short class names in YAML exist once their modules are imported)
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import Manifest, PhaseRecord
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.types import ParticleState

CONFIG_FILE = "config.yaml"


@dataclass(frozen=True)
class Stage:
    """A finished phase, an entry of the manifest of a run, and where its results lie."""

    record: PhaseRecord
    run_dir: Path

    @property
    def stem(self) -> str:
        """Name of its files, such as ``02_r1_physics``."""
        return Path(self.record.state).stem

    @property
    def label(self) -> str:
        """How a person calls it, such as ``physics, round 1``."""
        return self.record.phase if self.record.round == 0 else f"{self.record.phase}, round {self.record.round}"

    @property
    def moves(self) -> bool:
        """Whether the phase knows a motion; the static phase has only seen frame 0."""
        return self.record.phase != "static"

    @property
    def state_path(self) -> Path:
        """The file of its particle state."""
        return self.run_dir / self.record.state

    @cached_property
    def state(self) -> ParticleState:
        """The particle state it exported."""
        return ParticleState.load(self.state_path)


class Run:
    """A folder that ``pacnerf-lpo fit`` wrote, read as it is needed. Raises UserInputError where it is no run
    directory, or no phase of it is finished.
    """

    def __init__(self, run_dir: str | Path):
        self.run_dir = Path(run_dir)
        self.manifest = Manifest.load(self.run_dir)
        self.stages = [Stage(record, self.run_dir) for record in self.manifest.done]
        if not self.stages:
            raise UserInputError(f"{self.run_dir}: no phase is finished yet; go on with `fit --resume {self.run_dir}`")

    @cached_property
    def config(self) -> dict[str, Any]:
        """The configuration as run."""
        path = self.run_dir / CONFIG_FILE
        if not path.is_file():
            raise UserInputError(f"{self.run_dir}: {CONFIG_FILE} is missing, so the run cannot be repeated or shown")
        return yaml.safe_load(path.read_text())

    @cached_property
    def data(self) -> VideoData:
        """The video of the run, read and checked."""
        return self._parsed.data.prepare()

    @cached_property
    def physics(self) -> Physics:
        """The physical model of the run."""
        return self._parsed.physics

    @property
    def laws(self) -> dict[str, Any] | None:
        """How the laws competed, as the phase ``law`` wrote it; None where the material was given."""
        found = [self.run_dir / stage.record.findings for stage in self.stages if stage.record.phase == "law"]
        return json.loads(found[-1].read_text()) if found else None

    @property
    def by_outlines(self) -> bool:
        """Whether the parameters were fitted to the outlines and not to the pixels."""
        method = self.config["phases"]["physics"]["init_args"].get("method", {})
        return method.get("class_path", "").rpartition(".")[2] == "OutlineGaussNewton"

    @property
    def scene(self) -> str:
        """Name of the scene: the last part of ``data.root``."""
        return Path(self.config["data"]["root"].removeprefix("asset:")).name

    @property
    def last(self) -> Stage:
        """The phase whose result counts: the last finished one, or where rounds are chosen, the end of that round."""
        measured = [stage for stage in self.stages if stage.record.held_out_error is not None]
        return measured[self.manifest.chosen_round - 1] if self.manifest.chosen_round else self.stages[-1]

    @property
    def uncorrected(self) -> Stage:
        """The last phase with particles as they were sampled. Corrections bend a body until a wrong model fits."""
        return next(stage for stage in reversed(self.stages) if not stage.state.corrected)

    def stage(self, stem: str | None) -> Stage:
        """The finished phase with this stem, such as ``02_r1_physics``; the last one when None."""
        if stem is None:
            return self.last
        stages = {stage.stem: stage for stage in self.stages}
        if stem not in stages:
            raise UserInputError(f"{self.run_dir}: no finished phase {stem!r}; there are {', '.join(stages)}")
        return stages[stem]

    def view_index(self, view_id: int) -> int:
        """Index of a view in the video from the number its files carry."""
        ids = self.data.video.view_ids
        if view_id not in ids:
            raise UserInputError(f"{self.data.video.source}: the run has no view {view_id}; it has {list(ids)}")
        return ids.index(view_id)

    @cached_property
    def _parsed(self) -> Any:
        parser = ArgumentParser(exit_on_error=False)
        parser.add_class_arguments(VideoData, "data")
        parser.add_class_arguments(Physics, "physics")
        sections = {name: self.config[name] for name in ("data", "physics")}
        return parser.instantiate(parser.parse_object(sections))
