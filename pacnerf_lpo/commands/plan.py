"""``pacnerf-lpo plan``: which recording to make next."""

from functools import partial
from pathlib import Path

from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.diagnosis.diagnose import investigate, prepare
from pacnerf_lpo.diagnosis.plan import last_open, propose
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.diagnosis.store import FOLDER
from pacnerf_lpo.identification.processes import processes
from pacnerf_lpo.report.diagnosis import PICTURES_FILE, write_page
from pacnerf_lpo.report.diagnosis_result import write
from pacnerf_lpo.report.plan import sentences, write_plan


def run(run_dir: str, jobs: int | None = None) -> None:
    """Rank recordings that would separate what a diagnosis could not.

    Simulates recordings that a person could make of the same object (another height, a throw, a spin, another frame
    rate, a longer recording, nearer cameras) under every hypothesis that is left, and ranks them by the expected log
    Bayes factor. Writes plan.json and plan.html into RUN_DIR/diagnosis, and the best one into diagnosis.html.

    example: pacnerf-lpo plan runs/demo

    Args:
        run_dir: folder that was diagnosed: a run, a scene, or the one given with --out.
        jobs: simulations at the same time, as for diagnose.
    """
    folder = Path(run_dir) / FOLDER
    settings = Settings.read(folder)
    problem, store = prepare(settings.runs, settings.phase, settings.options, run_dir)
    tell = partial(print, flush=True)
    with StopRequest(), processes(jobs):
        rounds = investigate(problem, store, settings.options, tell)
        last = last_open(rounds)
        last.proposals = propose(problem, last, tell)
    write(problem, folder, rounds)
    if (folder / PICTURES_FILE).is_file():
        write_page(folder)
    path = write_plan(folder, problem.scene, last.indistinguishable, last.proposals)
    print("\n".join(sentences(last.indistinguishable, last.proposals)))
    print(f"results: {path}")
