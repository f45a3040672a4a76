"""The history of a session as one self-contained page: motion in 3-D, steps and errors, without a server."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from pacnerf_lpo.explore.page import charts
from pacnerf_lpo.explore.records import Errors, Step
from pacnerf_lpo.explore.session import Session
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.quantities import figure, quantity, symbol
from pacnerf_lpo.report.page import page, parts, webp_uri
from pacnerf_lpo.report.payload import moving_particles

STORY = "story.html"
MOST_STEPS = 12
"""Steps whose motion is kept: some five megabytes; all steps are listed."""
MOST_PARTICLES = 2000
STYLES = ("report.css", "story.css")
SCRIPTS = ("base.js", "space.js", "viewer.js", "story.js")
SIDE = 420
"""Height of the pictures [pixels]."""


def write_story(session: Session, path: Path) -> Path:
    """Write the page of a session's first recording; returns its path. Raises UserInputError where no step moves."""
    steps, current = session.steps, session.current
    kept = chosen_steps(steps, current.number)
    errors = {step.number: session.error(step.number).of(session.recordings[0]) for step in kept}
    at = worst(errors[kept[0].number], len(session.cameras()))
    shown_steps = {str(step.number): step_payload(session, step, errors[step.number], at) for step in kept}
    shown = current if current in kept else kept[-1]
    motion = session.motion(shown.number)
    data = {
        "steps": shown_steps,
        "current": shown.number,
        "frame": at[1] if at else 0,
        "particles": shown_steps[str(shown.number)]["particles"],
        "times": motion.times.tolist(),
        "frames": [f"frame {frame}" for frame in range(len(motion.times))],
    }
    text = page(
        "story",
        f"{session.name}: {headline(session)}",
        STYLES,
        SCRIPTS,
        data,
        eyebrow=session.name,
        headline=headline(session),
        steps=Markup(charts.history(steps, shown.number, session.unit, "step")),
    )
    write_atomically(path, text.encode())
    return path


def headline(session: Session) -> str:
    """The first and the current error in words."""
    first, now = session.steps[0], session.current
    for kind, a, b in (("held-out", first.held_out, now.held_out), ("fitted", first.fitted, now.fitted)):
        if a is not None and b is not None:
            return f"{kind} error from {figure(a)} to {figure(b, session.unit)}"
    return "an unstable model"


def chosen_steps(steps: tuple[Step, ...], current: int) -> list[Step]:
    """At most :data:`MOST_STEPS` stable steps: the first, the current one, and those with the smallest errors."""
    stable = [step for step in steps if step.trouble is None]
    ranked = sorted(stable, key=lambda step: (step.number not in (0, current), step.fitted or math.inf))
    return sorted(ranked[:MOST_STEPS], key=lambda step: step.number)


def worst(errors: Errors, cameras: int) -> tuple[int, int] | None:
    """Camera and frame where the error is largest; None where there is none."""
    seen = errors.table[:cameras]
    if not np.isfinite(seen).any():
        return None
    return divmod(int(np.nanargmax(seen)), seen.shape[1])


def step_payload(session: Session, step: Step, errors: Errors, at: tuple[int, int] | None) -> dict[str, Any]:
    """What the page shows of a step."""
    motion = session.motion(step.number)
    colours = np.rint(255 * np.clip(motion.colours, 0, 1)).astype(np.uint8)
    line = charts.over_time(errors, at[1] if at else 0)
    cells = charts.heat_map(errors, at or (0, 0))
    shown = None if at is None else _picture(session, step, at)
    return {
        "name": step.name,
        "particles": moving_particles(motion.positions, colours, motion.size, MOST_PARTICLES),
        "html": parts("story").step(shown, Markup(cells), Markup(line), errors.unit, _values(session, step)),
    }


def _picture(session: Session, step: Step, at: tuple[int, int]) -> dict[str, str]:
    camera = session.cameras()[at[0]]
    picture = Image.fromarray(session.picture(camera.view, at[1], step.number, side=SIDE))
    where = f"{camera.name}, frame {at[1]}{', held out' if camera.held_out else ''}"
    return {"where": where, "picture": webp_uri(picture, 82)}


def _values(session: Session, step: Step) -> list[tuple[str, str, str]]:
    """Symbol, value and interval of every number."""
    units = {setting.name: setting.unit for setting in session.settings}
    rows = []
    for name, value in step.values.items():
        unit = units.get(name, "1")
        interval = charts.between(step.intervals[name], unit) if name in step.intervals else ""
        rows.append((symbol(name), quantity(value, unit), interval))
    return rows
