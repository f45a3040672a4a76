"""``pacnerf-lpo fit``: the phases of Algorithm 1 on a video, then evaluation and report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pacnerf_lpo import cli
from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.data.video_module import VideoData
from pacnerf_lpo.identification.processes import processes
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.presets import stack


def run(args: Sequence[str]) -> int:
    """Run the command; returns its exit status. Its first word may be a scene folder."""
    if not args or args[0].startswith("-"):
        return cli.fit(args, VideoData, Physics, finish)
    stacked = stack(Path(args[0]), args[1:])
    for remark in stacked.remarks:
        print(remark)
    return cli.fit(stacked.words, VideoData, Physics, finish, goes_on=True)


def finish(run_dir: Path, truth: str | None) -> None:
    """Evaluate a complete run, show the evaluation in TensorBoard, and write the report."""
    from pacnerf_lpo.evaluation.evaluate import RESULTS_FILE, evaluate_run
    from pacnerf_lpo.evaluation.run_directory import Run
    from pacnerf_lpo.evaluation.tables import markdown_table
    from pacnerf_lpo.report.html import is_evaluated, write_report
    from pacnerf_lpo.report.tensorboard_images import log_evaluation

    run = Run(run_dir)
    if run.config.get("intervals") and any(stage.record.phase == "physics" for stage in run.stages):
        from pacnerf_lpo.diagnosis.posterior import keep_intervals

        with StopRequest(), processes(None):
            keep_intervals(run, lambda text: print(f"intervals: {text}", flush=True))
    if truth is None and is_evaluated(run):
        results = json.loads((run_dir / RESULTS_FILE).read_text())
    else:
        results = evaluate_run(run_dir, truth)
        log_evaluation(run, results)
    print(markdown_table(results))
    print(f"report: {write_report(run_dir)}")
