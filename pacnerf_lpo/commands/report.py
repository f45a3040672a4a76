"""``pacnerf-lpo report``: HTML pages about a run or a scene."""

from __future__ import annotations

from pathlib import Path

from pacnerf_lpo.data.recordings.scene_file import NAME as SCENE_FILE
from pacnerf_lpo.report.diagnosis import RESULT_FILE, write_page
from pacnerf_lpo.report.html import write_report


def run(folder: str) -> None:
    """Draw the page of a run, report.html, or of a scene, scene.html: one file that opens without network.

    Evaluates a run first where that has not been done; give the truth to evaluate to see errors in the report. Where
    the run was diagnosed, diagnosis/diagnosis.html is written again, too. A scene is drawn with the values that its
    scene.yaml has now, so that a changed box, ground or contact frame is seen.

    example: pacnerf-lpo report runs/demo

    Args:
        folder: what fit wrote (a run) or init (a scene).
    """
    if (Path(folder) / SCENE_FILE).is_file():
        from pacnerf_lpo.commands.init import look_at

        pages = [look_at(Path(folder))]
    else:
        pages = [write_report(folder)]
        diagnosis = Path(folder) / "diagnosis"
        if (diagnosis / RESULT_FILE).is_file():
            pages.append(write_page(diagnosis))
    for path in pages:
        print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
