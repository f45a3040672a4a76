"""Diagnose the scenes of a folder: ``python -m validation.hidden_effects.run FOLDER --jobs 2``.

What was finished is not done again, and a diagnosis that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import joblib
import torch

from pacnerf_lpo.diagnosis.diagnose import Options, investigate
from pacnerf_lpo.diagnosis.store import FOLDER, SCHEMA, Store
from pacnerf_lpo.errors import RunError, SimulationError
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report.diagnosis_result import RESULT, write
from validation.hidden_effects import full, simpler
from validation.hidden_effects.known_shape import SETTING, VIDEO, KnownShape

EFFORT, FAILURE, SIMPLER = "effort.json", "failure.txt", "simpler.json"
FAST = Options()


def diagnose_scene(scene: Path, options: Options = FAST) -> str:
    """Diagnose one scene, unless that is done; a sentence about it. A failure is kept with the scene, and counted.

    Args:
        scene: folder of the scene.
        options: of the diagnosis on the fast path; the full one takes what the command line takes.
    """
    folder = scene / FOLDER
    if (scene / EFFORT).is_file():
        return f"{scene.name}: done before"
    torch.set_num_threads(1)
    began, worked = time.monotonic(), processor_time()
    try:
        if full.reconstructed_from(scene):
            full.reconstruct_and_diagnose(scene)
        else:
            problem = KnownShape.read(scene)
            fingerprint = hashlib.sha256((scene / SETTING).read_bytes() + (scene / VIDEO).read_bytes()).digest()
            with open(scene / full.LOG, "a", buffering=1) as log:
                store = Store(folder, fingerprint, asdict(options))
                rounds = investigate(problem, store, options, partial(print, file=log), partial(write, problem, folder))
            write_atomically(scene / SIMPLER, json.dumps(simpler.verdicts(problem, rounds)).encode())
    except (RunError, SimulationError) as error:
        (scene / FAILURE).write_text(f"{error}\n")
        return f"{scene.name}: failed ({error})"
    effort = {
        "seconds": time.monotonic() - began,
        "cpu_seconds": processor_time() - worked,
        "schema": SCHEMA,
    }
    write_atomically(scene / EFFORT, json.dumps(effort).encode())
    verdict = json.loads((folder / RESULT).read_text())["verdict"]
    return f"{scene.name}: {verdict['sentence']} ({effort['cpu_seconds']:.0f} s)"


def processor_time() -> float:
    """Seconds of processor time of this process and of the commands that it ran."""
    return sum(os.times()[:4])


def run_all(scenes: Sequence[Path], jobs: int) -> Iterator[str]:
    """A line for every scene."""
    yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(
        joblib.delayed(diagnose_scene)(scene) for scene in scenes
    )


def scenes_in(folder: Path) -> list[Path]:
    """The scenes of a folder, by seed."""
    return sorted(path.parent for path in folder.glob(f"[0-9]*/{SETTING}"))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    scenes = scenes_in(options.folder)
    for number, line in enumerate(run_all(scenes, options.jobs), 1):
        print(f"[{number}/{len(scenes)}] {line}", flush=True)


if __name__ == "__main__":
    main()
