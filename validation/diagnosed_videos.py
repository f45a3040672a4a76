"""The page of four videos that were reconstructed and then diagnosed by ``pacnerf-lpo diagnose``."""

from __future__ import annotations

from typing import Any

from pacnerf_lpo.report.wording import readable
from validation.record import Record, origin, table

WORDS = """
Path-traced videos at 128 x 128 pixels from other simulators than this one, reconstructed from the video and then
diagnosed. All effects compete, but in the demo those of `demo_candidates`. **Development figures**: the method was
built while these were looked at; blind scenes are in [hidden effects](hidden_effects.md). In brackets: 90 %
intervals.
"""
LIMITS = """
Gravity and quadratic drag move the outlines in nearly the same way as linear drag, but leave more of the error. Fewer
particles than the default are no way to save time: with 2,500 and all effects, the bird is said to soften, and a
density gradient is named in addition to the torus's drag. **Two things are named that are not there**: in the bird, in
which nothing is hidden, a rotation of the only view in which the outlines turn by a degree against those of the model,
and in the torus a density gradient (p = 0.007), beside the drag that is there. Since a camera's fault is as rare as few
other cameras can say, the torus's cameras are believed; what is called a gradient may be an error of the shape, as the
faults of its cameras were before. Poisson's ratio comes out too large in all three: 0.35 [0.33, 0.36],
0.39 [0.33, 0.42] and 0.37 [0.34, 0.39] for 0.3. The times are of processors that differ by a factor of two, the slow
one for torus and bird; a second effect costs the torus another competition.
"""
COMMANDS = """
```sh
pacnerf-lpo fit --config fit --config scenes/torus --config cpu --config shared/drag_torus \\
    --data.root ../shared/data/drag_torus --outer_loop.run_dir runs/torus
pacnerf-lpo diagnose runs/torus
```
"""


def page(record: Record) -> str:
    """The record as Markdown."""
    head = [
        "video",
        "views",
        "hidden",
        "named",
        "coefficient",
        "true",
        "E [kPa]",
        "true",
        "E without it",
        "CPU",
        "commit",
    ]
    parts = [
        "# Four diagnosed videos",
        origin(record, "diagnosed_videos", "the command below on a finished run"),
        WORDS.strip(),
        table(head, [_row(video) for video in record["videos"]]),
        LIMITS.strip(),
        COMMANDS.strip(),
    ]
    return "\n\n".join(parts) + "\n"


def _row(video: dict[str, Any]) -> list[str]:
    coefficient, modulus = video.get("coefficient"), video["E_kPa"]
    names = [" and ".join(map(readable, video[key])) or "nothing" for key in ("hidden", "named")]
    found = [*(_shown(coefficient) if coefficient else "--"), *_shown(modulus)]
    without = f"{modulus['without_the_effect']:g}" if "without_the_effect" in modulus else "-"
    minutes = f"{video['cpu_minutes']:g} min" if "cpu_minutes" in video else "-"
    return [video["video"], video["views"], *names, *found, without, minutes, video["commit"]]


def _shown(found: dict[str, Any]) -> tuple[str, str]:
    """What was found, with its interval, and what is true."""
    missed = "" if found["low"] <= found["true"] <= found["high"] else " **missed**"
    value = f"{found['value']:g} {found.get('unit', '')} [{found['low']:g}, {found['high']:g}]{missed}"
    return value.replace("  ", " "), f"{found['true']:g}"
