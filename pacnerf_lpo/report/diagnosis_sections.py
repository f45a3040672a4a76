"""The parts of a diagnosis' page that are plain HTML: verdict, ranking, confounding, refits, parameters."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pacnerf_lpo.quantities import quantity, symbol
from pacnerf_lpo.report import diagnosis_words as words
from pacnerf_lpo.report.diagnosis_words import Result

RANKED, CONFOUNDED = 15, 12
WIDTH_90 = 1.645
"""Half width of a 90 % interval in standard errors."""
LAMPS = ("poor", "fair", "good")
text = html.escape


def traffic_light(light: words.Light) -> str:
    """Three lamps, one of them lit, with a caption for those who cannot tell the colours."""
    lamps = "".join(f'<i class="{lamp}{" lit" if lamp == light.colour else ""}"></i>' for lamp in LAMPS)
    return (
        f'<div class="light" role="img" aria-label="{text(light.caption)}">'
        f"<div>{lamps}</div><span>{text(light.caption)}</span></div>"
    )


def distance_bars(result: Result) -> str:
    """The model's distance before and after beside that of its own numerical error."""
    found = words.misfit(result)
    bars = [("the model", found.before, "before"), ("its own error alone", found.floor, "floor")]
    if found.after is not None:
        bars.append(("the model with the effect", found.after, "after"))
    most = max(value for _, value, _ in bars)
    return "".join(
        f'<div class="distance"><span>{label}</span>'
        f'<div><i class="{kind}" style="width:{_share(value, most)}"></i></div>'
        f"<b>{value:.2f} {result['unit']}</b></div>"
        for label, value, kind in bars
    )


def first_screen(result: Result) -> str:
    """What was compared, how far off, what is missing, what changes: four cards."""
    cards = [
        ("What was compared", f"<p>{text(words.compared(result))}</p>"),
        ("How far off is the model?", distance_bars(result) + f"<p>{text(words.distance(result))}</p>"),
        ("What is missing?", f"<p>{text(words.missing(result))}</p>{_chances(result)}"),
        ("What changes when it is added?", f"<p>{text(words.changes(result))}</p>{_moves(result)}"),
    ]
    return "".join(f'<div class="card"><h3>{title}</h3>{body}</div>' for title, body in cards)


def ranking(screen: Mapping[str, Any] | None) -> str:
    """Bars of |z| with the threshold; cameras in another colour; letters for what cannot be told apart."""
    if screen is None:
        return '<p class="muted">No effect has been tried yet.</p>'
    shown = screen["candidates"][:RANKED]
    most = 1.08 * max([abs(c["z"]) for c in shown] + [screen["threshold"]])
    letters = group_letters(screen["groups"], [c["name"] for c in shown])
    rows = []
    for candidate in shown:
        size = abs(candidate["z"])
        low, high = max(size - WIDTH_90, 0.0), min(size + WIDTH_90, most)
        letter = letters.get(candidate["name"])
        tag = f'<em title="cannot be told apart from the others marked {letter}">{letter}</em>' if letter else ""
        kind = "camera" if candidate["camera"] else "physics"
        passed = " passed" if size >= screen["threshold"] else ""
        rows.append(
            f'<div class="rank {kind}{passed}" title="{text(candidate["signature"])}">'
            f"<span>{text(candidate['readable'])}{tag}</span>"
            f'<div><i style="width:{_share(size, most)}"></i>'
            f'<u style="left:{_share(low, most)};width:{_share(high - low, most)}"></u>'
            f'<s style="left:{_share(screen["threshold"], most)}"></s></div><b>{size:.1f}</b></div>'
        )
    note = (
        '<p class="legend"><span><span class="key physics"></span>physics</span>'
        '<span><span class="key camera"></span>camera fault</span>'
        "<span>thin line: 90 % interval</span>"
        f"<span>dashed: {screen['threshold']:.1f}, which accidents pass in 1 of {1 / screen['false_alarms']:.0f} "
        "recordings</span></p>"
    )
    return f'<div class="ranking">{"".join(rows)}</div>{note}{_group_note(screen, letters)}'


def group_letters(groups: Sequence[Sequence[str]], names: Sequence[str]) -> dict[str, str]:
    """A letter for every group of inseparable effects of which two or more are among the names."""
    found: dict[str, str] = {}
    letters = iter("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    for group in sorted(groups, key=lambda g: min((names.index(n) for n in g if n in names), default=len(names))):
        members = [name for name in group if name in names]
        if len(members) > 1 and (letter := next(letters, None)):
            found.update(dict.fromkeys(members, letter))
    return found


def confounding(screen: Mapping[str, Any] | None) -> str:
    """How alike the traces of the best candidates are: a table of shades."""
    if screen is None:
        return ""
    shown = screen["candidates"][:CONFOUNDED]
    head = "".join(f"<th>{k + 1}</th>" for k in range(len(shown)))
    rows = []
    for i, candidate in enumerate(shown):
        cells = "".join(_likeness(screen["correlations"][i][j], i == j) for j in range(len(shown)))
        rows.append(f"<tr><th><span>{i + 1}</span> {text(candidate['readable'])}</th>{cells}</tr>")
    return f'<table class="matrix"><thead><tr><th></th>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'


def refit_table(done: Mapping[str, Any], unit: str) -> str:
    """Every effect that was fitted: removed share, and each criterion with a tick or a cross."""
    if not done["refits"]:
        return '<p class="muted">No effect was fitted.</p>'
    order = sorted(done["refits"], key=lambda again: (again["name"] != done["accepted"], -again["removed"]))
    return "".join(_refit(again, again["name"] == done["accepted"], unit) for again in order)


def points_table(result: Result) -> str:
    """Errors of tracked points and clouds before and after [mm]; nothing where there were none."""
    names, stages = result.get("points") or [], result["stages"]
    if not names:
        return ""
    shown = stages[:1] + stages[1:][-1:]
    titles = ["root mean square error [mm]", *("before", "after")[: len(shown)], "the model's own"]
    head = "".join(f"<th>{title}</th>" for title in titles)
    rows = []
    for row, name in enumerate(names):
        values = [*(stage["by_point"][row] for stage in shown), shown[0]["point_floor"][row]]
        cells = "".join(f"<td>{'-' if value is None else f'{value:.1f}'}</td>" for value in values)
        rows.append(f'<tr><td class="name">{text(str(name))}</td>{cells}</tr>')
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return f'<section><h2>Tracked points and clouds</h2><div class="card scroll">{table}</div></section>'


def parameter_table(result: Result) -> str:
    """Values before and after with their 90 % intervals, as numbers and drawn."""
    before = {p["name"]: p for p in result["rounds"][0]["parameters"]}
    after = _parameters_after(result)
    marks = [f'<th><span class="key {kind}"></span>{kind}</th>' for kind in ("before", "after")]
    columns = "".join(marks) if after else "<th>value</th>"
    rows = []
    for name in dict.fromkeys([*before, *after]):
        old, new = before.get(name), after.get(name)
        known = old or after[name]
        second = f"<td>{_interval_text(new, known['unit'])}</td>" if after else ""
        rows.append(
            f'<tr><td class="name"><i>{_symbol_html(name)}</i> <span>{text(known["label"])}</span></td>'
            f"<td>{_interval_text(old, known['unit'])}</td>"
            f"{second}"
            f'<td class="plot">{interval_plot(old, new)}</td></tr>'
        )
    return (
        f"<table><thead><tr><th>parameter</th>{columns}<th>90 % intervals</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


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
    """How strong every effect may still be without being seen; of the last screening."""
    screen = result["rounds"][-1]["screen"]
    if screen is None:
        return ""
    rows = []
    for candidate in sorted(screen["candidates"], key=lambda c: (c["camera"], c["readable"])):
        if candidate["discrete"]:
            continue
        for coefficient, (low, high) in zip(candidate["coefficients"], candidate["interval"], strict=False):
            null, unit = coefficient["null"], coefficient["unit"]
            rows.append(
                f"<tr><td>{text(candidate['readable'])}</td><td>{text(coefficient['label'])}</td>"
                f"<td>{_quantity(null + low, unit)}</td><td>{_quantity(null + high, unit)}</td></tr>"
            )
    head = "<tr><th>effect</th><th>coefficient</th><th>at least</th><th>at most</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>" if rows else ""


def bullets(sentences: Sequence[str]) -> str:
    """A list; nothing where there is none."""
    return f"<ul>{''.join(f'<li>{text(s[0].upper() + s[1:])}</li>' for s in sentences)}</ul>" if sentences else ""


def _chances(result: Result) -> str:
    found = []
    for done in result["rounds"]:
        for again in done["refits"]:
            if again["name"] == done["accepted"]:
                p = next((c["p_value"] for c in done["screen"]["candidates"] if c["name"] == again["name"]), 1.0)
                p = min(p, done["omnibus"]["p_value"]) if p >= 0.05 else p
                found.append(f"<p class=muted>{text(again['readable'].capitalize())}: {words.chance(p)}.</p>")
    return "".join(found)


def _moves(result: Result) -> str:
    before = {p["name"]: p for p in result["rounds"][0]["parameters"]}
    after = _parameters_after(result)
    rows = [
        f"<tr><td>{text(known['label'])}</td><td>{_value(before.get(name), known['unit'])}</td><td class=arrow>→</td>"
        f"<td class=strong>{_value(new, known['unit'])}</td></tr>"
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


def _refit(again: Mapping[str, Any], accepted: bool, unit: str) -> str:
    reasons = "".join(
        f'<li class="{"good" if passed else "poor"}"><b>{"✓" if passed else "✗"}</b> {text(sentence)}</li>'
        for passed, sentence in again["reasons"]
    )
    outcome = "added" if accepted else "would do, too" if again["accepted"] else "rejected"
    removed, kind = again["removed"], " accepted" if accepted else ""
    share = f"removes {removed:.0%}" if removed > 0 else "removes nothing"
    return (
        f'<div class="refit{kind}"><h4>{text(again["readable"])} <small>{outcome}</small></h4>'
        f'<div class="track"><i style="width:{_share(removed, 1.0)}"></i></div>'
        f"<p>{share} of the error in the data kept aside. Left beyond the model's own error: "
        f"{again['error']['held']:.2f} {unit} there, {again['error']['fitted']:.2f} {unit} in the fitted data.</p>"
        f"<ul>{reasons}</ul></div>"
    )


def _group_note(screen: Mapping[str, Any], letters: Mapping[str, str]) -> str:
    by_letter: dict[str, list[str]] = {}
    readable = {candidate["name"]: candidate["readable"] for candidate in screen["candidates"]}
    for name, letter in letters.items():
        by_letter.setdefault(letter, []).append(readable[name])
    return "".join(
        f'<p class="note ranked"><em>{letter}</em> {text(words.either(names))}: this recording cannot tell which</p>'
        for letter, names in by_letter.items()
    )


def _likeness(value: float, same: bool) -> str:
    size = abs(value)
    shade = "" if same else f' style="--share:{size:.2f}"'
    mark = "" if same else f"{round(100 * size)}" if size >= 0.5 else ""
    kind = "same" if same else "alike" if size >= 0.9 else ""
    return f'<td class="{kind}"{shade} title="{value:+.2f}">{mark}</td>'


def _interval_text(found: Mapping[str, Any] | None, unit: str) -> str:
    if found is None:
        return "<span class=muted>none</span>"
    ends = f"{_quantity(found['low'], unit)} … {_quantity(found['high'], unit)}"
    sure = "" if found["identifiable"] else "<small>not determined</small>"
    return f"<b>{_quantity(found['value'], unit)}</b><small>{ends}</small>{sure}"


def _value(found: Mapping[str, Any] | None, unit: str) -> str:
    return "none" if found is None else _quantity(found["value"], unit)


def _quantity(value: float, unit: str) -> str:
    return text(quantity(value, unit)) if math.isfinite(value) else "∞" if value > 0 else "&minus;∞"


def _symbol_html(name: str) -> str:
    """The usual symbol; nothing where a parameter has only a name."""
    head, _, tail = symbol(name).partition("_")
    if len(head) > 1 or len(tail) > 2:
        return ""
    return f"{text(head)}<sub>{text(tail)}</sub>" if tail else text(head)


def _share(value: float, most: float) -> str:
    return f"{100 * min(max(value / max(most, 1e-12), 0.0), 1.0):.1f}%"
