"""Studies of two drops: ``python -m validation.hidden_effects.study FOLDER --first 7000 --count 15``.

One body falls twice, from different heights, with a drag or another gravity hidden in both. Each drop is diagnosed
alone, and both together; what counts is whether the effect is named exactly. What was finished is not done again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pacnerf_lpo.diagnosis.diagnose import Options, investigate
from pacnerf_lpo.diagnosis.plan import Proposal, propose
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.diagnosis.store import FOLDER, Store
from pacnerf_lpo.errors import RunError, SimulationError
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.study import StudyProblem
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.mpm import effects as known_effects
from pacnerf_lpo.report.diagnosis_result import write
from validation.hidden_effects.film import film
from validation.hidden_effects.known_shape import SETTING, TRUTH, VIDEO, KnownShape
from validation.hidden_effects.run import processor_time
from validation.hidden_effects.setting import FAST, another_drop, draw_setting
from validation.hidden_effects.strength import Ruler, course_of

DEVELOPMENT, SCORED = range(0, 1000), range(7000, 8000)
EFFECTS = ("LinearDrag", "QuadraticDrag", "GravityMagnitude")
SNR, RULER, ATTEMPTS = 20.0, 8, 8
HIGHER = (2.0, 3.0)
"""The second drop is higher by a factor from this range."""
DROPS = ("low", "high")
BOTH, OUTCOME, SUMMARY = "both", "outcome.json", "studies.json"
OPTIONS = Options(effects=1)


def generate(folder: Path, seed: int) -> Path:
    """Write both drops of a seed, unless they are there.

    Raises:
        RunError: no stable scene with the wanted strength was found.
    """
    target, name = folder / f"{seed:04d}", EFFECTS[seed % len(EFFECTS)]
    if (target / TRUTH).is_file():
        return target
    kind = getattr(known_effects, name)
    for attempt in range(ATTEMPTS):
        random = np.random.default_rng((seed, attempt))
        setting, true = draw_setting(random, FAST, None)
        try:
            sized = Ruler(setting, true, RULER).sized(kind(), course_of(kind(), random), SNR)
            if sized is None:
                continue
            values, effect = {**true, **sized.values}, kind(**sized.values)
            other, velocity = another_drop(random, FAST, setting, true, float(random.uniform(*HIGHER)))
            recorded = [
                (setting, film(setting, values, [effect], random, FAST.finer)),
                (other, film(other, {**values, **velocity}, [effect], random, FAST.finer)),
            ]
        except SimulationError:
            continue
        break
    else:
        raise RunError(f"study {seed}: {name} reaches {SNR:g} in none of {ATTEMPTS} draws")
    partial_folder = target.with_name(f".{target.name}.part")
    shutil.rmtree(partial_folder, ignore_errors=True)
    for drop, (used, filmed) in zip(DROPS, recorded, strict=True):
        (partial_folder / drop).mkdir(parents=True)
        silhouettes = (filmed.silhouettes * 255).round().to(torch.uint8).numpy()
        np.savez_compressed(partial_folder / drop / VIDEO, silhouettes=silhouettes, brightness=filmed.brightness)
        (partial_folder / drop / SETTING).write_text(json.dumps(used.as_json()))
    truth = {"name": name, "attempt": attempt, "values": values, "snr": sized.snr, "second": velocity}
    (partial_folder / TRUTH).write_text(json.dumps(truth, indent=1))
    partial_folder.rename(target)
    return target


def best_drop(proposals: Sequence[Proposal]) -> int | None:
    """Rank, from 1, of the first drop from a greater height; None if there is none."""
    ranks = [rank for rank, one in enumerate(proposals, 1) if one.higher > 1]
    return ranks[0] if ranks else None


def diagnose(study: Path) -> dict[str, Any]:
    """Diagnose both drops alone and together, and plan after the first one; what was said, compared with the truth."""
    outcome = study / OUTCOME
    if outcome.is_file():
        return json.loads(outcome.read_text())
    torch.set_num_threads(1)
    began, worked = time.monotonic(), processor_time()
    drops = [KnownShape.read(study / drop) for drop in DROPS]
    said: dict[str, Any] = {"seed": int(study.name)}
    for name, problem in (*zip(DROPS, drops, strict=True), (BOTH, StudyProblem(drops, DROPS))):
        rounds = _investigated(study, name, problem)
        first = rounds[0]
        said[name] = {
            "named": None if first.accepted is None else first.accepted.name,
            "indistinguishable": first.indistinguishable,
        }
        said[name]["contenders"] = {again.name: again.log_bayes_factor for again in first.refits}
        if name == DROPS[0] and len(first.indistinguishable) > 1:
            with open(study / "log.txt", "a", buffering=1) as log:
                plan = propose(problem, first, partial(print, file=log))
            said["plan"] = [asdict(one) for one in plan]
            said["plan_rank_of_higher_drop"] = best_drop(plan)
    truth = json.loads((study / TRUTH).read_text())
    said |= {"truth": truth["name"], "seconds": time.monotonic() - began, "cpu_seconds": processor_time() - worked}
    for name in (*DROPS, BOTH):
        said[name]["exact"] = said[name]["indistinguishable"] == [truth["name"]]
    write_atomically(outcome, json.dumps(said, indent=1).encode())
    return said


def _investigated(study: Path, name: str, problem: Problem) -> list[Round]:
    used = DROPS if name == BOTH else (name,)
    files = [study / drop / file for drop in used for file in (SETTING, VIDEO)]
    fingerprint = hashlib.sha256(b"".join(file.read_bytes() for file in files)).digest()
    folder = study / name / FOLDER
    with open(study / "log.txt", "a", buffering=1) as log:
        store = Store(folder, fingerprint, asdict(OPTIONS))
        told = partial(print, f"{name}: ", file=log)
        return investigate(problem, store, OPTIONS, told, partial(write, problem, folder))


def summary(outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """How often the effect is named exactly where one drop alone does not."""
    hard = [one for one in outcomes if not one[DROPS[0]]["exact"]]
    return {
        "studies": len(outcomes),
        "one_drop_cannot": len(hard),
        "exact_with_both": sum(one[BOTH]["exact"] for one in hard),
        "plan_put_a_higher_drop_first": sum(one.get("plan_rank_of_higher_drop") == 1 for one in hard),
        "exact_with_both_of_all": sum(one[BOTH]["exact"] for one in outcomes),
        "cpu_seconds": sum(one["cpu_seconds"] for one in outcomes),
        "outcomes": [{k: v for k, v in one.items() if k != "plan"} for one in outcomes],
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=SCORED.start, help="seed; below 1000: development")
    parser.add_argument("--count", type=int, default=15)
    options = parser.parse_args()
    outcomes = []
    for seed in range(options.first, options.first + options.count):
        try:
            outcomes.append(diagnose(generate(options.folder, seed)))
        except (RunError, SimulationError) as error:
            print(f"{seed}: failed ({error})", flush=True)
            continue
        one = outcomes[-1]
        said = "; ".join(f"{name}: {one[name]['indistinguishable']}" for name in (*DROPS, BOTH))
        print(f"{seed}: {one['truth']}; {said}", flush=True)
        write_atomically(options.folder / SUMMARY, json.dumps(summary(outcomes), indent=1).encode())


if __name__ == "__main__":
    main()
