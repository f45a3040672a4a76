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
Gravity and quadratic drag move the outlines in nearly the same way as linear drag, but leave more of the error. **In
the cat the cause is said to be unknown**, with ground friction as the nearest known one: friction removes 97 % of the
held-out error beyond noise, and what is left passes the check (p = 0.24), but an unknown smooth force still explains
more of it than chance would. Its coefficients are those of the model with friction. A version before, whose outlines
were less exact, named friction, 0.110 [0.084, 0.135]. Most of the cat's time goes into further effects that are
fitted in vain beside that force. **Intervals of E are too narrow**: three of four miss, by 0.01 to 0.03 in log10.
Poisson's ratio comes out too large in all: 0.354 [0.339, 0.368], 0.358 [0.326, 0.382], 0.418 [0.402, 0.429] and 0.315
[0.305, 0.325] for 0.3. The times are of one process on a slow machine with another job beside it.
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
    if "nearest" in video:
        names[1] = f"an unknown cause; nearest: {readable(video['nearest'])}"
    found = [*(_shown(coefficient) if coefficient else "--"), *_shown(modulus)]
    without = f"{modulus['without_the_effect']:g}" if "without_the_effect" in modulus else "-"
    minutes = f"{video['cpu_minutes']:g} min" if "cpu_minutes" in video else "-"
    return [video["video"], video["views"], *names, *found, without, minutes, video["commit"]]


def _shown(found: dict[str, Any]) -> tuple[str, str]:
    """What was found, with its interval, and what is true."""
    missed = "" if found["low"] <= found["true"] <= found["high"] else " **missed**"
    value = f"{found['value']:g} {found.get('unit', '')} [{found['low']:g}, {found['high']:g}]{missed}"
    return value.replace("  ", " "), f"{found['true']:g}"
