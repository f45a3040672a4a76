"""What the report's templates show of the results: what was recovered, image quality, key figures."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from pacnerf_lpo.evaluation.tables import before_sentence, describe_error, phases_to_result, result_phase, round_rows
from pacnerf_lpo.quantities import duration, quantity
from pacnerf_lpo.report.page import parts
from pacnerf_lpo.report.verdict import explained


def found_values(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names of the identified parameters, and their values with units."""
    found = result_phase(results)["parameters"]
    return [(name, quantity(found[name]["value"], found[name]["unit"])) for name in results["free"]]


def parameter_table(results: Mapping[str, Any]) -> str:
    """Guess → identified, and the truth with the error where it is known."""
    return parts("report").parameters(results, result_phase(results), describe_error, before_sentence(results))


def key_figures(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """A handful of large numbers, each with what it is."""
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
    count = f"{result_phase(results)['particles']:,}".replace(",", "&#8239;")
    figures.append((Markup(count), "particles"))
    return [*figures, (duration(sum(phase["seconds"] for phase in results["phases"])), "computation")]


def quality_table(results: Mapping[str, Any]) -> str:
    """PSNR, SSIM and LPIPS by phase and view set, and what each round of Algorithm 1 gave where there were several."""
    rows: list[tuple[str, ...]] = []
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
            rows.append((phase["label"], title, scope, _decibel(metrics["psnr"]), f"{metrics['ssim']:.3f}", last))
    return parts("report").quality(rows, notes, round_rows(results))


def _decibel(psnr: float | None) -> str:
    return "exact" if psnr is None else f"{psnr:.2f} dB"
