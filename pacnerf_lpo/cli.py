"""``pacnerf-lpo fit``: reads the configuration, then runs each phase the outer loop asks for with a fresh Trainer."""

import contextlib
import copy
import errno
import logging
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import pytorch_lightning as pl
import torch
import yaml
from jsonargparse import ArgumentError, Namespace
from omegaconf.errors import OmegaConfBaseException
from pytorch_lightning.cli import ArgsType, LightningArgumentParser, LightningCLI
from pytorch_lightning.utilities.warnings import PossibleUserWarning

import pacnerf_lpo.mpm.effects
import pacnerf_lpo.mpm.materials
import pacnerf_lpo.phases.schedules
import pacnerf_lpo.phases.static_grid
import pacnerf_lpo.render.camera_faults  # noqa: F401  (short class names in YAML exist once their modules are imported)
from pacnerf_lpo.callbacks.phase import PhaseCheckpoint, PhaseProgress
from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.callbacks.tensorboard import PhaseLogger
from pacnerf_lpo.config_errors import HelpFormatter, cause_of, explain, find_configs
from pacnerf_lpo.config_layers import flat, read_yaml, scene_changes
from pacnerf_lpo.errors import Interrupted, RunError, SimulationError, UserInputError
from pacnerf_lpo.evaluation.run_directory import CONFIG_FILE
from pacnerf_lpo.fit_options import DESCRIPTION, OPTIONS
from pacnerf_lpo.heartbeat import doing
from pacnerf_lpo.identification.laws import as_text
from pacnerf_lpo.manifest import FILE_NAME as MANIFEST
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.mpm import runtime
from pacnerf_lpo.outer_loop import OuterLoop, PhaseStep
from pacnerf_lpo.phases.base import AbstractPhase
from pacnerf_lpo.phases.dynamic import DynamicPhase
from pacnerf_lpo.phases.estimate import estimate, interval_particles
from pacnerf_lpo.phases.law_choice import LawChoice
from pacnerf_lpo.reuse import reusable

# Trainer arguments which the run itself decides
NOT_CONFIGURABLE = {
    *("logger", "default_root_dir", "max_epochs", "min_epochs", "min_steps", "max_time", "fast_dev_run", "barebones"),
    *("enable_checkpointing", "enable_progress_bar", "enable_model_summary"),
}
MAY_CHANGE = ("outer_loop.rounds", "outer_loop.checkpoint_seconds", "truth", "intervals", "trainer.")
"""What may differ where a run goes on: nothing that is done already depends on it."""
FOLLOWS_LAW = ("physics.material", "phases.physics.init_args.method.init_args.learning_rates")
"""What a run that was begun with ``auto`` has in its place once the law is chosen."""


class PhaseCLI(LightningCLI):
    """Parses and links the sections data, physics, phases, outer_loop and trainer, and runs the phases.

    ``args`` is the command line after ``fit``; the classes are what the sections ``data`` and ``physics`` configure.
    """

    def __init__(self, args: Sequence[str], datamodule_class: type[pl.LightningDataModule], physics_class: type):
        self.physics_class = physics_class
        parser: dict[str, Any] = {"parser_mode": "omegaconf+", "exit_on_error": False, "prog": "pacnerf-lpo fit"}
        super().__init__(
            datamodule_class=datamodule_class,
            save_config_callback=None,
            seed_everything_default=0,
            parser_kwargs={**parser, "description": DESCRIPTION, "formatter_class": HelpFormatter},
            args=list(args),
            run=False,
            auto_configure_optimizers=False,
            load_from_checkpoint_support=False,
        )

    def add_core_arguments_to_parser(self, parser: LightningArgumentParser) -> None:
        """Declare the sections of the configuration."""
        said = {name: text.replace("%", "%%") for name, text in OPTIONS.items()}
        parser.add_argument("--resume", metavar="RUN_DIR", help=said["resume"])
        parser.add_argument("--preset", type=str | None, help=said["preset"])
        parser.add_argument("--intervals", type=bool | int, default=True, help=said["intervals"])
        parser.add_argument("--truth", type=str | None, help=said["truth"])
        parser.add_class_arguments(self._datamodule_class, "data")
        parser.add_class_arguments(self.physics_class, "physics")
        for role in ("static", "velocity", "physics"):
            parser.add_subclass_arguments(AbstractPhase, f"phases.{role}", required=True)
        for role in ("law", "correction"):
            parser.add_subclass_arguments(AbstractPhase, f"phases.{role}", required=False)
        parser.add_class_arguments(OuterLoop, "outer_loop")
        parser.add_class_arguments(pl.Trainer, "trainer", instantiate=False, fail_untyped=False, skip=NOT_CONFIGURABLE)

    def parse_arguments(self, parser: LightningArgumentParser, args: ArgsType) -> None:
        """Parse; a mistake becomes one line with the nearest right name."""
        words, files = find_configs(cast(list[str], args))
        try:
            self.config = parser.parse_args(words)
        except (ArgumentError, OmegaConfBaseException) as error:
            raise explain(error, parser, files) from error
        self.remarks = scene_changes(files)

    def instantiate_classes(self) -> None:
        """Make the data, the physical model, one template of each phase, and the outer loop."""
        made = self._instantiate()
        self.datamodule, self.outer_loop, self.trainer_config = made.data, made.outer_loop, vars(made.trainer)

    def _instantiate(self) -> Any:
        """All sections of the configuration as it is now; keeps the physical model and the phases."""
        try:
            made = self.parser.instantiate(self.config)
        except ValueError as error:  # the parser wraps what a class says about its own arguments
            raise cause_of(error) from error
        self.physics = made.physics
        self.phases: dict[str, AbstractPhase] = {k: v for k, v in vars(made.phases).items() if v is not None}
        if not self.physics.decided:
            self.phases.setdefault("law", LawChoice())
        return made

    def go_on(self) -> None:
        """Go on with the run that is there already, if any. Raises UserInputError where that has other settings."""
        run_dir: Path = self.outer_loop.run_dir
        if not (run_dir / MANIFEST).is_file():
            return
        path = run_dir / CONFIG_FILE
        before, now = flat(read_yaml(path)), flat(yaml.safe_load(self.dump()))
        may_change = MAY_CHANGE if self.physics.decided else (*MAY_CHANGE, *FOLLOWS_LAW)
        changed = [
            f"{key} was {before.get(key)}, is {now.get(key)}"
            for key in sorted({*before, *now}, key=lambda key: (key != "preset", key))
            if before.get(key) != now.get(key) and not key.startswith(may_change)
        ]
        if changed:
            more = f" and {len(changed) - 2} more" if len(changed) > 2 else ""
            raise UserInputError(
                f"{run_dir} was begun with other settings ({'; '.join(changed[:2])}{more}): go on with those by "
                f"`{resume_command(run_dir)}`, or begin anew in another folder, such as --outer_loop.run_dir "
                f"{run_dir.with_name(run_dir.name + '2')}"
            )
        self.config.resume = str(run_dir)
        write_atomically(path, self.dump().encode())

    def run(self, look_back: Callable[..., None]) -> Path:
        """Run all phases that are not done yet, with ``look_back`` after each, see
        :func:`pacnerf_lpo.commands.fit.look_back`; returns the run directory.
        """
        check_truth(self.config.truth)
        interval_particles(self.config.intervals)
        self._choose_device()
        doing("reading the video")
        self.datamodule.prepare()
        self._check_phases()
        loop: OuterLoop = self.outer_loop
        correction = "correction" in self.phases
        loop.check(self.datamodule, correction)
        if self.config.resume is None:
            self._start(correction)
        else:
            loop.resume(correction, not self.physics.decided)
        if loop.next_phase() is None:
            print(
                f"{loop.run_dir} is finished; to begin anew give another folder, such as --outer_loop.run_dir "
                f"{loop.run_dir.with_name(loop.run_dir.name + '2')}"
            )
        else:
            self._announce()
        with StopRequest() as stop:
            try:
                self._decide_law()
                self._look_back(look_back)
                while (step := loop.next_phase()) is not None:
                    self._run_phase(step, stop)
                    self._look_back(look_back)
                    self._decide_law()
            except Interrupted:
                loop.abandon("interrupted")
                raise Interrupted(f"interrupted; go on with `{resume_command(loop.run_dir)}`") from None
            except Exception as error:
                self._record_failure(error)
                raise
        loop.close("finished")
        return loop.run_dir

    def _check_phases(self) -> None:
        """Each phase checks early that video, settings and model agree, with one of the laws where several compete."""
        models = [self.physics] if self.physics.decided else self.physics.candidates
        for phase in self.phases.values():
            errors: list[UserInputError] = []
            for physics in models:
                try:
                    copy.deepcopy(phase).attach(self.datamodule, physics)
                except UserInputError as error:
                    errors.append(error)
            if len(errors) == len(models):
                raise errors[0]

    def _decide_law(self) -> None:
        """Once laws have competed, go on with the one that was chosen, as though it had been configured."""
        if self.physics.decided or (findings := self.outer_loop.findings("law")) is None:
            return
        chosen = next(law for law in self.physics.material.laws if type(law).__name__ == findings["chosen"])
        known = next(trial["known"] for trial in findings["laws"] if trial["law"] == findings["chosen"])
        values = {name: float(f"{known[name]:.4g}") for name in chosen.parameters}
        kind = type(chosen)
        known_names: dict[str, list[str]] = {"known": list(chosen.known)} if chosen.known else {}
        self.config.physics.material = Namespace(
            class_path=f"{kind.__module__}.{kind.__qualname__}", init_args=Namespace(**values, **known_names)
        )
        rates = self.config.phases.physics.init_args.get("method.init_args.learning_rates")
        if rates:
            kept = {name: rate for name, rate in rates.items() if name in self.physics.of(chosen).free_names}
            self.config.phases.physics.init_args.method.init_args.learning_rates = kept
        self._instantiate()
        write_atomically(self.outer_loop.run_dir / CONFIG_FILE, self.dump().encode())
        print(as_text(findings), flush=True)

    def _announce(self) -> None:
        """Say what overlays changed, and what the run will take."""
        todo = []
        for step in self.outer_loop.remaining():
            todo.append(copy.deepcopy(self.phases[step.template]))
            todo[-1].searches = self.outer_loop.searches(step)
        intervals = interval_particles(self.config.intervals)
        lasts = estimate(todo, self.phases.get("static"), self.datamodule, self.physics, intervals)
        for line in [*self.remarks, *lasts]:
            print(line, flush=True)

    def _run_phase(self, step: PhaseStep, stop: StopRequest) -> None:
        loop: OuterLoop = self.outer_loop
        steps_before = sum(record.steps for record in loop.manifest.done)
        loop.begin(step)
        doing(f"preparing {step.role}")
        pl.seed_everything(self.config.seed_everything + step.index, verbose=False)
        module = copy.deepcopy(self.phases[step.template])
        module.attach(self.datamodule, self.physics)
        options, checkpoint = copy.deepcopy(self.trainer_config), loop.checkpoint(step)
        options["callbacks"] = [
            loop,
            PhaseProgress(step.role if step.round == 0 else f"round {step.round} of {loop.rounds}, {step.role}"),
            PhaseCheckpoint(checkpoint, loop.checkpoint_seconds, stop),
            *(options["callbacks"] or []),
        ]
        logger = PhaseLogger(loop.run_dir, step.role, steps_before)
        if isinstance(module, DynamicPhase):  # few numbers; what takes time is simulated and rendered on the device
            options["accelerator"], options["devices"] = "cpu", 1
        trainer = pl.Trainer(**options, logger=logger, max_epochs=1, enable_model_summary=False)
        trainer.fit(module, datamodule=self.datamodule, ckpt_path=checkpoint if checkpoint.exists() else None)

    def _start(self, correction: bool) -> None:
        """Begin a run, with phases of another one where that is wanted; what cannot be is found before."""
        loop: OuterLoop = self.outer_loop
        config, video = self.dump(), self.datamodule.fingerprint
        found = None if loop.reuse is None else reusable(loop.reuse, yaml.safe_load(config), video)
        loop.start(correction, video, not self.physics.decided)
        write_atomically(loop.run_dir / CONFIG_FILE, config.encode())
        if found is not None:
            loop.state = found.copy(loop.manifest, self.physics.known(self.physics.guess))
            print(found, file=sys.stderr)

    def _look_back(self, look_back: Callable[..., None]) -> None:
        """Say what is doubtful about the last finished phase, and before a correction or at the end fit intervals."""
        loop: OuterLoop = self.outer_loop
        record, following = loop.last_done, loop.next_phase()
        if record is not None:
            doing(f"looking back at {record.phase}")
            template = self.phases.get(loop.steps[record.index].template)
            if template is None:  # of laws that competed before
                return
            settled = following is None or following.role == "correction"
            particles = interval_particles(self.config.intervals) if settled else 0
            look_back(loop.manifest, self.datamodule, self.physics, template, loop.compare_methods, particles)
            loop.reread()

    def _choose_device(self) -> None:
        """Simulate and render where the trainer computes."""
        wanted = self.trainer_config["accelerator"]
        if wanted in ("gpu", "cuda") or (wanted == "auto" and torch.cuda.is_available()):
            runtime.start("cuda")

    def dump(self) -> str:
        """The configuration as run, complete, as YAML."""
        config = self.config.clone()
        for name in ("config", "resume"):
            config.pop(name, None)
        if Path(config.data.root).exists():
            config.data.root = str(Path(config.data.root).resolve())
        return self.parser.dump(config, skip_unset=False)

    def _record_failure(self, error: Exception) -> None:
        """Record a failure in the manifest; if the user can act on its cause, say it in one line."""
        loop: OuterLoop = self.outer_loop
        step = loop.next_phase()
        message = f"{loop.run_dir}, phase {step.stem if step else 'none'}: {error}"
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            message = f"disk full ({message}); free space, then go on with `{resume_command(loop.run_dir)}`"
        with contextlib.suppress(OSError):
            loop.abandon("failed", message)
        if isinstance(error, UserInputError):
            raise UserInputError(message) from error
        if isinstance(error, (OSError, SimulationError)):
            raise RunError(message) from error


def fit(
    args: Sequence[str],
    datamodule_class: type[pl.LightningDataModule],
    physics_class: type,
    look_back: Callable[..., None],
    finish: Callable[[Path, str | None], None],
    goes_on: bool = False,
) -> int:
    """The command ``fit``; returns its exit status. Arguments as of :class:`PhaseCLI` and :meth:`PhaseCLI.run`. Once
    all phases are done, ``finish`` is called with the run directory and the truth to compare with. With
    ``goes_on``, a run of these settings that is there already goes on, as with ``--resume``.
    """
    quieten_lightning()
    phases = PhaseCLI(_expand_resume(args), datamodule_class, physics_class)
    if goes_on:
        phases.go_on()
    run_dir = phases.run(look_back)
    again = f"repeat it with `{resume_command(run_dir)}`"
    try:
        doing("evaluating the run")
        with StopRequest():
            finish(run_dir, phases.config.truth)
    except Interrupted:
        raise Interrupted(f"the fit is complete but its evaluation was interrupted; {again}") from None
    except Exception as error:
        raise RunError(f"the fit is complete but its evaluation failed ({error!r}); {again}") from error
    return 0


def check_truth(truth: str | None) -> None:
    """Raise UserInputError when the comparison at the end will not find its file; the file is not opened."""
    from pacnerf_lpo.evaluation.evaluate import DEMO_TRUTH

    if truth not in (None, DEMO_TRUTH) and not Path(str(truth)).is_file():
        raise UserInputError(f"--truth {truth}: no such file; give the truth.json of the scene, or leave it out")


def _expand_resume(args: Sequence[str]) -> list[str]:
    """``--resume RUN_DIR`` means the configuration that lies in RUN_DIR."""
    words = [part for arg in args for part in (arg.split("=", 1) if arg.startswith("--resume=") else [arg])]
    if "--resume" not in words:
        return words
    if len(words) != 2 or words[0] != "--resume":
        raise UserInputError("--resume RUN_DIR takes the configuration from the run; give no other option with it")
    run_dir = Path(words[1])
    if not (run_dir / CONFIG_FILE).is_file():
        raise UserInputError(f"{run_dir} is not a run directory: it has no {CONFIG_FILE}")
    return ["--config", str(run_dir / CONFIG_FILE), "--resume", str(run_dir), "--outer_loop.run_dir", str(run_dir)]


def quieten_lightning() -> None:
    """Keep Lightning's advice for programmers off the screen; the progress bars are what a user follows."""
    for name in ("pytorch_lightning", "lightning_fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", category=PossibleUserWarning)
    for message in (".*LeafSpec", ".*`IterableDataset` has `__len__`"):
        warnings.filterwarnings("ignore", message=message)


def resume_command(run_dir: Path) -> str:
    """What to type to go on with a run."""
    return f"pacnerf-lpo fit --resume {run_dir}"
