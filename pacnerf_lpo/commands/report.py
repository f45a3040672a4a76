"""``pacnerf-lpo report``: HTML pages about a run or a scene."""

from pathlib import Path

from pacnerf_lpo.commands.init import look_at
from pacnerf_lpo.manifest import FILE_NAME
from pacnerf_lpo.report.diagnosis import RESULT, write_page
from pacnerf_lpo.report.html import write_report
from pacnerf_lpo.scene_folder import RUN, is_scene


def run(folder: str) -> None:
    """Draw the page of a run, report.html, or of a scene, scene.html: one file that opens without network.

    Evaluates a run first where that has not been done; give the truth to evaluate to see errors in the report. Where
    the run was diagnosed, diagnosis/diagnosis.html is written again, too. A scene is drawn with the values that its
    scene.yaml has now, so that a changed box, ground or contact frame is seen, and so is the run in it.

    example: pacnerf-lpo report runs/demo

    Args:
        folder: what fit wrote (a run) or init (a scene).
    """
    scene = is_scene(folder)
    run_dir = Path(folder, RUN) if scene else Path(folder)
    if not scene or (run_dir / FILE_NAME).is_file():
        _announce(write_report(run_dir))
        if (run_dir / "diagnosis" / RESULT).is_file():
            _announce(write_page(run_dir / "diagnosis"))
    if scene:
        _announce(look_at(Path(folder)))


def _announce(path: Path) -> None:
    print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)", flush=True)
