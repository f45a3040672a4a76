"""One self-contained page that shows what a run found: no network, no other file."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pacnerf_lpo.evaluation.evaluate import INTERVALS_FILE, RESULTS_FILE, evaluate_run
from pacnerf_lpo.evaluation.run_directory import CONFIG_FILE, Run
from pacnerf_lpo.evaluation.tables import phases_to_result
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.quantities import symbol
from pacnerf_lpo.report import sections
from pacnerf_lpo.report.page import page
from pacnerf_lpo.report.payload import build_payload
from pacnerf_lpo.report.sections import FAIR, GOOD, judge

REPORT_FILE = "report.html"
SCRIPTS = ("base.js", "charts.js", "images.js", "space.js", "viewer.js", "curves.js")


def write_report(run_dir: str | Path) -> Path:
    """Write ``report.html`` into a run directory, and return its path; evaluates the run first where that has not been
    done. Raises UserInputError where it is no run directory, or no phase of it is finished.
    """
    run = Run(run_dir)
    results = json.loads((run.run_dir / RESULTS_FILE).read_text()) if is_evaluated(run) else evaluate_run(run_dir)
    payload = build_payload(run, results)
    page = render_page(run, results, payload)
    path = run.run_dir / REPORT_FILE
    write_atomically(path, page.encode())
    return path


def render_page(run: Run, results: Mapping[str, Any], payload: Mapping[str, Any]) -> str:
    """The page as text."""
    shown = [phase for phase in phases_to_result(results) if "images" in phase]
    moving = [phase for phase in shown if phase["phase"] != "static"]
    found = sections.found_values(results)
    return page(
        "report",
        f"{results['scene']}: {', '.join(f'{symbol(name)} = {value}' for name, value in found)}",
        ("report.css",),
        SCRIPTS,
        payload,
        results=results,
        status=run.manifest.status,
        found=found,
        verdict=judge(results, (moving or shown)[-1]),
        scale=f"silhouettes overlap in the worst frame; good: by {GOOD:.0%} or more, fair: by {FAIR:.0%} or more",
        figures=sections.key_figures(results),
        parameters=sections.parameter_table(results),
        quality=sections.quality_table(results),
        longest=max((phase["seconds"] for phase in results["phases"]), default=0) or 1,
        config=(run.run_dir / CONFIG_FILE).read_text(),
    )


def is_evaluated(run: Run) -> bool:
    """Whether the results cover every finished phase, and the intervals where there are any, as they are now."""
    results_path = run.run_dir / RESULTS_FILE
    if not results_path.is_file():
        return False
    results = json.loads(results_path.read_text())
    evaluated = [phase["stem"] for phase in results["phases"]]
    intervals = run.run_dir / INTERVALS_FILE
    paths = [*(stage.state_path for stage in run.stages), *([intervals] if intervals.is_file() else [])]
    newest = max(path.stat().st_mtime for path in paths)
    current = "doubts" in results and evaluated == [stage.stem for stage in run.stages]
    return current and results_path.stat().st_mtime >= newest
