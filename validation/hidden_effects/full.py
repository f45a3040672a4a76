"""The slow path: the scene as a video in PAC-NeRF's layout, reconstructed by ``fit`` before it is diagnosed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import yaml

from pacnerf_lpo.commands.synthesize import patches
from pacnerf_lpo.data import skin
from pacnerf_lpo.data.synthetic import Drawing, Rig, write_scene
from pacnerf_lpo.diagnosis.store import FOLDER
from pacnerf_lpo.errors import RunError
from pacnerf_lpo.manifest import FILE_NAME
from pacnerf_lpo.report.diagnosis_result import RESULT
from validation.hidden_effects.film import Film
from validation.hidden_effects.setting import Setting

CONFIG, PICTURES, RUN, LOG = "user.yaml", "video", "run", "log.txt"
CONFIGS = Path(__file__).parents[2] / "configs"
IMAGE_SCALE = 0.5
BASE = ("fit.yaml", "scenes/torus.yaml", "baselines/3v_dagger.yaml", "cpu.yaml", "cpu_coarse.yaml")
CAMERA_NOISE = 0.01
MARGIN = 0.08
"""Of the box that the object is said to be in at frame 0, around it [m]."""
SEEN = 0.02
"""A body touches the ground when its image is so near to it [m], plus half a cell by which a grid lifts it."""


def write(folder: Path, setting: Setting, trained: Sequence[int], recorded: Film, random: np.random.Generator) -> None:
    """Write the video, and what a user would say of it: the views to train with, the box, the material's first guess,
    the frame of contact.
    """
    path = recorded.path.double().numpy()
    rig = Rig(np.array(setting.cameras), np.array(setting.intrinsics))
    apart = recorded.model.body.spacing / 2 / skin.FINER
    seed = int(random.integers(1 << 31))
    drawn = setting.filled(apart, torch.Generator().manual_seed(seed))
    drawing = Drawing(setting.image_size, skin.COVER * apart, skin.OUTLINE * apart, CAMERA_NOISE, seed)
    write_scene(folder / PICTURES, skin.carried(drawn.double().numpy(), path), patches(drawn), rig, drawing)
    hit = first_touch(path[..., 1].min(1), recorded.model.body.spacing)
    lower, upper = path[0].min(0) - MARGIN, path[0].max(0) + MARGIN
    material = {"class_path": setting.material, "init_args": setting.law.guess}
    told = {
        "data": {
            "frames": setting.frames,
            "image_scale": IMAGE_SCALE,
            "train_views": None if len(setting.cameras) == len(trained) else list(trained),
            "box_lower": [float(f"{x:.3f}") for x in np.maximum(lower, (-9.0, 0.0, -9.0))],
            "box_upper": [float(f"{x:.3f}") for x in upper],
        },
        "physics": {"material": material},
        "phases": {"velocity": {"init_args": {"hit_frame": hit}}},
        "outer_loop": {"rounds": 0},
    }
    (folder / CONFIG).write_text(yaml.safe_dump(told, sort_keys=False))


def first_touch(heights: np.ndarray, spacing: float) -> int:
    """First frame in which a body touches the ground, the last one where it never does.

    Args:
        heights: of its lowest particle [m, (F,)]
        spacing: of the nodes [m]
    """
    touches = heights < SEEN + spacing / 2
    return int(np.argmax(touches)) if touches.any() else len(heights) - 1


def as_diagnosed(setting: Setting) -> Setting:
    """The setting with images of the size that the run of a video compares."""
    scale = np.array([IMAGE_SCALE, IMAGE_SCALE, 1.0])[:, None]
    intrinsics = (np.array(setting.intrinsics) * scale).tolist()
    return replace(setting, image_size=round(IMAGE_SCALE * setting.image_size), intrinsics=intrinsics)


def reconstructed_from(scene: Path) -> str | None:
    """The views that the shape of a scene is reconstructed from, in words; None where the shape is known."""
    if not (scene / CONFIG).is_file():
        return None
    views = yaml.safe_load((scene / CONFIG).read_text())["data"]["train_views"]
    return "all views" if views is None else f"{len(views)} views"


def reconstruct_and_diagnose(scene: Path) -> None:
    """``fit`` and ``diagnose``, each going on where it stopped; the result lies where the fast path's does.

    Raises:
        RunError: one of them failed.
    """
    run = scene / RUN
    if (run / FILE_NAME).is_file():
        fit = ["--resume", str(run)]
    else:
        configs = [*(CONFIGS / name for name in BASE), scene / CONFIG, CONFIGS / "corrections/none.yaml"]
        fit = [word for path in configs for word in ("--config", str(path))]
        fit += ["--data.root", str(scene / PICTURES), "--outer_loop.run_dir", str(run)]
    for words in (["fit", *fit], ["diagnose", str(run)]):
        with open(scene / LOG, "ab") as log:
            ended = subprocess.run([sys.executable, "-m", "pacnerf_lpo", *words], stdout=log, stderr=log)
        if ended.returncode:
            raise RunError(f"{words[0]} ended with status {ended.returncode}, see {scene / LOG}")
    (scene / FOLDER).mkdir(exist_ok=True)
    shutil.copy2(run / FOLDER / RESULT, scene / FOLDER / RESULT)
