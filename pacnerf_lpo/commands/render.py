"""``pacnerf-lpo render``: a run seen from where no camera stood."""

from pathlib import Path

from PIL import Image

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.prediction import StateRenderer, simulate
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.export.film import SLOW_MOTION, write_film
from pacnerf_lpo.report.turntable import Orbit, turntable

SECONDS = 6
FILM_RATE = 24


def run(
    run_dir: str,
    output: str | None = None,
    phase: str | None = None,
    frame: int | None = None,
    azimuth: float = 30.0,
    elevation: float = 25.0,
    size: int = 320,
) -> None:
    """Film a full turn around the object while it moves, or take one picture from any side.

    example: pacnerf-lpo render runs/demo --output turn.mp4

    example: pacnerf-lpo render runs/demo --output above.png --frame 5 --elevation 80

    Args:
        run_dir: folder that fit wrote, or the scene with it.
        output: an .mp4 (a turn) or .png (one picture); videos/turntable.mp4 of the run when not given.
        phase: stem of a finished phase, such as 02_r1_physics; the last one when not given.
        frame: index of the frame to hold; when not given, a film plays all frames and a picture shows the first.
        azimuth: of the picture, or of the film's first one [deg].
        elevation: of the camera over the horizon [deg].
        size: width and height [pixels].
    """
    opened = Run(run_dir)
    path = Path(output) if output else opened.run_dir / "videos" / "turntable.mp4"
    if path.suffix not in (".mp4", ".png"):
        raise UserInputError(f"--output {path}: give a name that ends in .mp4 (a turn) or .png (one picture)")
    if size < 16 or size % 2:
        raise UserInputError(f"--size {size}: give an even number of at least 16 pixels")
    stage = opened.stage(phase)
    positions = simulate(opened, stage)
    if frame is not None and not 0 <= frame < len(positions):
        raise UserInputError(f"--frame {frame}: this phase has frames 0 to {len(positions) - 1}")
    orbit = Orbit.around(positions, elevation, size)
    path.parent.mkdir(parents=True, exist_ok=True)
    renderer = StateRenderer(stage.state)
    if path.suffix == ".png":
        Image.fromarray(next(turntable(renderer, positions, orbit, [azimuth], [frame or 0]))).save(path)
    else:
        pictures = SECONDS * FILM_RATE
        azimuths = [azimuth + 360 * k / pictures for k in range(pictures)]
        moments = [frame if frame is not None else k // SLOW_MOTION % len(positions) for k in range(pictures)]
        write_film(path, turntable(renderer, positions, orbit, azimuths, moments), FILM_RATE)
    print(path)
