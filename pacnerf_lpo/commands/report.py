"""``pacnerf-lpo report``: HTML pages about a run."""

from __future__ import annotations

from pathlib import Path

from pacnerf_lpo.report.diagnosis import RESULT_FILE, write_page
from pacnerf_lpo.report.html import write_report


def run(run_dir: str) -> None:
    """Write report.html into the run directory: one page that opens without network.

    Evaluates the run first where that has not been done; give the truth to evaluate to see errors in the report. Where
    the run was diagnosed, diagnosis/diagnosis.html is written again, too.

    example: pacnerf-lpo report runs/demo

    Args:
        run_dir: folder that fit wrote, or the scene with it.
    """
    pages = [write_report(run_dir)]
    folder = Path(run_dir) / "diagnosis"
    if (folder / RESULT_FILE).is_file():
        pages.append(write_page(folder))
    for path in pages:
        print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
