"""``pacnerf-lpo fit SCENE SCENE ... --out FOLDER``: one material from several recordings of one object."""

from collections.abc import Sequence
from pathlib import Path

from pacnerf_lpo.commands import diagnose, fit
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.presets import take_option
from pacnerf_lpo.scene_folder import find_scene_file


def run(scenes: Sequence[str], words: Sequence[str]) -> int:
    """Reconstruct every scene, a folder with ``scene.yaml``, by itself, then identify what they share from all of them;
    returns the exit status. The words are ``--out FOLDER`` and options of ``fit``, which hold for every scene. Raises
    UserInputError where there is no ``--out``, for a folder that is no scene, one given twice, and options of a single
    run.

    What is finished is not done again. The page and the numbers are those of the first step of a diagnosis, which goes
    on from there with ``diagnose SCENE SCENE ... --out FOLDER``.
    """
    out, rest = take_option(words, "--out")
    if out is None:
        raise UserInputError("fit: several scenes are a study; give a folder for what they share with --out")
    for option in ("--outer_loop.run_dir", "--outer_loop.rounds"):
        if any(word.split("=")[0] == option for word in rest):
            raise UserInputError(f"fit: {option} is for one scene; every scene of a study has its run in itself")
    folders = [Path(scene).resolve() for scene in scenes]
    for scene, folder in zip(scenes, folders, strict=True):
        find_scene_file(Path(scene))
        if folders.count(folder) > 1:
            raise UserInputError(f"fit: {scene} is given twice; a study is of different recordings")
    for scene in scenes:
        print(f"{scene}: body and velocity", flush=True)
        fit.run([scene, *rest, "--outer_loop.rounds", "0"])
    diagnose.run(list(scenes), until="compare", out=out)
    return 0
