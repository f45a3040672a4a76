"""The runs that a suite's tables need: each once, with its configuration, its key and the run it starts from.

The key of a result is a hash of the resolved configuration, of the data it uses, and of the package's version.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from pacnerf_lpo import __version__
from pacnerf_lpo.cli import PhaseCLI, quieten_lightning
from pacnerf_lpo.config_layers import read_yaml
from pacnerf_lpo.data.pac_nerf import data_digest
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.evaluate import RESULTS_FILE
from pacnerf_lpo.evaluation.run_directory import CONFIG_FILE
from pacnerf_lpo.manifest import Manifest, write_atomically
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.paper_tables.scenes import Scene
from pacnerf_lpo.paper_tables.tables import NO_CORRECTION, RunName, run_of

if TYPE_CHECKING:
    from pacnerf_lpo.paper_tables.suites import Suite

LABEL_FILE = "benchmark.json"
BEGINNING = 3  # static grids, velocity, first identification
SECTIONS_OF_THE_BEGINNING = ("seed_everything", "data", "physics", "phases", "trainer")


@dataclass(frozen=True)
class PlannedRun:
    """A run of the suite: its configuration files, in order; how many rounds of Algorithm 1 the tables need; the
    resolved configuration; the key of its results, which is part of the name of its folder; and the run whose first
    phases it takes over, if any.
    """

    name: RunName
    scene: Scene
    files: tuple[Path, ...]
    rounds: int
    config: dict[str, Any]
    key: str
    run_dir: Path
    start: "PlannedRun | None"

    def is_finished(self) -> bool:
        """Whether all rounds asked for are done and evaluated."""
        results = self.run_dir / RESULTS_FILE
        if not (results.exists() and (self.run_dir / CONFIG_FILE).exists()):
            return False
        manifest = Manifest.load(self.run_dir)
        rounds = read_yaml(self.run_dir / CONFIG_FILE)["outer_loop"]["rounds"]
        evaluated = [phase["stem"] for phase in json.loads(results.read_text())["phases"]]
        done = [Path(record.state).stem for record in manifest.phases]
        return manifest.status == "finished" and rounds >= self.rounds and evaluated == done

    def prepare(self) -> None:
        """Make the run directory, with the phases of the run it starts from, or raise the number of its rounds."""
        if self.run_dir.exists():
            path = self.run_dir / CONFIG_FILE
            config = read_yaml(path)
            if config["outer_loop"]["rounds"] < self.rounds:
                config["outer_loop"]["rounds"] = self.rounds
                write_atomically(path, yaml.safe_dump(config, sort_keys=False).encode())
            return
        partial = self.run_dir.with_name(f".{self.run_dir.name}.part")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        (partial / CONFIG_FILE).write_text(yaml.safe_dump(self.config, sort_keys=False))
        label = {
            "run": str(self.name),
            "key": self.key,
            "version": __version__,
            "configs": [str(path) for path in self.files],
            "starts_from": None if self.start is None else self.start.run_dir.name,
        }
        (partial / LABEL_FILE).write_text(json.dumps(label, indent=1))
        manifest = Manifest(partial, "interrupted")
        if self.start is not None:
            source = self.start.run_dir
            records = Manifest.load(source).done[:BEGINNING]
            if len(records) < BEGINNING:
                raise UserInputError(
                    f"{source}: its first {BEGINNING} phases are not finished, so nothing can start from them"
                )
            manifest.begin_with(source, records)
            if (source / "tensorboard").is_dir():
                shutil.copytree(source / "tensorboard", partial / "tensorboard")
        manifest.save()
        partial.rename(self.run_dir)


def plan_runs(
    suite: "Suite", scenes: Sequence[Scene], configs: Path, overlays: Sequence[Path], output: Path
) -> list[PlannedRun]:
    """All runs of a suite over scenes, those that others start from first. Raises UserInputError where a configuration
    or a scene cannot be used.

    ``configs`` is the folder of the configurations, ``overlays`` are put on top of scene and baseline, ``output`` is
    the folder of the benchmark.
    """
    needed = _rounds_needed(suite, scenes)
    by_scene = {scene.name: scene for scene in scenes}
    cli: PhaseCLI | None = None
    planned: dict[RunName, PlannedRun] = {}
    for name in sorted(needed, key=lambda name: (name.correction != "", suite.scenes.index(name.scene), name)):
        scene = by_scene[name.scene]
        files = _files(name, scene, configs, (*(configs / extra for extra in suite.overlays), *overlays))
        words = [word for path in files for word in ("--config", str(path))]
        words += [f"--outer_loop.rounds={needed[name]}", f"--data.root={scene.root}", f"--truth={scene.truth}"]
        words += ["--outer_loop.compare_methods=false", "--intervals=false"]  # the tables have neither
        if name.correction in ("", NO_CORRECTION):  # nothing is held out from a correction that there is not
            words.append("--outer_loop.stop_when=never")
        if cli is None:  # the parser is made once
            quieten_lightning()
            cli = PhaseCLI(words, VideoModule, Physics)
        else:
            cli.parse_arguments(cli.parser, words)
        config = yaml.safe_load(cli.dump())  # values that nobody set included
        first = planned.get(name.beginning)
        shares = first is not None and name != name.beginning and beginning_key(config) == beginning_key(first.config)
        key = beginning_key(config) if name == name.beginning else run_key(config)
        run_dir = output / "runs" / f"{str(name).replace(' ', '-')}-{key}"
        planned[name] = PlannedRun(
            name, scene, tuple(files), needed[name], config, key, run_dir, first if shares else None
        )
    return list(planned.values())


def _rounds_needed(suite: "Suite", scenes: Sequence[Scene]) -> dict[RunName, int]:
    needed: dict[RunName, int] = {}
    for layout in suite.layouts:
        for views, scene, column in product(layout.view_sets, scenes, layout.columns):
            name = run_of(scene.name, column, views)
            needed[name] = max(needed.get(name, 0), column.round)
            if name.correction:
                needed[name.beginning] = 1
    return needed


def _files(name: RunName, scene: Scene, configs: Path, overlays: Sequence[Path]) -> list[Path]:
    """The correction comes last, so that an overlay on the phases cannot bring back a correction that is off."""
    files = [configs / "fit.yaml", *scene.configs, configs / "baselines" / f"{name.baseline}.yaml"]
    if name.views:
        files.append(configs / "views" / f"{name.views}.yaml")
    files += [*overlays, configs / "corrections" / f"{name.correction or 'none'}.yaml"]
    for path in files:
        if not path.is_file():
            raise UserInputError(
                f"{path}: no such file; --configs wants the folder with fit.yaml, scenes, baselines ..."
            )
    return files


def run_key(config: Mapping[str, Any]) -> str:
    """The key of the results of a run with a resolved configuration.

    The rounds are left out, because the results after every round are kept; so are the places of run, data and truth.
    """
    kept = deepcopy(dict(config))
    kept.pop("truth")
    for name in ("run_dir", "rounds"):
        kept["outer_loop"].pop(name)
    return _key(kept)


def beginning_key(config: Mapping[str, Any]) -> str:
    """The key of static grids, velocity and first identification: whatever comes after them is left out.

    It is the key of a run that goes no further, and says which runs can start from it.
    """
    kept = {name: deepcopy(config[name]) for name in SECTIONS_OF_THE_BEGINNING}
    kept["phases"].pop("correction", None)
    return _key(kept)


def _key(config: dict[str, Any]) -> str:
    config["data"]["root"] = data_digest(config["data"])
    content = json.dumps([__version__, config], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:16]
