"""``pacnerf-lpo report``: one HTML page about a run."""

from __future__ import annotations

from pacnerf_lpo.report.html import write_report


def run(run_dir: str) -> None:
    """Write report.html into the run directory: one page that opens without network.

    Evaluates the run first where that has not been done; give the truth to evaluate to see errors in the report.

    example: pacnerf-lpo report runs/demo

    Args:
        run_dir: folder that fit wrote.
    """
    path = write_report(run_dir)
    print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
