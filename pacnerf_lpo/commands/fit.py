"""``pacnerf-lpo fit``: the phases of Algorithm 1 on a video, then evaluation and report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pacnerf_lpo import cli
from pacnerf_lpo.data.video_module import VideoData
from pacnerf_lpo.mpm.physics import Physics


def run(args: Sequence[str]) -> int:
    """Run the command; returns its exit status."""
    return cli.fit(args, VideoData, Physics, finish)


def finish(run_dir: Path, truth: str | None) -> None:
    """Evaluate a complete run, show the evaluation in TensorBoard, and write the report."""
    from pacnerf_lpo.evaluation.evaluate import evaluate_run
    from pacnerf_lpo.evaluation.run_directory import Run
    from pacnerf_lpo.evaluation.tables import markdown_table
    from pacnerf_lpo.report.html import write_report
    from pacnerf_lpo.report.tensorboard_images import log_evaluation

    results = evaluate_run(run_dir, truth)
    log_evaluation(Run(run_dir), results)
    print(markdown_table(results))
    print(f"report: {write_report(run_dir)}")
