"""``pacnerf-lpo export``: a run for other programs."""

from pathlib import Path

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.export.film import export_video
from pacnerf_lpo.export.formats import FORMATS, check_installed, check_motion, chosen_format, target
from pacnerf_lpo.export.motion import Subject


def run(
    run_dir: str,
    format: str | None = None,
    output: str | None = None,
    phase: str | None = None,
    views: list[int] | None = None,
    particles: int | None = None,
) -> None:
    """Write the motion of a run for other programs, in metres and seconds with y up.

    Formats with one file per frame: ply (particles), vtu (particles for ParaView, listed by motion.pvd), obj and glb
    (coloured surface). Formats with one file: usd (moving particles with a material), csv (trajectories), mp4 (the
    model seen by a camera, four times slower than life). Without format and output: ply, and for each view a film
    (measured | model | signed residual) in RUN/videos.

    example: pacnerf-lpo export runs/demo --output motion.usd

    example: pacnerf-lpo export runs/demo --format vtu --output paraview

    example: pacnerf-lpo export runs/demo --output tracks.csv --particles 100

    Args:
        run_dir: folder that fit wrote, or the scene with it.
        format: ply, vtu, usd, obj, glb, csv or mp4; as the output ends when not given.
        output: a folder for one file per frame, a file otherwise; in RUN/exports (ply: RUN/particles) when not given.
        phase: stem of a finished phase, such as 02_r1_physics; the last one when not given.
        views: the numbers the files carry; films: the first training and the first test view when not given, [] for
            none; mp4: one, the first training view when not given.
        particles: at most so many, drawn at random; all when not given. Not for surfaces and films.
    """
    given = Path(output) if output else None
    films = format is None and given is None
    name = "ply" if films else chosen_format(format, given)
    check_options(name, films, views, particles)
    check_installed(name)
    opened = Run(run_dir)
    stage = opened.stage(phase)
    check_motion(name, stage)
    path = target(name, stage, given)
    data = opened.data
    shown = [data.video.view_ids[s[0]] for s in (data.train, data.test) if s] if views is None else views
    indices = [opened.view_index(view) for view in shown]
    FORMATS[name].write(Subject(opened, stage, particles, indices[0] if name == "mp4" else 0), path)
    print(path)
    for index in indices if films else []:
        print(export_video(opened, stage, data.video.view_ids[index]))


def check_options(name: str, films: bool, views: list[int] | None, particles: int | None) -> None:
    """Raise UserInputError for options that mean nothing in this format."""
    if views is not None and not films and name != "mp4":
        raise UserInputError(f"--views {views}: --format {name} is not seen by a camera; leave --views out")
    if views is not None and name == "mp4" and len(views) != 1:
        raise UserInputError(f"--views {views}: --format mp4 shows one view, such as --views [0]")
    if particles is not None and not FORMATS[name].points:
        raise UserInputError(f"--particles {particles}: --format {name} needs all particles; leave --particles out")
    if particles is not None and particles < 1:
        raise UserInputError(f"--particles {particles}: give at least 1")
