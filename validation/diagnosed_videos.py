"""The page of four videos that were reconstructed and then diagnosed by ``pacnerf-lpo diagnose``."""

from __future__ import annotations

from typing import Any

from pacnerf_lpo.report.wording import readable
from validation.record import Record, origin, table

WORDS = """
Path-traced videos at 128 x 128 pixels from other simulators than this one, reconstructed from the video and then
diagnosed. All effects compete, but in the demo those of `demo_candidates`. **Development figures**: the method was
built while these were looked at; blind scenes are in [hidden effects](hidden_effects.md). In brackets: 90 %
intervals, with what another solver may change.
"""
LIMITS = """
Gravity and quadratic drag move the outlines in nearly the same way as linear drag, but leave more of the error. What
is left beside the named effects passes the check in all four (p = 0.5 and more in the held-out data). The size of
one force, 2 % of the acceleration by contact, was chosen on the first, third and fourth of these videos: it was what
made them most likely ([the error of the solver](solver_error.md)), and errors of the shape are simulated at two
resolutions, as these videos are far more probable so. Versions before took what the bird's solver dissipates for a
viscosity (13 and 61 Pa s): that is an error of every model now, and an effect is taken back that is not needed beside
what a model with it may get wrong.

**The cat has two effects too many.** A uniform force of 0.39 m/s^2 and a force by spin are named beside the friction
(p < 0.0001 and p = 0.0005), which are not there; values are those before the second of them was added, as the diagnosis
was stopped there. The version before named friction alone, of another reconstruction of the same video; on this one it,
too, went on after the friction.

**What another solver may change** is most of these intervals: of this solver alone they are a third to a tenth as wide.
Those miss E in torus (81.5 to 86.4 kPa) and bird (88.9 to 92.7), the friction (0.114 to 0.136) and Poisson's ratio in
all three; they hold the drag (1.456 to 1.504) and the cat's E (74.2 to 80.8). Poisson's ratio comes out too large, in
the cat beyond its interval: torus 0.351 [0.144, 0.424], cat 0.404 [0.351, 0.430], bird 0.321 [0.252, 0.369], for 0.3.

Two other jobs ran on the two cores: the times are no measurement. The version before took 7.0, 6.4 and 4.3 minutes for
torus, cat and bird beside tests. Later (commit 2232540) the torus was diagnosed once more, alone on the two cores:
6 min 24 s, with the same result.
"""
COMMANDS = """
```sh
pacnerf-lpo fit --config fit --config scenes/torus --config cpu --config shared/drag_torus \\
    --data.root ../shared/data/drag_torus --outer_loop.run_dir runs/torus
pacnerf-lpo diagnose runs/torus
```

The cat is fitted with `scenes/torus` and `shared/slip_cat`, the bird with `scenes/bird` and `shared/null_bird`; the
diagnoses are of runs with `--outer_loop.rounds 0`.
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
        "time",
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
    minutes = f"{video['minutes']:g} min" if "minutes" in video else "-"
    return [video["video"], video["views"], *names, *found, without, minutes, video["commit"]]


def _shown(found: dict[str, Any]) -> tuple[str, str]:
    """What was found, with its interval, and what is true."""
    missed = "" if found["low"] <= found["true"] <= found["high"] else " **missed**"
    value = f"{found['value']:g} {found.get('unit', '')} [{found['low']:g}, {found['high']:g}]{missed}"
    return value.replace("  ", " "), f"{found['true']:g}"
