"""Phases of a finished run taken over by another one, where nothing differs that they depend on."""

import shutil
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pacnerf_lpo.config_layers import flat, read_yaml
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import CONFIG_FILE
from pacnerf_lpo.manifest import Manifest, PhaseRecord, write_atomically
from pacnerf_lpo.mpm.effects.base import GroundEffect
from pacnerf_lpo.types import ParticleState

KEY = "outer_loop.reuse"
NOT_SEEN = ("root", "tracks", "clouds")
"""Of the section ``data``: files are compared by their contents, and points measured as well move no reconstruction."""
AFTER_CONTACT = ("material", "ground", "ground_height", "ground_error", "fit_ground_height", "rho")
"""Of the section ``physics``: a body that falls freely does not feel them."""
MACHINE = ("accelerator", "devices", "log_every_n_steps", "callbacks")
"""Of the section ``trainer``: they change no result beyond rounding."""


@dataclass(frozen=True)
class Reusable:
    """The first phases of a finished run, with which another one can begin: the reconstruction and, where it is still
    right, the velocity. ``why_not``: why that is fitted again; None: it is taken over, too.
    """

    source: Path
    records: Sequence[PhaseRecord]
    why_not: str | None

    def __str__(self) -> str:
        if self.why_not is None:
            return f"reconstruction and velocity are those of {self.source}"
        return f"the reconstruction is that of {self.source}; the velocity is fitted again, since {self.why_not}"

    def copy(self, manifest: Manifest, guess: Mapping[str, float]) -> ParticleState:
        """Let a run without phases begin with these; returns the last state, whose parameters become ``guess`` [SI]."""
        manifest.begin_with(self.source, self.records)
        copy_events(self.source, manifest.run_dir, [record.phase for record in self.records])
        last = manifest.run_dir / self.records[-1].state
        state = ParticleState.load(last)
        if self.records[-1].phase == "velocity":
            state = state.with_(physics=dict(guess))
            write_atomically(last, state.as_bytes())
        manifest.save()
        return state


def reusable(source: str | Path, config: Mapping[str, Any], video: str) -> Reusable:
    """Which phases of a run another one, with this complete configuration and fingerprint of its video, can begin with.
    Raises UserInputError where the source has no finished reconstruction, or was made with another video or other
    settings.
    """
    source = Path(source)
    manifest, path = Manifest.load(source), source / CONFIG_FILE
    done = manifest.done
    if not done or not path.is_file():
        raise UserInputError(f"{KEY} = {source}: its reconstruction is not finished; go on with it, or leave {KEY} out")
    if manifest.video != video:
        raise UserInputError(
            f"{KEY} = {source}: it was made with another video, or other views, frames or contents of it; leave "
            f"{KEY} out"
        )
    there = read_yaml(path)
    if differs := difference(_of_static(there), _of_static(config)):
        raise UserInputError(
            f"{KEY} = {source}: its reconstruction was made with other settings: {differs}; set that as it is there, "
            f"or leave {KEY} out"
        )
    if len(done) < 2 or done[1].phase != "velocity":
        return Reusable(source, done[:1], "it is not finished there")
    differs = difference(_of_velocity(there), _of_velocity(config))
    return Reusable(source, done[: 1 if differs else 2], differs)


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str | None:
    """The first key at which two configurations differ, with both values; None where they do not."""
    before, now = flat(there), flat(here)
    key = next((key for key in {**before, **now} if before.get(key) != now.get(key)), None)
    return None if key is None else f"{key} is {before.get(key)} there and {now.get(key)} here"


def copy_events(source: Path, target: Path, phases: Sequence[str]) -> None:
    """Copy what some phases of a run have logged for TensorBoard: every file that holds nothing else."""
    for path in sorted((source / "tensorboard").glob("events.*")):
        events = EventAccumulator(str(path))
        events.Reload()
        names = [name for kind in events.Tags().values() if isinstance(kind, list) for name in kind]
        if names and all(name.split("/")[0] in phases for name in names):
            (target / "tensorboard").mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, target / "tensorboard" / path.name)


def _of_static(config: Mapping[str, Any]) -> dict[str, Any]:
    """What the reconstruction depends on."""
    return {
        "seed_everything": config["seed_everything"],
        "data": {key: value for key, value in config["data"].items() if key not in NOT_SEEN},
        "physics": {"mass_from": config["physics"].get("mass_from")},
        "phases": {"static": config["phases"]["static"]},
        "trainer": {key: value for key, value in config["trainer"].items() if key not in MACHINE},
    }


def _of_velocity(config: Mapping[str, Any]) -> dict[str, Any]:
    """What the velocity depends on, besides the reconstruction."""
    physics = {key: deepcopy(value) for key, value in config["physics"].items() if key not in AFTER_CONTACT}
    effects = physics.get("effects") or []
    physics["effects"] = [one for one in effects if not issubclass(resolve_name(one["class_path"]), GroundEffect)]
    return {"phases": {"velocity": config["phases"]["velocity"]}, "physics": physics}
