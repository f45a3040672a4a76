"""``pacnerf-lpo diagnose``: which physical effect is missing in the model of a run."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Literal

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.diagnosis.diagnose import RESULT, Options, Step
from pacnerf_lpo.diagnosis.diagnose import diagnose as find
from pacnerf_lpo.identification.problem import PARTICLES
from pacnerf_lpo.report.diagnosis import write_page
from pacnerf_lpo.report.diagnosis_tensorboard import log_diagnosis


def run(
    run_dir: str,
    phase: str | None = None,
    candidates: str | None = None,
    twins: int = 20,
    effects: int = 3,
    until: Literal["compare", "localise", "screen", "refit"] = "refit",
    seed: int = 1,
    particles: int = PARTICLES,
    profile: str | None = None,
    tracks: str | None = None,
    clouds: str | None = None,
    images: bool = True,
    jobs: int | None = None,
) -> None:
    """Compare a run with its video, see where it fails, learn which effect is missing, and add it.

    Writes diagnosis.json, effects.yaml (for fit --config) and diagnosis.html into RUN_DIR/diagnosis. A stopped
    diagnosis goes on where it was; so do the single steps, with --until.

    example: pacnerf-lpo diagnose runs/demo

    example: pacnerf-lpo diagnose runs/demo --tracks points.csv --images false

    Args:
        run_dir: folder that fit wrote.
        phase: stem of a finished phase, such as 01_velocity; the last one before a correction when not given.
        candidates: YAML list of effects to try, as physics.effects has it; all known effects when not given.
        twins: simulated nulls that calibrate the statistics, 8 to 24.
        effects: at most so many effects are added.
        until: last step to do.
        seed: of the twins.
        particles: the body is sampled by about so many; fewer are faster and miss weaker effects.
        profile: name of an unknown, such as E, whose interval is found by profile likelihood, too (minutes).
        tracks: CSV of points followed over time: time_s, id, x_m, y_m, z_m and, if known, sigma_m; those of data.tracks
            when not given.
        clouds: folder of point clouds, cloud_<frame>.ply, in metres; those of data.clouds when not given.
        images: compare the outlines in the video, too.
        jobs: simulations at the same time, each in a process of its own; as many as torch may use threads, at most 8,
            when not given.
    """
    began = time.monotonic()
    step: Step = until
    options = Options(candidates, twins, effects, step, seed, particles, profile, tracks, clouds, images, jobs)
    with StopRequest():  # SIGTERM, too, ends the processes that simulate
        folder = find(
            run_dir, phase, options, lambda text: print(f"[{time.monotonic() - began:4.0f} s] {text}", flush=True)
        )
    write_page(folder)
    log_diagnosis(Path(run_dir))
    verdict = json.loads((folder / RESULT).read_text())["verdict"]
    print("\n".join([verdict["sentence"], *verdict["details"]]))
    print(f"results: {folder}")
