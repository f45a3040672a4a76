"""``pacnerf-lpo diagnose``: which physical effect is missing in the model of a run."""

from __future__ import annotations

import json
import time
from functools import partial
from typing import Literal

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.diagnosis.diagnose import Options, Step, investigate, prepare
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.identification.problem import PARTICLES
from pacnerf_lpo.identification.processes import processes
from pacnerf_lpo.identification.study import without_contact
from pacnerf_lpo.named_configs import find_config
from pacnerf_lpo.report.diagnosis import write_page
from pacnerf_lpo.report.diagnosis_result import RESULT, write
from pacnerf_lpo.report.diagnosis_stages import write_pictures
from pacnerf_lpo.report.diagnosis_tensorboard import log_diagnosis


def run(
    run_dirs: list[str] | str,
    phase: str | None = None,
    candidates: str | None = None,
    replicates: int = 20,
    effects: int = 3,
    until: Literal["compare", "localise", "screen", "refit"] = "refit",
    seed: int = 1,
    particles: int = PARTICLES,
    profile: str | None = None,
    tracks: str | None = None,
    clouds: str | None = None,
    images: bool = True,
    jobs: int | None = None,
    out: str | None = None,
    per_recording: list[str] = [],  # noqa: B006
) -> None:
    """Compare a run with its video, see where it fails, learn which effect is missing, and add it.

    Writes diagnosis.json, effects.yaml (for fit --config) and diagnosis.html into RUN_DIR/diagnosis. A stopped
    diagnosis goes on where it was; so do the single steps, with --until.

    Several runs of one object are a study: material and effects are those of the object; velocity, ground, spin and
    camera faults belong to each recording.

    example: pacnerf-lpo diagnose runs/demo

    example: pacnerf-lpo diagnose runs/demo --tracks points.csv --images false

    example: pacnerf-lpo diagnose runs/low runs/high --out runs/both

    Scenes of measured flights, which init makes of positions without a video, are diagnosed in the same way, without a
    fit before; a folder of several is a study.

    Args:
        run_dirs: folder that fit wrote, or scene of a measured flight, or several.
        phase: stem of a finished phase, such as 01_velocity; the last one before a correction when not given.
        candidates: YAML list of effects to try, as physics.effects has it: a file, or a name such as demo_candidates;
            all known effects when not given.
        replicates: simulated recordings of the fitted model that calibrate the statistics, 8 to 24.
        effects: at most so many effects are added.
        until: last step to do.
        seed: of the replicates.
        particles: the body is sampled by about so many; fewer are faster and miss weaker effects.
        profile: name of an unknown, such as E, whose interval is found by profile likelihood, too (minutes).
        tracks: CSV of points followed over time: time_s, id, x_m, y_m, z_m and, if known, sigma_m; those of data.tracks
            when not given.
        clouds: folder of point clouds, cloud_<frame>.ply, in metres; those of data.clouds when not given.
        images: compare the outlines in the video, too.
        jobs: simulations at the same time, each in a process of its own; as many as torch may use threads, at most 8,
            when not given, and one of measured flights.
        out: folder for the results of a study, which go into its subfolder diagnosis.
        per_recording: effects, such as UniformForce, that every recording of a study has for itself.
    """
    began = time.monotonic()
    step: Step = until
    listed = None if candidates is None else str(find_config(candidates, "--candidates"))
    options = Options(
        listed, replicates, effects, step, seed, particles, profile, tracks, clouds, images, jobs, per_recording
    )
    runs = [run_dirs] if isinstance(run_dirs, str) else run_dirs
    problem, store = prepare(runs, phase, options, out)
    folder = store.folder
    Settings(runs, phase, options).write(folder)

    def tell(text: str) -> None:
        print(f"[{time.monotonic() - began:4.0f} s] {text}", flush=True)

    for sentence in without_contact(problem):
        tell(sentence)
    with (
        StopRequest(),
        processes(jobs if problem.deforms else jobs or 1),
    ):  # SIGTERM, too, ends the processes that simulate
        rounds = investigate(problem, store, options, tell, partial(write, problem, folder))
    write_pictures(problem, rounds, folder)
    write_page(folder)
    log_diagnosis(folder.parent)
    verdict = json.loads((folder / RESULT).read_text())["verdict"]
    print("\n".join([verdict["sentence"], *verdict["details"]]))
    print(f"results: {folder}")
