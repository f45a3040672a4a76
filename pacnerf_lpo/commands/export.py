"""``pacnerf-lpo export``: particles and films of a run, for other programs."""

from __future__ import annotations

from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.report.export import export_particles, export_video


def run(run_dir: str, phase: str | None = None, views: list[int] | None = None) -> None:
    """Write particles as PLY, one file per frame, and a film (measured | model | signed residual) of each chosen view.

    example: pacnerf-lpo export runs/demo --views [0,3]

    Args:
        run_dir: folder that fit wrote.
        phase: stem of a finished phase, such as 02_r1_physics; the last one when not given.
        views: the numbers the files carry; the first training and the first test view when not given, [] for no film.
    """
    opened = Run(run_dir)
    stage = opened.stage(phase)
    video = opened.data.video
    chosen = [video.view_ids[s[0]] for s in (opened.data.train, opened.data.test) if s] if views is None else views
    indices = [opened.view_index(view) for view in chosen]
    print(export_particles(opened, stage))
    for index in indices:
        print(export_video(opened, stage, video.view_ids[index]))
