"""Videos that were reconstructed and then diagnosed by ``pacnerf-lpo diagnose``, with their answer sheets:

    python -m validation.diagnosed_videos runs/torus runs/cat runs/bird --videos ../shared/data

writes ``results/diagnosed_videos.json`` and the page made of it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pacnerf_lpo.evaluation.parameter_errors import read_truth
from pacnerf_lpo.quantities import quantity, symbol
from pacnerf_lpo.report.wording import readable
from validation.record import Record, keep, made, origin, table

HIDDEN = {
    "linear_drag": ("LinearDrag", "drag", "c_per_s"),
    "floor_coulomb_friction": ("GroundFriction", "ground_friction", "mu"),
}
"""What the answer sheets call an effect: its class here, its coefficient here, and there."""
WORDS = """
Path-traced videos at 128 x 128 pixels from other simulators than this one, reconstructed from the video and then
diagnosed. All effects compete. **Development figures**: the method was built while these were looked at; blind scenes
are in [hidden effects](hidden_effects.md).

*Interval*: the one of reports, 90 %, with what another solver may change. *Of our solver*: without that; a third to a
tenth as wide. What the truth lies outside of is **bold**.
"""
LIMITS = """
Gravity and quadratic drag move the outlines in nearly the same way as linear drag, but leave more of the error. What
is left beside the named effects passes the check in all of them. The size of one force, 2 % of the acceleration by
contact, was chosen on these videos: it was what made them most likely
([the error of the solver](solver_error.md)), and errors of the shape are simulated at two resolutions, as these videos
are far more probable so. Versions before took what the bird's solver dissipates for a viscosity (13 and 61 Pa s): that
is an error of every model now, and an effect is taken back that its own model does not need.

**The cat** had two effects too many in the version before: a uniform force and a force by spin, which are not there.
Since a body is taken to lie inside of what no outline bounds (its underside moves by up to 8 mm), the best fit with
friction costs less, and nothing else is named.

In the bird a gradient of the stiffness is accepted in the first round (p = 0.0002), and taken back after the second: it
is not needed beside what a model with it may get wrong.

Poisson's ratio comes out too large in all of them, in the cat beyond its interval; E of the bird is 3 % beyond its.

Torus, cat and bird took 784, 802 and 658 seconds of one core, beside other work. A version before diagnosed the torus
in 6 min 24 s, alone on two cores (commit 2232540).
"""
COMMANDS = """
```sh
pacnerf-lpo fit --config fit --config scenes/torus --config cpu --config shared/drag_torus \\
    --data.root ../shared/data/drag_torus --outer_loop.run_dir runs/torus --outer_loop.rounds 0
pacnerf-lpo diagnose runs/torus
```

The cat is fitted with `scenes/torus` and `shared/slip_cat`, the bird with `scenes/bird` and `shared/null_bird`.
"""


def row(run: Path, videos: Path) -> dict[str, Any]:
    """One video: views, effects, and of every value that the answer sheet has what was found and what is true [SI]."""
    result = json.loads((run / "diagnosis" / "diagnosis.json").read_text())
    truth = read_truth(videos / result["scene"] / "truth.json")
    true, hidden = dict(truth.parameters), []
    for name, values in truth.hidden_effects.items():
        kind, coefficient, key = HIDDEN[name]
        hidden.append(kind)
        true[coefficient] = values[key]
    first, last = ({p["name"]: p for p in result["rounds"][end]["parameters"]} for end in (0, -1))
    return {
        "video": result["scene"],
        "views": len(result["views"]),
        "hidden": hidden,
        "named": result["verdict"]["effects"],
        "values": {name: _value(last[name], true[name], first.get(name)) for name in true if name in last},
    }


def _value(found: Mapping[str, Any], true: float, before: Mapping[str, Any] | None) -> dict[str, Any]:
    kept = {key: found[key] for key in ("value", "low", "high", "with_solver", "unit")}
    return {**kept, "true": true, "without": None if before is None else before["value"]}


def page(record: Record) -> str:
    """The record as Markdown."""
    head = ["video", "views", "hidden", "named", "", "true", "found", "interval", "of our solver", "without the effect"]
    parts = [
        "# Diagnosed videos",
        origin(record, "diagnosed_videos", f"`{record['command']}`"),
        WORDS.strip(),
        table(head, [line for video in record["videos"] for line in _lines(video)]),
        LIMITS.strip(),
        COMMANDS.strip(),
    ]
    return "\n\n".join(parts) + "\n"


def _lines(video: Mapping[str, Any]) -> list[list[str]]:
    effects = [" and ".join(map(readable, video[key])) or "nothing" for key in ("hidden", "named")]
    first, lines = [video["video"], str(video["views"]), *effects], []
    for name, one in video["values"].items():
        ends = [_shown(ends, one) for ends in (one["with_solver"], (one["low"], one["high"]))]
        changed = video["hidden"] and one["without"] is not None
        values = [quantity(one[key], one["unit"]) for key in ("true", "value", *(["without"] if changed else []))]
        lines.append([*first, symbol(name), *values[:2], *ends, *(values[2:] or ["-"])])
        first = [""] * len(first)
    return lines


def _shown(ends: Sequence[float], one: Mapping[str, Any]) -> str:
    low, high = ends
    text = f"{quantity(low, one['unit'])} to {quantity(high, one['unit'])}"
    return text if low <= one["true"] <= high else f"**{text}**"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", help="diagnosed runs")
    parser.add_argument("--videos", type=Path, required=True, help="folder of the scenes, with their answer sheets")
    parser.add_argument("--commit", help="with which the runs were made, where that is not this one")
    options = parser.parse_args()
    command = (
        f"python -m validation.diagnosed_videos {' '.join(f'runs/{run.name}' for run in options.runs)} --videos ..."
    )
    rows = [row(run, options.videos) for run in options.runs]
    keep(
        "diagnosed_videos",
        {**made(), **({"commit": options.commit} if options.commit else {}), "command": command, "videos": rows},
        page,
    )


if __name__ == "__main__":
    main()
