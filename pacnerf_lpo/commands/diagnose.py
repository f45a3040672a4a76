"""``pacnerf-lpo diagnose``: which physical effect is missing in the model of a run."""

import json
import time
from functools import partial
from pathlib import Path
from typing import Literal

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.data.trajectories.scene import scenes_in
from pacnerf_lpo.diagnosis.diagnose import Options, investigate, prepare
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.errors import Interrupted
from pacnerf_lpo.heartbeat import doing
from pacnerf_lpo.identification.problem import PARTICLES
from pacnerf_lpo.identification.processes import processes
from pacnerf_lpo.identification.study import without_contact
from pacnerf_lpo.manifest import FILE_NAME, Manifest
from pacnerf_lpo.named_configs import find_config
from pacnerf_lpo.report.diagnosis import write_page
from pacnerf_lpo.report.diagnosis_result import RESULT, write
from pacnerf_lpo.report.diagnosis_stages import write_pictures
from pacnerf_lpo.report.tensorboard_images import log_diagnosis
from pacnerf_lpo.scene_folder import RUN, is_scene


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

    example: pacnerf-lpo diagnose scenes/drop

    example: pacnerf-lpo diagnose runs/demo --tracks points.csv --images false

    example: pacnerf-lpo diagnose runs/low runs/high --out runs/both

    Scenes of measured flights, which init makes of positions without a video, are diagnosed in the same way, without a
    fit before; a folder of several is a study.

    Args:
        run_dirs: folder that fit wrote, or scene, or several. A scene of cameras without a fit is reconstructed
            first, as `fit SCENE --outer_loop.rounds 0` does it; the scene of a measured flight needs no fit.
        phase: stem of a finished phase, such as 01_velocity; the last one before a correction when not given.
        candidates: YAML list of effects to try, as physics.effects has it: a file, or a name such as demo_candidates;
            all known effects when not given.
        replicates: simulated recordings of the fitted model that calibrate the statistics, 8 to 24.
        effects: at most so many effects are added.
        until: last step to do.
        seed: of the replicates.
        particles: the body is sampled by about so many; fewer are faster, miss weaker effects, and may
            take errors of thin parts for one (a bird of 2,500 seemed to soften, one of 4,000 did not).
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
    listed = None if candidates is None else str(find_config(candidates, "--candidates"))
    options = Options(
        listed, replicates, effects, until, seed, particles, profile, tracks, clouds, images, jobs, per_recording
    )
    runs = [reconstructed(given) for given in ([run_dirs] if isinstance(run_dirs, str) else run_dirs)]
    doing("reading the runs")
    problem, store = prepare(runs, phase, options, out)
    folder = store.folder
    Settings(runs, phase, options).write(folder)

    def tell(text: str) -> None:
        doing(text)
        print(f"[{time.monotonic() - began:4.0f} s] {text}", flush=True)

    for sentence in without_contact(problem):
        tell(sentence)
    try:
        with StopRequest(), processes(jobs if problem.deforms else jobs or 1):  # SIGTERM, too, ends the processes
            rounds = investigate(problem, store, options, tell, partial(write, problem, folder))
    except Interrupted:
        raise Interrupted(f"interrupted; the same command goes on after the steps that are in {folder}") from None
    doing("writing the page")
    write_pictures(problem, rounds, folder)
    write_page(folder)
    log_diagnosis(folder.parent)
    verdict = json.loads((folder / RESULT).read_text())["verdict"]
    print("\n".join([verdict["sentence"], *verdict["details"]]))
    print(f"results: {folder}")


def reconstructed(folder: str) -> str:
    """The run that is meant; of a scene, its own, fitted first where needed. Raises what :mod:`fit` does."""
    if not is_scene(folder) or scenes_in(Path(folder)):
        return folder
    run_dir = Path(folder) / RUN
    done = Manifest.load(run_dir).done if (run_dir / FILE_NAME).is_file() else []
    if all(record.phase != "velocity" for record in done):
        from pacnerf_lpo.commands import fit  # here, for Lightning takes seconds to import

        print(f"{folder}: body and velocity first, as `pacnerf-lpo fit {folder} --outer_loop.rounds 0`", flush=True)
        fit.run([folder, "--outer_loop.rounds", "0"])
    return str(run_dir)
