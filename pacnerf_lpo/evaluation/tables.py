"""The results of a run as Markdown tables."""

from collections.abc import Mapping, Sequence
from typing import Any

from pacnerf_lpo.quantities import published, quantity

ALL_FRAMES, FRAME_0 = "all frames", "frame 0"
IDENTIFIED = "identified"


def markdown_table(results: Mapping[str, Any]) -> str:
    """The results as Markdown: image metrics by phase and view set, then parameters, then what is missing and why."""
    quality = [["phase", "views", "PSNR [dB]", "SSIM", "LPIPS"]]
    rows, notes = quality_rows(results)
    for label, views, scope, metrics in rows:
        where = views if scope == ALL_FRAMES else f"{views}, {scope}"
        quality.append([label, where, _psnr_cell(metrics), f"{metrics['ssim']:.3f}", lpips_cell(metrics)])
    tables = [_markdown(rows) for rows in (quality, _parameter_rows(results), round_rows(results))]
    return "\n\n".join(filter(None, [*tables[:2], *remarks(results), tables[2], "\n".join(notes)]))


def _markdown(rows: Sequence[Sequence[str]]) -> str:
    """A table whose first row is its head; empty where there is no row."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    rule = ["|---" * len(row) + "|" for row in rows[:1]]
    return "\n".join(lines[:1] + rule + lines[1:])


def quality_rows(results: Mapping[str, Any]) -> tuple[list[tuple[str, str, str, Mapping[str, Any]]], list[str]]:
    """Image metrics by phase and view set: the phase's label, ``train`` or ``test``, of which frames they are, and the
    metrics; and what is missing and why, each once.
    """
    rows, notes = [], []
    for phase in results["phases"]:
        if "error" in phase:
            notes.append(f"{phase['label']}: {phase['error']}")
            continue
        for views in ("train", "test"):
            scope = FRAME_0 if phase["image_metrics"][views] is None else ALL_FRAMES
            metrics = phase["image_metrics"][views] or phase["first_frame_metrics"][views]
            if metrics is not None:
                rows.append((phase["label"], views, scope, metrics))
                notes += [f"LPIPS: {metrics['lpips']}"] if isinstance(metrics["lpips"], str) else []
    return rows, list(dict.fromkeys(notes))


def view_rows(results: Mapping[str, Any]) -> tuple[list[int], list[int], list[int]]:
    """File ids of the views in the order of the rows of image metrics; the rows of training and of test views."""
    sets = results["views"]
    order = sorted({*sets["train"], *sets["test"]})
    return order, [order.index(view) for view in sets["train"]], [order.index(view) for view in sets["test"]]


def phases_to_result(results: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """All phases up to the one whose result counts: the last one, unless an earlier round was chosen."""
    stems = [phase["stem"] for phase in results["phases"]]
    return results["phases"][: stems.index(results["result"]) + 1]


def result_phase(results: Mapping[str, Any]) -> Mapping[str, Any]:
    """The phase whose result counts."""
    return phases_to_result(results)[-1]


def value_head(results: Mapping[str, Any]) -> str:
    """What a column of the parameters' values is called: where no phase has identified any, they are the guess."""
    identified = results["free"] and {"law", "physics"} & {phase["phase"] for phase in phases_to_result(results)}
    return IDENTIFIED if identified else "value (physics not identified)"


def round_rows(results: Mapping[str, Any]) -> list[list[str]]:
    """A head and one row for each round: image quality, parameters with their errors, held-out error, the choice; of
    its correction, or of its identification where none follows. Empty where there is no round but the first.
    """
    ends = {phase["round"]: phase for phase in results["phases"] if phase["round"] > 0 and phase["phase"] != "refit"}
    rounds = list(ends.values())
    if len(rounds) < 2:
        return []
    names = [f"{name} [{rounds[0]['parameters'][name]['unit']}]" for name in results["free"]]
    rows = [["round", "PSNR, training views [dB]", "PSNR, test views [dB]", *names, "held-out error"]]
    for phase in rounds:
        mark = " (chosen)" if phase["round"] == results["chosen_round"] else ""
        quality = [_psnr_cell((phase.get("image_metrics") or {}).get(views)) for views in ("train", "test")]
        values, errors = phase["parameters"], phase.get("truth_errors", {})
        misses = {name: f" ({describe_error(error)})" for name, error in errors.items()}
        found = [f"{values[name]['value']:.4g}{misses.get(name, '')}" for name in results["free"]]
        held_out = f"{phase['held_out_error']:.4g}" if "held_out_error" in phase else ""
        rows.append([f"{phase['round']}{mark}", *quality, *found, held_out])
    return rows if results["chosen_round"] is not None else [row[:-1] for row in rows]


def _psnr_cell(metrics: Mapping[str, Any] | None) -> str:
    if metrics is None:
        return "n/a"
    return "inf" if metrics["psnr"] is None else f"{metrics['psnr']:.2f}"


def lpips_cell(metrics: Mapping[str, Any]) -> str:
    """``0.123``, or ``n/a`` where it could not be had."""
    return "n/a" if isinstance(metrics["lpips"], str) else f"{metrics['lpips']:.3f}"


def _parameter_rows(results: Mapping[str, Any]) -> list[list[str]]:
    last, guess = result_phase(results), results["guess"]
    errors, intervals = last.get("truth_errors"), results.get("intervals")
    head = ["parameter", start_head(results), value_head(results)]
    head += [] if intervals is None else [f"{100 * intervals['level']:.0f} % interval"]
    head += [] if errors is None else ["true", "error"]
    rows = [head]
    for name, found in last["parameters"].items():
        if name not in results["free"] and found["value"] == 0:
            continue
        unit = "" if found["unit"] == "1" else f" {found['unit']}"
        known = "" if name in results["free"] else " (known)"
        cells = [f"{name}{known}", f"{guess[name]['value']:.4g}{unit}", f"{found['value']:.4g}{unit}"]
        if intervals is not None:
            cells.append(interval_cell(results, name, unit))
        if errors is not None:
            error = errors.get(name)
            cells += [f"{error['true']:.4g}{unit}", describe_error(error)] if error else ["unknown", ""]
        rows.append(cells)
    return rows


def remarks(results: Mapping[str, Any]) -> list[str]:
    """What belongs to the identified values: the density that they are for, what the phase had where another fit took
    its place, and what images and outlines would give, each by itself.
    """
    if value_head(results) != IDENTIFIED:
        return []
    last = result_phase(results)
    units, found = {name: last["parameters"][name]["unit"] for name in results["free"]}, []
    stresses = {name: unit for name, unit in units.items() if unit.startswith("Pa")}

    def listed(values: Mapping[str, float], names: Mapping[str, str]) -> str:
        return ", ".join(f"{name} = {quantity(values[name], unit)}" for name, unit in names.items())

    if stresses:
        density = quantity(results["density_kg_m3"], "kg/m^3", 4)
        found.append(f"Moduli, stresses and viscosities are for a density of {density}, and are proportional to it.")
    if fit := results.get("intervals"):
        has = listed({name: one["value"] for name, one in fit["parameters"].items()}, units)
        had = [phase["before"] for phase in phases_to_result(results) if "before" in phase]
        last_fit = [phase["stem"] for phase in phases_to_result(results) if phase["phase"] == "physics"][-1:]
        own = bool(had) and last_fit == [fit["phase"]]
        found.append(
            f"{'Values and intervals' if own else 'Intervals'} are those of a weighted fit of material and motion to "
            "the outlines: data count by their errors, and the shape may be wrong."
            + ("" if own else f" It has {has}.")
            + (f" Before it the phase had {listed(had[-1], units)}." if had else "")
        )
    effects = ", ".join(results["effects"]) or "none"
    found.append(
        f"The model has gravity, a ground of the kind {results['ground']}, and as effects: {effects}. What is missing "
        "in it, pacnerf-lpo diagnose tells."
    )
    if stresses and (methods := last.get("methods")):
        found.append(
            f"Images and outlines against each other: {listed(methods['images'], stresses)} by images alone, "
            f"{listed(methods['outlines'], stresses)} by outlines alone. Only their difference counts: a body of "
            f"{methods['particles']} particles shifts both."
        )
    return found


def start_head(results: Mapping[str, Any]) -> str:
    """What the column is called from which the identification started."""
    return "law comparison" if results.get("laws") else "guess"


def interval_cell(results: Mapping[str, Any], name: str, unit: str) -> str:
    """``[97000, 104000] Pa``, or that the recording does not say; empty for what was known."""
    found = results["intervals"]["parameters"].get(name)
    if found is None:
        return ""
    low, high = published(found)
    ends = f"[{low:.4g}, {high:.4g}]{unit}"
    return ends if found["determined"] else f"{ends}, not determined"


def describe_error(error: Mapping[str, Any]) -> str:
    """``0.031 in log10``, ``0.020`` or ``0.035 rad``."""
    suffix = {"log10": " in log10", "plain": "", "radians": " rad"}[error["measure"]]
    return f"{error['error']:.3f}{suffix}"
