"""Errors as small SVG pictures, for the live page and for one without a server: no NaN is ever drawn."""

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.report.encoding import asset

FITTED, HELD = "#2a7de1", "#e8710a"
"""Colours of what is fitted and of what is held out; apart for every common colour deficiency, on light and on dark."""
KEY = f'<b style="color:{FITTED}">fitted</b>, <b style="color:{HELD}">held out</b>'
STYLE = f"<style>{asset('step_charts.css')}</style>"
CLICK = asset("step_charts.js").strip()
"""Sets sliders of the page by their element: ``data-go="ELEMENT=VALUE ELEMENT=VALUE"``."""


@dataclass(frozen=True)
class Bar:
    """One step of a history: its name, and its fitted and held-out error, NaN where there is none."""

    name: str
    fitted: float
    held: float


@dataclass(frozen=True)
class Table:
    """Errors by row and frame.

    table: [(R, F)], NaN where there is none.
    held: whether they are held out [(R, F), bool].
    rows: names of the cameras, then of points [R].
    unit: of the errors.
    """

    table: np.ndarray
    held: np.ndarray
    rows: Sequence[str]
    unit: str


def bar(step: Step) -> Bar:
    """A step in the history."""
    name = step.name if step.trouble is None else f"{step.name} (unstable)"
    mark = "" if step.trouble is not None or step.resolution == "refined" else " ~"
    return Bar(name + mark, *(np.nan if value is None else value for value in (step.fitted, step.held_out)))


def figure(value: float, unit: str = "") -> str:
    """A number of three digits with its unit, or a dash where there is none; thousands are written out."""
    if not math.isfinite(value):
        return "\N{EN DASH}"
    return f"{value:.0f} {unit}".strip() if 1e3 <= abs(value) < 1e6 else f"{value:.3g} {unit}".strip()


def history(bars: Sequence[Bar], current: int, unit: str, slider: str | None = None) -> str:
    """The steps below each other, each with its name and both errors as bars; a click goes to it.

    Args:
        bars: steps, the oldest first.
        current: number of the one that is shown.
        unit: of the errors.
        slider: element that chooses the step; None: nothing can be clicked.
    """
    worst = max((v for bar in bars for v in (bar.fitted, bar.held) if math.isfinite(v)), default=0.0) or 1.0
    rows = []
    for number, bar in enumerate(bars):
        go = f' data-go="{slider}={number}"' if slider else ""
        strips = "".join(
            f'<i style="width:{100 * value / worst:.1f}%;background:{colour}"></i>'
            for value, colour in ((bar.fitted, FITTED), (bar.held, HELD))
            if math.isfinite(value)
        )
        now = "now" if number == current else ""
        rows.append(
            f'<tr class="{now}"{go}><td class=n>{number}</td><td>{html.escape(bar.name)}</td>'
            f'<td style="width:38%">{strips}</td><td class=n>{figure(bar.fitted)}<br>{figure(bar.held)}</td></tr>'
        )
    click, legend = f' onclick="{CLICK}"' if slider else "", f"<div class=hint>error [{unit}]: {KEY}</div>"
    return f"{STYLE}{legend}<div class=steps{click}><table><tbody>{''.join(rows)}</tbody></table></div>"


def heat_map(errors: Table, selected: tuple[int, int], sliders: tuple[str, str] | None = None) -> str:
    """Errors by camera (rows) and frame (columns); what is held out has another colour, a click goes there.

    Args:
        errors: what is drawn.
        selected: row and frame that are shown.
        sliders: elements that choose the camera and the frame; None: nothing can be clicked.
    """
    values, unit = errors.table, errors.unit
    most = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
    wide, high, left = 300.0 / values.shape[1], min(16.0, 150.0 / values.shape[0]), 44.0
    cells = []
    for v, f in np.ndindex(values.shape):
        value, x, y = float(values[v, f]), left + f * wide, v * high
        known = math.isfinite(value)
        colour = (
            f'fill="{HELD if errors.held[v, f] else FITTED}" fill-opacity="{0.06 + 0.94 * value / (most or 1):.3f}"'
        )
        paint = colour if known else 'fill-opacity="0"'
        go = f' data-go="{sliders[0]}={v} {sliders[1]}={f}"' if sliders else ""
        said = f"{errors.rows[v]}, frame {f}: {figure(value, unit)}{', held out' if errors.held[v, f] else ''}"
        now = ' stroke="currentColor" stroke-width="2"' if (v, f) == selected else ""
        cells.append(
            f'<rect class=cell x="{x:.1f}" y="{y:.1f}" width="{wide - 1:.1f}" height="{high - 1:.1f}"{go}{now} '
            f"{paint}><title>{html.escape(said)}</title></rect>"
        )
    names = "".join(
        f'<text class=soft x="0" y="{(v + 0.75) * high:.1f}" font-size="{min(11, high):.0f}">{html.escape(name)}</text>'
        for v, name in enumerate(errors.rows)
    )
    foot = len(errors.rows) * high + 13
    below = f'<text class=soft x="{left}" y="{foot:.0f}">frame 0</text>'
    below += f'<text class=soft x="{left + 300}" y="{foot:.0f}" text-anchor="end">{values.shape[1] - 1}</text>'
    click = f' onclick="{CLICK}"' if sliders else ""
    return (
        f'{STYLE}<svg class=pl viewBox="0 0 346 {foot + 4:.0f}"{click}>{names}{"".join(cells)}{below}</svg>'
        f"<div class=hint>{KEY}; darkest "
        f"{figure(most, unit)}</div>"
    )


def over_time(times: np.ndarray, fitted: np.ndarray, held: np.ndarray, selected: int, unit: str) -> str:
    """Errors over time [s], of what is fitted and of what is held out, with the frame that is shown.

    Args:
        times: of the frames [s, (F,)].
        fitted, held: errors [(F,)], NaN where there is none.
        selected: frame that is shown.
        unit: of the errors.
    """
    every = np.concatenate((fitted, held))
    most = float(np.nanmax(every)) if np.isfinite(every).any() else 1.0
    span = float(times[-1] - times[0]) or 1.0
    x = 38 + 300 * (times - times[0]) / span
    parts = [f'<line class=line x1="38" x2="338" y1="{y}" y2="{y}"/>' for y in (10, 60, 110)]
    parts += [
        f'<text class=soft x="34" y="{y + 4}" text-anchor="end">{figure(value)}</text>'
        for y, value in ((10, most), (60, most / 2), (110, 0.0))
    ]
    for values, colour, dash in ((fitted, FITTED, ""), (held, HELD, ' stroke-dasharray="4 3"')):
        y = 110 - 100 * values / (most or 1.0)
        known = np.isfinite(values)
        breaks = np.flatnonzero(np.diff(known.astype(int))) + 1
        for piece in np.split(np.arange(len(values)), breaks):
            if known[piece[0]]:
                line = " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in piece)
                parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
                parts += [f'<circle cx="{x[i]:.1f}" cy="{y[i]:.1f}" r="2" fill="{colour}"/>' for i in piece]
    now = x[min(selected, len(x) - 1)]
    parts.append(f'<line x1="{now:.1f}" x2="{now:.1f}" y1="6" y2="110" stroke="currentColor" opacity=".55"/>')
    parts.append(f'<text class=soft x="38" y="124">{times[0]:.2f} s</text>')
    parts.append(f'<text class=soft x="338" y="124" text-anchor="end">{times[-1]:.2f} s</text>')
    return f'{STYLE}<svg class=pl viewBox="0 0 346 130"><title>error over time [{unit}]</title>{"".join(parts)}</svg>'


def path(times: np.ndarray, measured: np.ndarray, model: np.ndarray, held: np.ndarray, selected: int) -> str:
    """A body's centre over time, measured as dots and of the model as a line, each coordinate that was measured.

    Args:
        times: of the frames [s, (F,)].
        measured, model: [m, (F, 3)], NaN where there is none.
        held: whether a frame is held out [(F,), bool].
        selected: frame that is shown.
    """
    known = [(axis, "xyz"[axis]) for axis in range(3) if np.isfinite(measured[:, axis]).any()]
    high = 160.0 / max(len(known), 1)
    x = 44 + 292 * (times - times[0]) / (float(times[-1] - times[0]) or 1.0)
    parts = []
    for row, (axis, name) in enumerate(known):
        both = np.concatenate((measured[:, axis], model[:, axis]))
        low, most = float(np.nanmin(both)), float(np.nanmax(both))
        top, foot = row * high + 14, (row + 1) * high - 4
        ends = (low, foot), (most, top)
        lines = [(foot - (foot - top) * (one[:, axis] - low) / ((most - low) or 1.0)) for one in (measured, model)]
        parts += [f'<text class=soft x="40" y="{y + 3:.1f}" text-anchor="end">{figure(v)}</text>' for v, y in ends]
        parts.append(f'<text x="0" y="{(top + foot) / 2:.1f}">{name} [m]</text>')
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, lines[1], strict=True) if math.isfinite(b))
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="currentColor" opacity=".55" stroke-width="1.5"/>'
        )
        parts += [
            f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{4 if f == selected else 2}" fill="{HELD if out else FITTED}"/>'
            for f, (a, b, out) in enumerate(zip(x, lines[0], held, strict=True))
            if math.isfinite(b)
        ]
    for at, when, anchor in ((44, times[0], "start"), (336, times[-1], "end")):
        parts.append(f'<text class=soft x="{at}" y="174" text-anchor="{anchor}">{when:.2f} s</text>')
    legend = f"<div class=hint>measured: {KEY}; line: model</div>"
    return f'{STYLE}<svg class=pl viewBox="0 0 346 178">{"".join(parts)}</svg>{legend}'


def by_name(values: Mapping[str, float], unit: str) -> str:
    """Errors by name, such as regions of the body, as bars."""
    known = {name: value for name, value in values.items() if math.isfinite(value)}
    most = max(known.values(), default=0.0) or 1.0
    rows = "".join(
        f'<text x="0" y="{18 * k + 12}">{html.escape(name)}</text>'
        f'<rect x="110" y="{18 * k + 3}" width="{160 * value / most:.1f}" height="11" rx="2" fill="{FITTED}"/>'
        f'<text class=soft x="{116 + 160 * value / most:.1f}" y="{18 * k + 12}">{figure(value, unit)}</text>'
        for k, (name, value) in enumerate(known.items())
    )
    return f'{STYLE}<svg class=pl viewBox="0 0 346 {18 * len(known) + 4}">{rows}</svg>'
