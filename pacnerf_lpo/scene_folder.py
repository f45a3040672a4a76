"""A scene folder: ``scene.yaml``, which ``init`` or a person wrote, and ``run``, which ``fit`` makes of it."""

from pathlib import Path

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import FILE_NAME

SCENE_FILE = "scene.yaml"
RUN = "run"


def find_scene_file(folder: Path) -> Path:
    """``scene.yaml`` of a scene folder. Raises UserInputError that says how to make one."""
    if (folder / SCENE_FILE).is_file():
        return folder / SCENE_FILE
    if (folder / FILE_NAME).is_file():
        raise UserInputError(f"{folder} is a run, not a scene; go on with it by `pacnerf-lpo fit --resume {folder}`")
    what = f"no {SCENE_FILE} there" if folder.is_dir() else "no such folder"
    source, scene = (folder, Path("scenes", folder.resolve().name)) if folder.is_dir() else ("RECORDING", folder)
    raise UserInputError(
        f"{folder}: {what}; make a scene of a recording with `pacnerf-lpo init {source} {scene}`, then "
        f"`pacnerf-lpo fit {scene}`"
    )


def is_scene(folder: str | Path) -> bool:
    """Whether a folder is a scene and no run."""
    return (Path(folder) / SCENE_FILE).is_file() and not (Path(folder) / FILE_NAME).is_file()


def run_directory(folder: str) -> str:
    """The run that a command means: the folder itself, or the run in it where it is a scene. Raises UserInputError
    where it is a scene of which nothing was fitted yet.
    """
    if not is_scene(folder):
        return folder
    if not (Path(folder) / RUN / FILE_NAME).is_file():
        raise UserInputError(f"{folder}: nothing is fitted there yet; first run `pacnerf-lpo fit {folder}`")
    return str(Path(folder) / RUN)
