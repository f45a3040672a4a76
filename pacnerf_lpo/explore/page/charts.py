"""Errors as small SVG pictures, for the live page and for one without a server (no NaN is ever drawn), and values,
evidence and differences as a person reads them.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pacnerf_lpo.explore.records import Errors, Setting, Step, Suggestion
from pacnerf_lpo.explore.session import Session
from pacnerf_lpo.mpm.parameters import OF
from pacnerf_lpo.quantities import figure, quantity, symbol
from pacnerf_lpo.report.page import parts
from pacnerf_lpo.report.wording import between, capitalised, listed, probability, readable

FITTED, HELD = parts("step_charts").fitted, parts("step_charts").held
"""Colours of what is fitted and of what is held out; apart for every common colour deficiency, on light and on dark."""
MOST_SIZES = 2
"""Coefficients of a suggestion that are written out: two lines each are read, more are not."""


def chart(name: str, *values: Any) -> str:
    """A macro of ``step_charts_parts.html``, as plain text: viser sends nothing else."""
    return str(getattr(parts("step_charts"), name)(*values))


def hint(text: str, how: str = "") -> str:
    """Small words on the page; text that is no ``Markup`` is escaped, ``how`` is more of their style."""
    return chart("hint", text, how)


def history(steps: Sequence[Step], current: int, unit: str, slider: str | None = None) -> str:
    """The steps below each other, the oldest first, each with its name and both errors as bars; a click goes to it
    where an element, ``slider``, chooses the step.
    """
    bars: list[tuple[str, float, float]] = []
    for step in steps:
        mark = " (unstable)" if step.trouble is not None else "" if step.resolution == "refined" else " ~"
        fitted, held = (math.nan if value is None else value for value in (step.fitted, step.held_out))
        bars.append((step.name + mark, fitted, held))
    worst = max((value for _, *both in bars for value in both if math.isfinite(value)), default=0.0) or 1.0
    return chart("history", bars, current, worst, unit, slider)


def heat_map(errors: Errors, selected: tuple[int, int], sliders: tuple[str, str] | None = None) -> str:
    """Errors by camera (rows) and frame (columns) with the place that is shown; what is held out has another colour. A
    click goes to a place where elements, ``sliders``, choose camera and frame.
    """
    rows, frames = errors.table.shape
    wide, high = 300.0 / frames, min(16.0, 150.0 / rows)
    return chart("heat_map", errors, selected, sliders, _largest(errors.table), wide, high)


def over_time(errors: Errors, selected: int) -> str:
    """Errors over time, of what is fitted and of what is held out, with the frame that is shown."""
    times, fitted, held = errors.times, errors.by_frame_fitted, errors.by_frame_held_out
    most = _largest(np.concatenate((fitted, held)))
    x = 38 + 300 * (times - times[0]) / (float(times[-1] - times[0]) or 1.0)
    pieces = []
    for out, values in ((False, fitted), (True, held)):
        points = np.column_stack((x, 110 - 100 * values / (most or 1.0)))
        pieces += [(out, points[known]) for known in np.ma.clump_unmasked(np.ma.masked_invalid(values))]
    return chart("over_time", pieces, x[min(selected, len(x) - 1)], times, most, errors.unit)


def path(times: np.ndarray, measured: np.ndarray, model: np.ndarray, held: np.ndarray, selected: int) -> str:
    """A body's centre over time, measured as dots and of the model as a line, each coordinate that was measured.

    Args:
        times: of the frames [s, (F,)].
        measured, model: [m, (F, 3)], NaN where there is none.
        held: whether a frame is held out [(F,), bool].
    """
    known = [axis for axis in range(3) if np.isfinite(measured[:, axis]).any()]
    high = 160.0 / max(len(known), 1)
    x = 44 + 292 * (times - times[0]) / (float(times[-1] - times[0]) or 1.0)
    axes = []
    for row, axis in enumerate(known):
        both = np.column_stack((measured[:, axis], model[:, axis]))
        low, most = float(np.nanmin(both)), float(np.nanmax(both))
        top, foot = row * high + 14, (row + 1) * high - 4
        y = foot - (foot - top) * (both - low) / ((most - low) or 1.0)
        dots = [dot for dot in zip(x, y[:, 0], held, range(len(x)), strict=True) if math.isfinite(dot[1])]
        line = [place for place in zip(x, y[:, 1], strict=True) if math.isfinite(place[1])]
        ends = (low, foot), (most, top)
        axes.append({"name": "xyz"[axis], "ends": ends, "middle": (top + foot) / 2, "model": line, "measured": dots})
    return chart("path", axes, times, selected)


def by_name(values: Mapping[str, float], unit: str) -> str:
    """Errors by name, such as regions of the body, as bars."""
    known = {name: value for name, value in values.items() if math.isfinite(value)}
    return chart("by_name", known, max(known.values(), default=0.0) or 1.0, unit)


def _largest(values: np.ndarray) -> float:
    return float(np.nanmax(values)) if np.isfinite(values).any() else 1.0


def short(setting: Setting) -> str:
    """``E = 97 kPa`` or, where a box next to it shows the value, ``v_x [m/s]``."""
    own, _, recording = setting.name.partition(OF)
    name = f"{symbol(own)} {recording}" if recording else symbol(own)
    if setting.logarithmic:
        return f"{name} = {quantity(setting.value, setting.unit)}"
    return name if setting.unit == "1" else f"{name} [{setting.unit}]"


def long(setting: Setting) -> str:
    """What a setting is, what it may be, and how well it is known."""
    text = f"{setting.label}, {quantity(setting.low, setting.unit)} to {quantity(setting.high, setting.unit)}"
    if setting.interval is not None:
        text += f"; 90 % interval of the last fit {between(setting.interval, setting.unit)}"
    return text + ("" if setting.fitted else "; cannot be fitted")


def evidence(found: Suggestion) -> str:
    """How much an effect would help, and how large it would be, as a part of a page."""
    odds = found.log_bayes_factor / math.log(10.0)
    sizes = [
        f"{symbol(name)} ≈ {quantity(value, found.units[name])}"
        + (f" {between(found.intervals[name], found.units[name])}" if name in found.intervals else "")
        for name, value in found.values.items()
    ]
    sure, more = "stands out" if found.stands_out else "may be chance", len(sizes) - MOST_SIZES
    return chart("evidence", odds, probability(found.p_value), sure, sizes[:MOST_SIZES], more)


def reason(found: Suggestion) -> str:
    """What a video shows of an effect, what it is confused with, and what would decide."""
    text = capitalised(found.signature)
    if found.confused_with:
        text += f"; easily confused with {listed([readable(name) for name in found.confused_with])}"
    return f"{text}. To decide: {found.separating_experiment}." if found.separating_experiment else f"{text}."


def difference_table(session: Session, before: int, after: int) -> str:
    """What differs between two steps, and their errors, as a part of a page."""
    found = session.compare(before, after)
    units = {setting.name: setting.unit for setting in session.settings}
    show = lambda name, value: "\N{EN DASH}" if value is None else quantity(value, units.get(name, "1"))  # noqa: E731
    number = lambda value: figure(math.nan if value is None else value, found.unit)  # noqa: E731
    rows = [(name, show(name, a), show(name, b)) for name, (a, b) in found.changed.items()]
    errors = ("fitted error", found.fitted), ("held-out error", found.held_out)
    rows += [(name, number(a), number(b)) for name, (a, b) in errors]
    return chart("differences", rows, before, after)
