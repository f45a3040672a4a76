"""``pacnerf-lpo fit``: the phases of Algorithm 1 on a video, then evaluation and report."""

import json
import sys
from collections.abc import Sequence
from copy import deepcopy
from itertools import takewhile
from pathlib import Path

from pacnerf_lpo import cli
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.evaluation.doubts import Doubt, doubts_of_phase
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.heartbeat import doing
from pacnerf_lpo.identification.processes import processes
from pacnerf_lpo.manifest import Manifest
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases.base import AbstractPhase
from pacnerf_lpo.phases.estimate import interval_particles
from pacnerf_lpo.phases.method_comparison import compare_methods
from pacnerf_lpo.phases.physics_id import PhysicsIDModule
from pacnerf_lpo.presets import stack


def run(args: Sequence[str]) -> int:
    """Run the command; returns its exit status. Its first word may be a scene folder, and several are a study."""
    scenes = list(takewhile(lambda word: not word.startswith("-"), args))
    if len(scenes) > 1:
        from pacnerf_lpo.commands import study  # which fits each of them by this function

        return study.run(scenes, args[len(scenes) :])
    words, remarks = stack(Path(args[0]), args[1:]) if scenes else (args, [])
    for remark in remarks:
        print(remark)
    return cli.fit(words, VideoModule, Physics, look_back, finish, goes_on=bool(scenes))


def look_back(
    manifest: Manifest, data: VideoData, physics: Physics, template: AbstractPhase, compare: bool, particles: int
) -> None:
    """Say what is doubtful about the last finished phase of a run, which ``template`` has configured.

    After the identification of a body that was not corrected, with ``compare``, images and outlines are compared, and
    the manifest keeps what they say; with ``particles``, a weighted fit by so many gives intervals, and the phase takes
    over its values.
    """
    record = manifest.done[-1]
    stage = Stage(record, manifest.run_dir)
    identified = template if isinstance(template, PhysicsIDModule) and not stage.state.corrected else None
    if compare and identified and record.methods is None:
        module = deepcopy(identified)
        module.attach(data, deepcopy(physics))
        module.import_state(stage.state)
        try:
            record.methods = compare_methods(module)
        except (SimulationError, UserInputError) as error:
            print(f"images and outlines are not compared: {error}", file=sys.stderr)
            record.methods = {"error": str(error)}
        manifest.save()
    for found in doubts_of_phase(data, physics, stage):
        print(found, file=sys.stderr)
    if identified and particles:
        _add_intervals(Run(manifest.run_dir), particles)


def finish(run_dir: Path, truth: str | None) -> None:
    """Evaluate a complete run, show the evaluation in TensorBoard, and write the report."""
    from pacnerf_lpo.evaluation.evaluate import RESULTS_FILE, evaluate_run
    from pacnerf_lpo.evaluation.tables import markdown_table
    from pacnerf_lpo.report.html import is_evaluated, write_report
    from pacnerf_lpo.report.tensorboard_images import log_evaluation

    run = Run(run_dir)
    particles = interval_particles(run.config.get("intervals", False))
    if particles and any(stage.record.phase == "physics" for stage in run.stages):
        _add_intervals(run, particles)
        run = Run(run_dir)
    if truth is None and is_evaluated(run):
        results = json.loads((run_dir / RESULTS_FILE).read_text())
    else:
        results = evaluate_run(run_dir, truth)
        log_evaluation(run, results)
    print(markdown_table(results))
    for found in results["doubts"]:
        print(Doubt(**found))
    doing("writing the report")
    print(f"report: {write_report(run_dir)}")


def _add_intervals(run: Run, particles: int) -> None:
    """Intervals of what was identified, by so many particles, or a line that says why there are none."""
    from pacnerf_lpo.diagnosis.posterior import keep_intervals

    def tell(text: str) -> None:
        doing(text)
        print(f"intervals: {text}", flush=True)

    try:
        with processes(None):
            keep_intervals(run, tell, particles)
    except (UserInputError, SimulationError) as error:
        tell(f"none, {error}")
