"""Real measurements by the commands that a user has: ball drops with heights only, and flights with measured spins.

    python -m validation.real_measurements recordings/real --work runs/real

writes ``results/real_measurements.json``, the page made of it, and the pictures of ``docs/real_measurements.md``. What
was diagnosed already is taken as it is.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pacnerf_lpo.__main__ import main as command
from pacnerf_lpo.data.trajectories.scene import scenes_in
from pacnerf_lpo.report.wording import readable
from validation.real_pictures import draw
from validation.record import Record, keep, made, origin, read

BALLS = {
    "blue_basketball": "bluebasketball",
    "bowling_ball": "bowlingball",
    "golf_ball": "golfball",
    "tennis_ball": "tennisball",
    "whiffle_ball_1": "wiffleball1",
    "yellow_whiffle_ball": "yellowWiffle",
}
"""The files, and what balls.txt calls the balls."""
OUNCE = 0.0283495
REPLICATES = 8
"""Simulated nulls of twenty flights: the noise of so many positions is known well, so that few are enough."""
GROUP = 20
"""Flights that are diagnosed together; the last ones are a group if they are more than half as many."""
TABLE_TENNIS = ("0.04", "0.0027")
"""Diameter [m] and mass [kg] by the rules of the game."""


def run(*words: object) -> None:
    """A command line; raises RuntimeError where it fails."""
    if command([str(word) for word in words]):
        raise RuntimeError(f"failed: {' '.join(map(str, words))}")


def diagnosed(scenes: Sequence[Path], out: Path, *options: object) -> dict[str, Any]:
    """Row of the table for some scenes as one study, by options of ``diagnose``."""
    began = time.monotonic()
    if not (out / "diagnosis" / "diagnosis.html").is_file():
        run("diagnose", *scenes, "--out", out, "--jobs", 1, *options)
    result = json.loads((out / "diagnosis" / "diagnosis.json").read_text())
    last = result["rounds"][-1]
    shown = [p for p in last["parameters"] if "@" not in p["name"] or p["name"].startswith("release")]
    seconds = sum(spent["seconds"] for done in result["rounds"] for spent in done["effort"].values())
    return {
        "name": out.name,
        "recordings": len(result["flights"]),
        "verdict": result["verdict"],
        "indistinguishable": [done["indistinguishable"] for done in result["rounds"] if done["accepted"]],
        "p_values": {again["name"]: again["p_value"] for done in result["rounds"] for again in done["refits"]},
        "parameters": [{key: p[key] for key in ("name", "label", "value", "low", "high", "unit")} for p in shown],
        "seconds": seconds or time.monotonic() - began,
    }


def drops(data: Path, work: Path) -> list[dict[str, Any]]:
    """Both drops of every ball."""
    rows = [line.split() for line in (data / "balls.txt").read_text().splitlines()[1:]]
    known = {name: (weight, circumference) for name, weight, circumference in rows}
    found = []
    for file, name in BALLS.items():
        scene = work / "scenes" / file
        if not scene.is_dir():
            size, mass = float(known[name][1]) / 100 / math.pi, float(known[name][0]) * OUNCE
            run(
                "init", data / f"{file}.csv", scene, "--shape", "Ball", "--size", f"{size:.4f}", "--mass", f"{mass:.4f}"
            )
        found.append(diagnosed(scenes_in(scene), work / "diagnoses" / file))
    return found


def flights(data: Path, work: Path) -> list[dict[str, Any]]:
    """Flights before they touch something, twenty at a time, in the order of the files."""
    scene = work / "scenes" / "table_tennis"
    if not scene.is_dir():
        size, mass = TABLE_TENNIS
        body = ("--shape", "Ball", "--size", size, "--mass", mass)
        run("init", data, scene, *body, "--spins", data / "index.csv")
    folders = scenes_in(scene)
    groups = [folders[at : at + GROUP] for at in range(0, max(len(folders) - GROUP // 2, 1), GROUP)]
    out, options = work / "diagnoses", ("--replicates", REPLICATES)
    return [diagnosed(group, out / f"flights_{k}", *options) for k, group in enumerate(groups, 1)]


def page(result: Record) -> str:
    """The record as Markdown."""
    head = "| recordings | verdict | coefficients, 90 % interval | release [s] | time |\n|---|---|---|---|---|"
    by = "`python -m validation.real_measurements FOLDER`, which calls `init` and `diagnose`"
    parts = ["# Real measurements", origin(result, "real_measurements", by), INTRODUCTION]
    for title, rows in (("Ball drops", result["drops"]), ("Table tennis, twenty flights at a time", result["flights"])):
        parts += [f"## {title}", "\n".join([head, *(_row(row) for row in rows)])]
        details = [
            f"- {row['name']}: {' '.join([v['sentence'], *v['details']])}" for row in rows for v in [row["verdict"]]
        ]
        parts.append("\n".join(details))
    return "\n\n".join(parts) + "\n"


INTRODUCTION = (
    "These are development figures: how noise is estimated (from a cubic; errors that last are smooth), that a "
    "body which is let go starts from rest, what a calibration is trusted for (a percent), that every flight with"
    " a measured spin has a Magnus coefficient of its own, and which effects are tried in flight were chosen "
    "while some of these recordings were looked at; `simulated_drops.md` has simulated ones. Drops: de Silva, "
    "Higdon, Brunton and Kutz 2020; flights: Gossard, Tebbe, Ziegler and Zell 2023. A verdict of *unknown* says "
    "that what the nearest cause leaves looks more like a smooth force that differs from recording to recording "
    "than like noise, so that no cause is named."
)


def _row(row: dict[str, Any]) -> str:
    verdict = row["verdict"]
    alike = {names[0]: names for names in row["indistinguishable"]}
    named = [alike.get(name, [name]) for name in [*verdict["effects"], *verdict["nearest"]]]
    names = ", then ".join(" or ".join(readable(name) for name in names) for names in named)
    said = {"missing": names, "nothing": "nothing is missing", "unknown": f"unknown; nearest: {names or 'none'}"}
    shared = [p for p in row["parameters"] if "@" not in p["name"]]
    values = "; ".join(f"{p['value']:.3g} [{p['low']:.3g}, {p['high']:.3g}] {p['unit']}" for p in shared)
    releases = "; ".join(f"{p['value']:.2f}" for p in row["parameters"] if p["name"].startswith("release"))
    told = said.get(verdict["kind"], verdict["kind"])
    return f"| {row['name']} ({row['recordings']}) | {told} | {values} | {releases} | {row['seconds']:.0f} s |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, help="folder with ball_drops and table_tennis")
    parser.add_argument("--work", type=Path, default=Path("runs/real"), help="for scenes and diagnoses")
    parser.add_argument("--only", choices=("drops", "flights"), help="one of the two; the other stays as it was")
    given = parser.parse_args()
    result = read("real_measurements") | made()
    if given.only != "flights":
        result["drops"] = drops(given.data / "ball_drops", given.work)
    if given.only != "drops":
        result["flights"] = flights(given.data / "table_tennis", given.work)
    keep("real_measurements", result, page)
    draw(given.work)


if __name__ == "__main__":
    main()
