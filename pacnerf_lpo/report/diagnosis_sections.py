"""The parts of a diagnosis' page that are plain HTML: verdict, parameters, points, bounds, effort."""

import math
from collections.abc import Mapping
from typing import Any

from pacnerf_lpo.quantities import duration
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.diagnosis_markup import (
    interval_text,
    paragraphs,
    share,
    shown,
    symbol_html,
    table,
    text,
    value_text,
)
from pacnerf_lpo.report.diagnosis_words import Result

LAMPS = ("poor", "fair", "good")


def traffic_light(light: words.Light) -> str:
    """Three lamps, one of them lit, with a caption for those who cannot distinguish the colours."""
    lamps = "".join(f'<i class="{lamp}{" lit" if lamp == light.colour else ""}"></i>' for lamp in LAMPS)
    return (
        f'<div class="light" role="img" aria-label="{text(light.caption)}">'
        f"<div>{lamps}</div><span>{text(light.caption)}</span></div>"
    )


def distance_bars(result: Result) -> str:
    """The model's distance before and after, and that of its own numerical error."""
    found = words.distance_of(result)
    bars = [("the model", found.before, "before"), ("its own error alone", found.floor, "floor")]
    if found.after is not None:
        bars.append(("the model with the effect", found.after, "after"))
    most = max(value for _, value, _ in bars)
    return "".join(
        f'<div class="distance"><span>{label}</span>'
        f'<div><i class="{kind}" style="width:{share(value, most)}"></i></div>'
        f"<b>{value:.2f} {result['unit']}</b></div>"
        for label, value, kind in bars
    )


def first_screen(result: Result) -> str:
    """What was compared, how far off, what is missing, what changes: four cards."""
    cards = [
        ("What was compared", f"<p>{text(words.compared(result))}</p>"),
        ("How far off is the model?", distance_bars(result) + f"<p>{text(words.distance(result))}</p>"),
        ("What is missing?", paragraphs(words.missing(result))),
        ("What changes when it is added?", f"<p>{text(words.changes(result))}</p>{_moves(result)}"),
    ]
    return "".join(f'<div class="card"><h3>{title}</h3>{body}</div>' for title, body in cards)


def points_table(result: Result) -> str:
    """Errors of tracked points and clouds before and after [mm]; nothing where there were none."""
    names, stages = result.get("points") or [], result["stages"]
    if not names:
        return ""
    ends = stages[:1] + stages[1:][-1:]
    titles = ["root mean square error [mm]", *("before", "after")[: len(ends)], "the model's own"]
    rows = []
    for row, name in enumerate(names):
        values = [*(stage["by_point"][row] for stage in ends), ends[0]["point_floor"][row]]
        cells = "".join(f"<td>{'-' if value is None else f'{value:.1f}'}</td>" for value in values)
        rows.append(f'<tr><td class="name">{text(str(name))}</td>{cells}</tr>')
    body = table(titles, rows)
    return f'<section><h2>Tracked points and clouds</h2><div class="card scroll">{body}</div></section>'


def parameter_table(result: Result) -> str:
    """Values before and after with their 90 % intervals, as numbers and drawn."""
    before = {p["name"]: p for p in result["rounds"][0]["parameters"]}
    after = _parameters_after(result)
    marks = [f'<span class="key {kind}"></span>{kind}' for kind in ("before", "after")] if after else ["value"]
    rows = []
    for name in dict.fromkeys([*before, *after]):
        old, new = before.get(name), after.get(name)
        known = old or after[name]
        second = f"<td>{interval_text(new, known['unit'])}</td>" if after else ""
        rows.append(
            f'<tr><td class="name"><i>{symbol_html(name)}</i> <span>{text(known["label"])}</span></td>'
            f"<td>{interval_text(old, known['unit'])}</td>"
            f"{second}"
            f'<td class="plot">{interval_plot(old, new)}</td></tr>'
        )
    head = ["parameter", *marks, "90 % intervals"]
    return table(head, rows)


def interval_plot(before: Mapping[str, Any] | None, after: Mapping[str, Any] | None) -> str:
    """Two points with their intervals on a common axis, an SVG of 220 x 34."""
    lines = [(p, y, kind) for p, y, kind in ((before, 11, "before"), (after, 24, "after")) if p is not None]
    ends = [p[key] for p, _, _ in lines for key in ("value", "low", "high") if math.isfinite(p[key])]
    values = [p["value"] for p, _, _ in lines]
    reach = max(abs(v) for v in values)
    low, high = max(min(ends), min(values) - 2 * reach), min(max(ends), max(values) + 2 * reach)
    span = max(high - low, 1e-9 * max(reach, 1e-9))

    def place(value: float) -> float:
        return 6 + 208 * min(max((value - low) / span, 0.0), 1.0)

    marks = "".join(
        f'<line class="{kind}" x1="{place(p["low"]):.1f}" x2="{place(p["high"]):.1f}" y1="{y}" y2="{y}"/>'
        f'<circle class="{kind}" cx="{place(p["value"]):.1f}" cy="{y}" r="4"/>'
        for p, y, kind in lines
    )
    return f'<svg class="interval" viewBox="0 0 220 34" role="img">{marks}</svg>'


def bounds_table(result: Result) -> str:
    """How large every effect that is not in the last model can be; of its screening."""
    screen = result["rounds"][-1]["screen"]
    if screen is None:
        return ""
    rows = []
    for candidate in sorted(screen["candidates"], key=lambda c: (c["camera"], c["readable"])):
        if candidate["discrete"]:
            continue
        found = zip(candidate["coefficients"], candidate["coefficient"], candidate["interval"], strict=False)
        for coefficient, value, (low, high) in found:
            null, unit = coefficient["null"], coefficient["unit"]
            ends = _possible(value, low, high) if candidate["one_sided"] else (low, high)
            cells = "".join(f"<td>{shown(null + end, unit)}</td>" for end in ends)
            rows.append(f"<tr><td>{text(candidate['readable'])}</td><td>{text(coefficient['label'])}</td>{cells}</tr>")
    return table(["effect", "coefficient", "at least", "at most"], rows) if rows else ""


def _possible(value: float, low: float, high: float) -> tuple[float, float]:
    """The part of an interval on the side of the null on which a one-sided coefficient is; its zero has a sign, too."""
    return (max(low, 0.0), max(high, 0.0)) if math.copysign(1.0, value) > 0 else (min(low, 0.0), min(high, 0.0))


STEPS = {"compare": "compare (fit, null replicates)", "screen": "screen (one probe each)", "refit": "refit"}


def effort_table(result: Result) -> str:
    """Seconds and simulations of every step of every round."""
    rows, seconds, simulations = [], 0.0, 0
    for number, done in enumerate(result["rounds"], 1):
        for step, spent in done["effort"].items():
            seconds, simulations = seconds + spent["seconds"], simulations + int(spent["simulations"])
            cells = f"<td>{duration(spent['seconds'])}</td><td>{spent['simulations']:.0f}</td>"
            rows.append(f"<tr><td>{number}</td><td>{text(STEPS.get(step, step))}</td>{cells}</tr>")
    rows.append(f'<tr class="strong"><td></td><td>all</td><td>{duration(seconds)}</td><td>{simulations}</td></tr>')
    return table(["round", "step", "time", "simulations"], rows)


def _moves(result: Result) -> str:
    before = {p["name"]: p for p in result["rounds"][0]["parameters"]}
    after = _parameters_after(result)
    rows = [
        f"<tr><td>{text(known['label'])}</td><td>{value_text(before.get(name), known['unit'])}</td>"
        f"<td class=arrow>→</td><td class=strong>{value_text(new, known['unit'])}</td></tr>"
        for name, new in after.items()
        if (known := before.get(name) or new) and not name.startswith("v_") and name != "ground_height"
    ]
    return f"<table>{''.join(rows)}</table>" if rows else ""


def _parameters_after(result: Result) -> dict[str, Mapping[str, Any]]:
    """Intervals of the last stage with labels and units; none where nothing was added."""
    if len(result["stages"]) == 1:
        return {}
    last = result["rounds"][-1]
    if last["accepted"] is None:
        return {p["name"]: p for p in last["parameters"]}
    return next(again["values"] for again in last["refits"] if again["name"] == last["accepted"])
