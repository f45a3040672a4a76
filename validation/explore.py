"""How long a person waits in a session and on its page: a change, a suggestion, a fit; and how fluently it plays.

    python -m validation.explore --run runs/demo_missing --keep

Made for the demo's drag scene after its diagnosis (``make demo``). In the session the clock runs from the call to the
moment at which the new motion, the outlines of one camera in all frames and the errors are there; on the page (see
:mod:`validation.explore_page`) from the event of a slider to the redrawn picture.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from pacnerf_lpo.explore import Session
from validation import explore_page
from validation.record import Record, keep, made, origin

CHANGES = 30
WORDS = {
    "coarse": (f"a change on the coarse body, median of {CHANGES}", 0.7),
    "refined": (f"the same on the fine body, after the hand rests, median of {CHANGES}", 2.5),
    "suggest": ("what would help, with warm processes", 15.0),
    "fit": ("a fit of three unknowns", 30.0),
}
"""What a person asks for, and the seconds that it may take on two cores."""
FLUENT = 20.0
"""Frames a second from which a motion looks like one."""


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds, and what the call returns."""
    began = time.perf_counter()
    result = call()
    return time.perf_counter() - began, result


def looked_at(session: Session, camera: int) -> None:
    """What a page shows of a step: motion, outlines of the chosen camera, errors."""
    session.motion()
    session.error()
    for frame in range(len(session.times())):
        session.outlines(camera, frame)


def changes(session: Session) -> dict[str, list[float]]:
    """Seconds of every change of the drag."""
    camera = session.cameras()[0].view
    found: dict[str, list[float]] = {"coarse": [], "refined": []}

    def changed(value: float) -> None:
        session.set("drag", value, dragging=True)
        looked_at(session, camera)

    def refined() -> None:
        session.refine()
        looked_at(session, camera)

    changed(0.05)  # compiles the kernel
    refined()
    for value in np.linspace(0.1, 3.0, CHANGES):
        found["coarse"].append(timed(lambda value=value: changed(float(value)))[0])
        found["refined"].append(timed(refined)[0])
    return found


def measure(run: Path, jobs: int | None) -> dict[str, Any]:
    """All figures of a run."""
    opened, session = timed(lambda: Session.open(run, jobs=jobs))
    begun = session.current
    prepared, _ = timed(session.prepare)
    found: Record = {
        **made(),
        "load": os.getloadavg()[0],
        "open": opened,
        "prepare": prepared,
        "changes": changes(session),
    }
    session.go_to(begun.number)
    found["suggest"], suggestions = timed(session.suggest)
    best = suggestions[0]
    session.add(best.effect, best.values)
    three = [*best.values, "E", "v_y"][:3]
    found["fit"], fitted = timed(lambda: session.fit(three))
    return {
        **found,
        "coarse": median(found["changes"]["coarse"]),
        "refined": median(found["changes"]["refined"]),
        "suggested": [[one.effect, one.log_bayes_factor, one.p_value] for one in suggestions[:4]],
        "fitted": {name: [fitted.values[name], *fitted.intervals.get(name, ())] for name in three},
        "held_out": [begun.held_out, fitted.held_out],
    }


def page(found: Record) -> str:
    """The record as Markdown."""
    lines = [
        "# How long a person waits in a session",
        "",
        origin(found, "explore", "`python -m validation.explore --keep`"),
        "",
        f"The demo's drag scene after its diagnosis; load {found['load']:.1f} at the beginning; in a headless Chromium "
        "that draws by software, as on a machine without a graphics card.",
        "",
        "| question | session [s] | page [s] | wanted |",
        "|---|---|---|---|",
        *(
            f"| {words} | {found[name]:.2f} | {found['page'].get(name, '')} | at most {most:g} |"
            for name, (words, most) in WORDS.items()
        ),
        f"| playing, frames a second | | {found['page']['frames_per_second']} | at least {FLUENT:g} |",
        f"| opening the run | {found['open']:.1f} | | |",
        f"| preparing in the background | {found['prepare']:.1f} | | |",
        "",
        "Suggested: "
        + ", ".join(f"{name} (log Bayes factor {factor:.0f})" for name, factor, _ in found["suggested"])
        + ". Fitted: "
        + ", ".join(f"{name} {value[0]:.4g}" for name, value in found["fitted"].items())
        + f"; the held-out error went from {found['held_out'][0]:.2f} to {found['held_out'][1]:.2f} pixels.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, default=Path("runs/demo_missing"), help="a run and its diagnosis")
    parser.add_argument("--jobs", type=int, help="processes; as many as a session takes when not given")
    parser.add_argument("--keep", action="store_true", help="write validation/results/explore.json and its page")
    options = parser.parse_args()
    found = {**measure(options.run, options.jobs), "page": explore_page.measure(options.run, CHANGES)}
    print(page(found))
    if options.keep:
        keep("explore", found, page)


if __name__ == "__main__":
    main()
