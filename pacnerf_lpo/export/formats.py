"""The formats that a run is exported to, and what can be said against a choice before any long work."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import Stage
from pacnerf_lpo.export.files import check_output
from pacnerf_lpo.export.film import write_mp4
from pacnerf_lpo.export.motion import Subject
from pacnerf_lpo.export.points import write_csv, write_ply, write_usd, write_vtu
from pacnerf_lpo.export.surface import write_glb, write_obj


@dataclass(frozen=True)
class Format:
    """A kind of export.

    write: writes a subject to a path.
    files: pattern of the names of the files in its folder; None where it is one file.
    endings: of its file, the usual one first.
    moving: it is a motion, and has no meaning for the shape at frame 0 alone.
    points: it holds particles, of which some can be left out.
    needs: modules of the extra ``export``, with the names under which they are installed.
    """

    write: Callable[[Subject, Path], None]
    files: str | None = None
    endings: tuple[str, ...] = ()
    moving: bool = True
    points: bool = True
    needs: tuple[tuple[str, str], ...] = ()


SURFACE = (("skimage", "scikit-image"), ("trimesh", "trimesh"))
FORMATS = {
    "ply": Format(write_ply, files=r"frame_\d+\.ply", moving=False),
    "vtu": Format(write_vtu, files=r"frame_\d+\.vtu|motion\.pvd", needs=(("meshio", "meshio"),)),
    "usd": Format(write_usd, endings=(".usd", ".usda", ".usdc"), needs=(("pxr", "usd-core"),)),
    "obj": Format(write_obj, files=r"frame_\d+\.obj", moving=False, points=False, needs=SURFACE),
    "glb": Format(write_glb, files=r"frame_\d+\.glb", moving=False, points=False, needs=SURFACE),
    "csv": Format(write_csv, endings=(".csv",)),
    "mp4": Format(write_mp4, endings=(".mp4",), points=False),
}


def chosen_format(name: str | None, output: Path | None) -> str:
    """The name of the format: as given, or by the ending of the output; raises UserInputError where they disagree."""
    if name is not None and name not in FORMATS:
        raise UserInputError(f"--format {name}: known are {', '.join(FORMATS)}")
    ending = output.suffix.lower() if output else ""
    by_ending = next((key for key, kind in FORMATS.items() if ending in kind.endings), None)
    chosen = name or by_ending
    if chosen is None:
        folders = ", ".join(key for key, kind in FORMATS.items() if kind.files)
        single = ", ".join(end for kind in FORMATS.values() for end in kind.endings)
        raise UserInputError(
            f"--output {output}: its ending does not name a format; give a file that ends in {single}, "
            f"or a folder and --format {folders}"
        )
    kind = FORMATS[chosen]
    if output and name and kind.endings and by_ending != name:
        raise UserInputError(f"--format {name} --output {output}: give a name that ends in {' or '.join(kind.endings)}")
    if output and name and kind.files and (by_ending or ending.removeprefix(".") in FORMATS):
        raise UserInputError(f"--format {name} --output {output}: one file per frame is written; give a folder")
    return chosen


def check_installed(name: str) -> None:
    """Raise UserInputError where a library that the format needs is missing."""
    missing = [package for module, package in FORMATS[name].needs if find_spec(module) is None]
    if missing:
        raise UserInputError(f"--format {name} needs {' and '.join(missing)}: pip install 'pacnerf-lpo[export]'")


def check_motion(name: str, stage: Stage) -> None:
    """Raise UserInputError where the format is a motion and the phase knows none."""
    if FORMATS[name].moving and not stage.moves:
        still = ", ".join(key for key, kind in FORMATS.items() if not kind.moving)
        raise UserInputError(
            f"{stage.run_dir}: phase {stage.stem} has seen frame 0 only, so there is no motion for --format {name}; "
            f"go on with `fit --resume {stage.run_dir}`, or export the shape as {still}"
        )


def target(name: str, stage: Stage, output: Path | None) -> Path:
    """The file or folder to write; raises UserInputError where it would replace something else."""
    kind = FORMATS[name]
    path = output or stage.run_dir / "exports" / (f"{stage.stem}_{name}" if kind.files else f"{stage.stem}.{name}")
    if output is None and name == "ply":
        path = stage.run_dir / "particles" / stage.stem
    check_output(path, kind.files)
    return path
