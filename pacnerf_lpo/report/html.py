"""One self-contained page that shows what a run found: no network, no other file."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from pacnerf_lpo.evaluation import tables
from pacnerf_lpo.evaluation.evaluate import RESULTS_FILE, evaluate_run
from pacnerf_lpo.evaluation.run_directory import CONFIG_FILE, Run
from pacnerf_lpo.manifest import INTERVALS_FILE, write_atomically
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.quantities import duration, published, quantity, symbol
from pacnerf_lpo.report.page import page, parts
from pacnerf_lpo.report.payload import build_payload

REPORT_FILE = "report.html"
SCRIPTS = ("base.js", "charts.js", "images.js", "space.js", "viewer.js", "curves.js")
VIEWS = {"train": "training", "test": "held out"}
GOOD, FAIR = 0.75, 0.5
"""Overlap (intersection over union) from which an outline counts as found closely, and as found: the strict threshold
of COCO (Lin et al., ECCV 2014), and that of PASCAL VOC (Everingham et al., IJCV 2010)."""


def write_report(run_dir: str | Path) -> Path:
    """Write ``report.html`` into a run directory, and return its path; evaluates the run first where that has not been
    done. Raises UserInputError where it is no run directory, or no phase of it is finished.
    """
    run = Run(run_dir)
    results = json.loads((run.run_dir / RESULTS_FILE).read_text()) if is_evaluated(run) else evaluate_run(run_dir)
    shown = [phase for phase in tables.phases_to_result(results) if "images" in phase]
    moving = [phase for phase in shown if phase["phase"] != "static"]
    found = found_values(results)
    text = page(
        "report",
        f"{results['scene']}: {', '.join(f'{symbol(name)} = {value}' for name, value, _ in found)}",
        ("report.css",),
        SCRIPTS,
        build_payload(run, results),
        results=results,
        status=run.manifest.status,
        found=found,
        verdict=judge(results, (moving or shown)[-1]),
        scale=f"silhouettes overlap in the worst frame; good: by {GOOD:.0%} or more, fair: by {FAIR:.0%} or more",
        figures=key_figures(results, moving),
        parameters=parameter_table(results),
        quality=quality_table(results),
        longest=max((phase["seconds"] for phase in results["phases"]), default=0) or 1,
        config=(run.run_dir / CONFIG_FILE).read_text(),
    )
    path = run.run_dir / REPORT_FILE
    write_atomically(path, text.encode())
    return path


def is_evaluated(run: Run) -> bool:
    """Whether the results cover every finished phase, and the intervals where there are any, as they are now."""
    results_path = run.run_dir / RESULTS_FILE
    if not results_path.is_file():
        return False
    results = json.loads(results_path.read_text())
    evaluated = [phase["stem"] for phase in results["phases"]]
    paths = [*(stage.state_path for stage in run.stages), run.run_dir / INTERVALS_FILE]
    newest = max(path.stat().st_mtime for path in paths if path.is_file())
    current = {"doubts", "density_kg_m3"} <= results.keys() and evaluated == [stage.stem for stage in run.stages]
    return current and results_path.stat().st_mtime >= newest


def found_values(results: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Names of the identified parameters, their values with units, ? where the recording does not determine it, and
    their intervals, empty where they have none; without the ground's height beside others.
    """
    if tables.value_head(results) != tables.IDENTIFIED:
        return []
    found = tables.result_phase(results)["parameters"]
    names = [name for name in results["free"] if name != GROUND_HEIGHT.name] or results["free"]
    fit = results.get("intervals", {"parameters": {}, "level": 0.0})
    intervals, level = fit["parameters"], f"{100 * fit['level']:.0f}"
    shown = []
    for name in names:
        value, unit, own = found[name]["value"], found[name]["unit"], intervals.get(name)
        between = "" if own is None else f"{level} %: {' to '.join(quantity(end, unit) for end in published(own))}"
        shown.append((name, "?" if own and not own["determined"] else quantity(value, unit), between))
    return shown


def parameter_table(results: Mapping[str, Any]) -> str:
    """Guess → identified, and the truth with the error where it is known."""
    heads = tables.start_head(results), tables.value_head(results)
    return parts("report").parameters(
        results, tables.result_phase(results), tables.describe_error, tables.remarks(results), heads
    )


def key_figures(results: Mapping[str, Any], moving: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """A handful of large numbers, each with what it is; ``moving`` are the phases with images of a motion."""
    figures = []
    if moving:
        for views, label in (("test", "PSNR, held-out views"), ("train", "PSNR, training views")):
            metrics = moving[-1]["image_metrics"][views]
            if metrics is not None:
                figures.append((_decibel(metrics["psnr"]), label))
        everything = range(len(moving[-1]["images"]["rms"]))
        share = max(explained(moving[-1], everything), 0.0)
        figures.append((f"{100 * share:.1f} %", "image explained, all views"))
    count = f"{tables.result_phase(results)['particles']:,}".replace(",", "&#8239;")
    figures.append((Markup(count), "particles"))
    return [*figures, (duration(sum(phase["seconds"] for phase in results["phases"])), "computation of the phases")]


def quality_table(results: Mapping[str, Any]) -> str:
    """PSNR, SSIM and LPIPS by phase and view set, and what each round of Algorithm 1 gave where there were several."""
    measured, notes = tables.quality_rows(results)
    rows = [
        (label, VIEWS[views], scope, _decibel(found["psnr"]), f"{found['ssim']:.3f}", tables.lpips_cell(found))
        for label, views, scope, found in measured
    ]
    return parts("report").quality(rows, notes, tables.round_rows(results))


def _decibel(psnr: float | None) -> str:
    return "exact" if psnr is None else f"{psnr:.2f} dB"


@dataclass(frozen=True)
class Verdict:
    """How well the model shows the video: the grade ``good``, ``fair`` or ``poor``, and one sentence."""

    grade: str
    headline: str


def explained(phase: Mapping[str, Any], rows: Sequence[int]) -> float:
    """Share of the image the model accounts for: 1 - sum of squared residuals / that of an empty scene."""
    residual, blank = (np.square(np.array(phase["images"][name])[list(rows)]).sum() for name in ("rms", "blank_rms"))
    return float(1 - residual / max(blank, 1e-12))


def judge(results: Mapping[str, Any], phase: Mapping[str, Any]) -> Verdict:
    """Judge the last phase of evaluated results, which has images.

    By the overlap of the silhouettes in the frame in which it is least, a mean over the views held out, or over the
    training views where none is: ``good`` from GOOD on, ``fair`` from FAIR on. A model that is farther from the video
    than an empty scene is ``poor``.
    """
    _, train, test = tables.view_rows(results)
    judged = test or train
    share = explained(phase, judged)
    overlap = np.array(phase["images"]["silhouette_iou"])[judged].mean(0)
    worst = float(overlap.min())
    grade = "poor" if share <= 0 or worst < FAIR else "fair" if worst < GOOD else "good"
    whose = f"{len(test)} views it never saw" if test else f"the {len(train)} training views (none was held out)"
    headline = (
        f"The model explains {100 * share:.1f} % of the image in {whose}; silhouettes overlap by "
        f"{100 * overlap.mean():.0f} %, in the worst frame by {100 * worst:.0f} %."
        if share > 0
        else f"In {whose} the model is farther from the video than an empty scene is."
    )
    return Verdict(grade, headline)
