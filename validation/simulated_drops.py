"""Drops that are simulated as a video in a hand would show them: how often drag is found, and how often invented.

    python -m validation.simulated_drops --work runs/simulated

writes ``results/simulated_drops.json`` and the page made of it. The simulator shares nothing with the model: small
midpoint steps, another frame rate for each ball, time stamps that are off by a few milliseconds, and errors of four
kinds that the noise model does not have as they are: of the scale, of the perspective, of the hand (a sway of many
frequencies and a random walk) and of the tracker.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.data.trajectories.scene import scenes_in
from validation.real_measurements import diagnosed, run
from validation.record import Record, keep, made, origin

GRAVITY = 9.81
STEP = 1e-3
SWAYS = 8
JITTER = 2e-3
"""Of the time stamps [s]."""
KINDS = {"no air": None, "drag": (0.011, 0.06)}
"""Between which coefficients of quadratic drag one is drawn [1/m]: those that the real balls seem to have, from the
basketball to the lightest whiffle ball."""


@dataclass(frozen=True)
class Drop:
    """How one drop is filmed.

    start: height [m];  release: [s];  rate: samples a second
    scale, bend: errors of the heights at half the fall, by a wrong scale and by a perspective, as parts of the fall
    hand: standard deviation of the slow error [m];  lasting: of it [s];  white: of what is new in a sample [m]
    """

    start: float
    release: float
    rate: float
    scale: float
    bend: float
    hand: float
    lasting: float
    white: float

    @staticmethod
    def draw(random: np.random.Generator, rate: float, hand: float, lasting: float) -> Drop:
        """With errors as large as the residuals of the real drops."""
        start, release = random.uniform(45, 49), random.uniform(0.0, 0.3)
        scale, bend = 0.005 * random.standard_normal(2)
        return Drop(start, release, rate, scale, bend, hand, lasting, random.uniform(0.02, 0.04))


def heights(drop: Drop, drag: float, random: np.random.Generator, lowest: float = 12.0) -> tuple[np.ndarray, ...]:
    """Times [s] and heights [m] until the ball leaves the picture."""
    times, x, v, true, at = [], drop.start, 0.0, [], drop.release
    while x > lowest:
        time = len(times) / drop.rate
        while at < time:
            h = min(STEP, time - at)
            middle = v + 0.5 * h * (-GRAVITY + drag * v * v)
            x, v, at = x + h * middle, v + h * (-GRAVITY + drag * middle * middle), at + h
        times.append(time)
        true.append(x)
    t, y = np.array(times), np.array(true)
    share = (y[0] - y) / (y[0] - y[-1])
    fall = y[0] - y[-1]
    wrong = fall * (drop.scale * share + 4 * drop.bend * share * (1 - share)) + hand(t, drop, random)
    stamps = t + np.append(0.0, JITTER * random.uniform(-1, 1, len(t) - 1))
    return stamps, y + wrong + drop.white * random.standard_normal(len(t))


def hand(times: np.ndarray, drop: Drop, random: np.random.Generator) -> np.ndarray:
    """Errors of the direction of a camera that a person holds [m, (F,)]: sway with amplitudes that fall as the inverse
    frequency, and a random walk, half of the variance each.
    """
    frequency = np.exp(random.uniform(*np.log((0.3 / drop.lasting, 3.0)), SWAYS))
    waves = np.sin(2 * np.pi * frequency * times[:, None] + random.uniform(0, 2 * np.pi, SWAYS)) / frequency
    sway = waves.sum(1) / np.sqrt((1 / frequency**2).sum() / 2)
    walk = np.append(0.0, np.sqrt(np.diff(times)) * random.standard_normal(len(times) - 1)).cumsum()
    return drop.hand * (sway + walk / np.sqrt(drop.lasting)) / np.sqrt(2)


def write(folder: Path, seed: int, span: tuple[float, float] | None) -> tuple[float, list[Drop]]:
    """Two drops of one ball as ``ball.csv``; the drag [1/m] and how they were filmed."""
    random = np.random.default_rng((seed, span is not None))
    drag = 0.0 if span is None else float(np.exp(random.uniform(*np.log(span))))
    rate, size, lasting = random.uniform(12, 30), random.uniform(0.05, 0.2), random.uniform(0.3, 1.5)
    drops = [Drop.draw(random, rate, size, lasting) for _ in range(2)]
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "ball.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["drop", "time_s", "height_m"])
        for number, drop in enumerate(drops, 1):
            for time, height in zip(*heights(drop, drag, random), strict=True):
                writer.writerow([number, f"{time:.5f}", f"{height:.5f}"])
    return drag, drops


def trial(work: Path, kind: str, seed: int) -> dict[str, Any]:
    """One ball, diagnosed by the commands."""
    folder = work / kind.replace(" ", "_") / f"{seed:03d}"
    drag, drops = write(folder, seed, KINDS[kind])
    if not (folder / "scene").is_dir():
        body = ("--shape", "Ball", "--size", "0.2", "--mass", "0.5")
        run("init", folder / "ball.csv", folder / "scene", *body)
    verdict = diagnosed(scenes_in(folder / "scene"), folder / "diagnosis")
    releases = [p["value"] for p in verdict["parameters"] if p["name"].startswith("release")]
    return {
        "kind": kind,
        "seed": seed,
        "drag": drag,
        "verdict": verdict["verdict"],
        "parameters": verdict["parameters"],
        "release_errors": [found - drop.release for found, drop in zip(releases, drops, strict=False)],
        "drops": [asdict(drop) for drop in drops],
    }


def page(record: Record) -> str:
    """The record as Markdown."""
    trials = record["trials"]
    head = "| drops | balls | drag named | nothing named | something else named |\n|---|---|---|---|---|"
    rows = []
    for kind in KINDS:
        verdicts = [one["verdict"] for one in trials if one["kind"] == kind]
        air = [{"LinearDrag", "QuadraticDrag"} & set(v["effects"]) != set() for v in verdicts]
        none = [not v["effects"] for v in verdicts]
        other = [not a and not n for a, n in zip(air, none, strict=True)]
        rows.append(f"| {kind} | {len(verdicts)} | {sum(air)} | {sum(none)} | {sum(other)} |")
    wrong = np.abs([error for one in trials for error in one["release_errors"]])
    said = f"The release is found to {np.median(wrong):.2f} s (median), {np.quantile(wrong, 0.9):.2f} s (nine in ten)."
    each = "\n".join(
        f"- {one['kind']} {one['seed']}, {one['drag']:.3f} 1/m: {one['verdict']['sentence']}" for one in trials
    )
    begin = origin(record, "simulated_drops", "`python -m validation.simulated_drops`")
    return "\n\n".join(["# Simulated drops", begin, INTRODUCTION, "\n".join([head, *rows]), said, each]) + "\n"


INTRODUCTION = (
    "Two drops of a ball from about 47 m, of which a camera in a hand shows the heights, diagnosed by the commands "
    "`init` and `diagnose`."
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("runs/simulated"), help="for scenes and diagnoses")
    parser.add_argument("--count", type=int, default=20, help="balls of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.count)
    begun = made()
    trials = [trial(given.work, kind, seed) for kind in KINDS for seed in seeds]
    keep("simulated_drops", {**begun, "trials": trials}, page)


if __name__ == "__main__":
    main()
