"""The parts of the report that are plain HTML: what was recovered, tables, times."""

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any

from pacnerf_lpo.evaluation.tables import describe_error, phases_to_result, result_phase, round_rows
from pacnerf_lpo.quantities import duration, quantity, symbol
from pacnerf_lpo.report.diagnosis_markup import row, table
from pacnerf_lpo.report.verdict import explained


def found_sentence(results: Mapping[str, Any]) -> str:
    """``E = 103 kPa, ν = 0.296``: the identified parameters."""
    found = result_phase(results)["parameters"]
    return ", ".join(
        f"{symbol(name)} = {quantity(found[name]['value'], found[name]['unit'])}" for name in results["free"]
    )


def found_heading(results: Mapping[str, Any]) -> str:
    """The identified parameters as the page's heading."""
    found = result_phase(results)["parameters"]
    parts = [
        f'<span class="found"><i>{_symbol_html(name)}</i>&thinsp;=&thinsp;'
        f"{html.escape(quantity(found[name]['value'], found[name]['unit']))}</span>"
        for name in results["free"]
    ]
    return " ".join(parts) or "every parameter was known"


def doubt_list(results: Mapping[str, Any]) -> str:
    """Every doubt with its likely cause and its remedy; empty where there is none."""
    items = "".join(
        f"<li><b>{html.escape(doubt['where'])}</b>: {html.escape(doubt['what'])}."
        f"<small>Likely cause: {html.escape(doubt['cause'])}. Remedy: {html.escape(doubt['remedy'])}.</small></li>"
        for doubt in results["doubts"]
    )
    count = len(results["doubts"])
    head = "One reason to doubt this result" if count == 1 else f"{count} reasons to doubt this result"
    return f"<div class=doubts><p>{head}</p><ul>{items}</ul></div>" if items else ""


def parameter_table(results: Mapping[str, Any]) -> str:
    """Guess → identified, and the truth with the error where it is known."""
    last, guess = result_phase(results), results["guess"]
    errors = last.get("truth_errors")
    intervals = results.get("intervals")
    head = ["parameter", "guess", "", "identified"]
    head += [] if intervals is None else [f"{100 * intervals['level']:.0f} % interval"]
    head += [] if errors is None else ["true", "error"]
    rows = []
    for name, found in last["parameters"].items():
        known = name not in results["free"]
        if known and found["value"] == 0:
            continue
        cells = [
            f'<td class="name"><i>{_symbol_html(name)}</i> <span>{html.escape(found["label"])}</span></td>',
            f"<td>{_cell(guess[name])}</td><td class=arrow>{'known' if known else '→'}</td>",
            f"<td class=strong>{_cell(found)}</td>",
        ]
        if intervals is not None:
            cells.append(f"<td>{_interval(intervals['parameters'].get(name), found['unit'])}</td>")
        if errors is not None:
            cells.append(_truth_cells(errors.get(name), found["unit"]))
        rows.append(f"<tr>{''.join(cells)}</tr>")
    rows.append(_velocity_row(last, intervals is not None, errors is not None))
    return table(head, rows)


def key_figures(results: Mapping[str, Any]) -> str:
    """A handful of large numbers."""
    shown = [phase for phase in phases_to_result(results) if "images" in phase]
    moving = [phase for phase in shown if phase["phase"] != "static"]
    figures = []
    if moving:
        for views, label in (("test", "PSNR, held-out views"), ("train", "PSNR, training views")):
            metrics = moving[-1]["image_metrics"][views]
            if metrics is not None:
                figures.append((_decibel(metrics["psnr"]), label))
        everything = range(len(moving[-1]["images"]["rms"]))
        share = max(explained(moving[-1], everything), 0.0)
        figures.append((f"{100 * share:.1f} %", "image explained, all views"))
    figures.append((f"{result_phase(results)['particles']:,}".replace(",", "&#8239;"), "particles"))
    figures.append((duration(sum(phase["seconds"] for phase in results["phases"])), "computation"))
    return "".join(f"<div class=figure><b>{value}</b><span>{label}</span></div>" for value, label in figures)


def quality_table(results: Mapping[str, Any]) -> str:
    """PSNR, SSIM and LPIPS by phase and view set."""
    rows: list[str] = []
    notes: dict[str, None] = {}
    for phase in results["phases"]:
        if "error" in phase:
            notes[f"{phase['label']}: {phase['error']}"] = None
            continue
        for views, title in (("train", "training"), ("test", "held out")):
            metrics = phase["image_metrics"][views]
            scope = "all frames" if metrics is not None else "frame 0"
            metrics = metrics or phase["first_frame_metrics"][views]
            if metrics is None:
                continue
            lpips = metrics["lpips"]
            if isinstance(lpips, str):
                notes[f"LPIPS: {lpips}"] = None
            last = "n/a" if isinstance(lpips, str) else f"{lpips:.3f}"
            rows.append(row((phase["label"], title, scope, _decibel(metrics["psnr"]), f"{metrics['ssim']:.3f}", last)))
    foot = "".join(f"<p class=note>{html.escape(note)}</p>" for note in notes)
    return table(("phase", "views", "frames", "PSNR", "SSIM", "LPIPS"), rows, "quality") + foot


def round_table(results: Mapping[str, Any]) -> str:
    """What each round of Algorithm 1 gave; nothing where there was one round."""
    rows = round_rows(results)
    if not rows:
        return ""
    head, *body = ([html.escape(cell) for cell in cells] for cells in rows)
    return f"<h2>Rounds</h2>{table(head, [row(cells) for cells in body], 'quality')}"


def law_table(results: Mapping[str, Any]) -> str:
    """How the laws competed, best first; nothing where the material was given."""
    found = results.get("laws")
    if found is None:
        return ""
    rows = []
    for trial in found["laws"]:
        chosen = trial["law"] == found["chosen"]
        name = f"{trial['family']} <span>{html.escape(trial['law'])}{', used' if chosen else ''}</span>"
        if trial["left_out"]:
            cells = f"<td colspan=4 class=muted>left out: {html.escape(trial['left_out'])}</td>"
        else:
            held, odds = trial["held_out"], trial["log_odds"] / math.log(10.0)
            cells = f"<td class={'strong' if chosen else 'muted'}>{_percent(trial['probability'])}</td>"
            cells += f"<td>{'' if odds == 0 else f'{odds:.1f}'.replace('-', chr(0x2212))}</td><td>{held:.2f}</td>"
            cells += f"<td>{_of_law(trial)}</td>"
        rows.append(f"<tr><td class=name>{name}</td>{cells}</tr>")
    said = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in found["sentences"])
    head = ("law", "probability", "log10 of the odds", "held-out error / noise", "found on a coarse body")
    return f"<section><h2>Which law</h2>{said}{table(head, rows, 'quality')}</section>"


def _of_law(trial: Mapping[str, Any]) -> str:
    """``E = 103 kPa, ν = 0.296``: the parameters of a law."""
    shown = ((name, quantity(p["value"], p["unit"])) for name, p in trial["parameters"].items())
    return ", ".join(f"<i>{_symbol_html(name)}</i> = {html.escape(value)}" for name, value in shown)


def _percent(share: float) -> str:
    return "&gt; 99.9 %" if share > 0.999 else "&lt; 0.1 %" if share < 0.001 else f"{100 * share:.1f} %"


def time_bars(results: Mapping[str, Any]) -> str:
    """Computation time of each phase as bars."""
    longest = max((phase["seconds"] for phase in results["phases"]), default=0) or 1
    return "".join(
        f"<div class=bar><span>{phase['label']}</span>"
        f"<div><i style='width:{100 * phase['seconds'] / longest:.1f}%'></i></div>"
        f"<b>{duration(phase['seconds'])}</b><small>{phase['steps']} steps</small></div>"
        for phase in results["phases"]
    )


def state_line(status: str, results: Mapping[str, Any]) -> str:
    """Says so when the run did not finish."""
    if status == "finished":
        return ""
    return (
        f"<p class=warning>This run is {status}: what follows is the state after {results['phases'][-1]['label']}.</p>"
    )


def _truth_cells(error: Mapping[str, Any] | None, unit: str) -> str:
    if error is None:
        return "<td class=muted>unknown</td><td></td>"
    return f"<td>{html.escape(quantity(error['true'], unit))}</td><td>{describe_error(error)}</td>"


def _interval(found: Mapping[str, Any] | None, unit: str) -> str:
    if found is None:
        return ""
    ends = " to ".join(quantity(found[end], unit) for end in ("low", "high"))
    return html.escape(ends if found["determined"] else f"not determined ({ends})")


def _velocity_row(phase: Mapping[str, Any], with_intervals: bool, with_truth: bool) -> str:
    row = (
        "<tr><td class=name><i>v<sub>0</sub></i> <span>initial velocity [m/s]</span></td><td></td><td></td>"
        f"<td class=strong>{_vector(phase['velocity'])}</td>"
    )
    row += "<td></td>" if with_intervals else ""
    if with_truth:
        error = phase.get("velocity_error")
        row += f"<td>{_vector(error['true'])}</td><td>{error['error']:.3f}</td>" if error else "<td></td><td></td>"
    return f"{row}</tr>"


def _vector(components: Sequence[float]) -> str:
    return "({:.2f}, {:.2f}, {:.2f})".format(*(round(value, 2) + 0.0 for value in components)).replace(
        "-", "\N{MINUS SIGN}"
    )


def _symbol_html(name: str) -> str:
    base, _, index = symbol(name).partition("_")
    return f"{html.escape(base)}<sub>{html.escape(index)}</sub>" if index else html.escape(base)


def _cell(value: Mapping[str, Any]) -> str:
    return html.escape(quantity(value["value"], value["unit"]))


def _decibel(psnr: float | None) -> str:
    return "exact" if psnr is None else f"{psnr:.2f} dB"
