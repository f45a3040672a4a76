"""From a recording to a scene in PAC-NeRF's layout, with what its outlines say."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from tqdm import tqdm

from pacnerf_lpo.data.index import NAME
from pacnerf_lpo.data.recordings.findings import Findings, investigate
from pacnerf_lpo.data.recordings.mattes import Mattes
from pacnerf_lpo.data.recordings.recording import Camera, Recording
from pacnerf_lpo.data.recordings.tangents import Planes, outline_planes
from pacnerf_lpo.data.recordings.timeline import synchronous
from pacnerf_lpo.errors import UserInputError

LEAST_OBJECT = 20
"""Pixels of the object at the first frame, below which its matte has failed."""


@dataclass(frozen=True)
class Scene:
    """A written scene: its folder, the recording as used, times [s, (F,)], findings, and how each camera was matted."""

    folder: Path
    recording: Recording
    times: np.ndarray
    findings: Findings
    mattes: tuple[str, ...]


def convert(recording: Recording, folder: Path) -> Scene:
    """Write ``folder/all_data.json`` and ``folder/data``: undistorted, matted, in metres, y up, the ground at y = 0.

    Images smaller than the largest are extended to the right and below; what no camera pixel shows is marked by an
    occluder (frame -2). Backgrounds, given or found, are frame -1. Nothing is left behind where something is wrong.

    Raises:
        UserInputError: something in the recording is wrong or missing, or ``folder`` is in use.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserInputError(f"{folder}: is there already and not empty; choose another folder or remove it")
    recording, times = synchronous(recording)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as work:
        images = Path(work, "data")
        images.mkdir()
        mattes = [Mattes(camera) for camera in recording.cameras]
        size = max(m.size[0] for m in mattes), max(m.size[1] for m in mattes)
        views = [_write_camera(images, number, matted, size) for number, matted in enumerate(mattes)]
        findings = investigate(views, times, recording)
        Path(work, NAME).write_text(json.dumps(_entries(recording, times, findings)))
        folder.mkdir(exist_ok=True)
        for name in ("data", NAME):
            shutil.move(os.path.join(work, name), folder / name)
    return Scene(folder, recording, times, findings, tuple(m.way for m in mattes))


def _write_camera(images: Path, view: int, mattes: Mattes, size: tuple[int, int]) -> list[Planes]:
    """Write the images of one camera; returns the tangent planes of every frame."""
    camera, planes = mattes.camera, []
    for number, pixels in enumerate(
        tqdm(mattes, total=len(camera.frames), desc=f"camera {camera.name}", delay=2.0, leave=False)
    ):
        _save(images / f"m_{view}_{number}.png", pixels, size)
        planes.append(outline_planes(pixels[..., 3], camera.intrinsic, camera.pose))
        if number == 0:
            _check_object(camera, mattes.way, pixels[..., 3])
    if mattes.plate is not None:
        _save(images / f"r_{view}_-1.png", np.dstack((mattes.plate, np.ones(mattes.plate.shape[:2]))), size)
    valid = np.zeros(size[::-1], bool)
    valid[: mattes.size[1], : mattes.size[0]] = mattes.lens.valid
    if not valid.all():
        _save(images / f"r_{view}_-2.png", np.dstack((np.zeros((*valid.shape, 3)), ~valid)), size)
    return planes


def _save(path: Path, pixels: np.ndarray, size: tuple[int, int]) -> None:
    """Save colour and opacity [0..1, (H, W, 4)], extended by transparency to a size (width, height)."""
    padded = np.zeros((size[1], size[0], 4))
    padded[: pixels.shape[0], : pixels.shape[1]] = pixels
    Image.fromarray(np.round(255.0 * padded).astype(np.uint8)).save(path)


def _check_object(camera: Camera, way: str, opacity: np.ndarray) -> None:
    if np.count_nonzero(opacity > 0.5) < LEAST_OBJECT:
        raise UserInputError(
            f"{camera.frames[0].file}: no object is found in camera {camera.name} by its {way}; give masks, or an "
            "image of the empty background"
        )


def _entries(recording: Recording, times: np.ndarray, found: Findings) -> list[dict]:
    entries = []
    for view, camera in enumerate(recording.cameras):
        pose = found.rotation @ camera.pose
        pose[:, 3] = found.scale * pose[:, 3] - [0.0, found.ground.value, 0.0]
        entries += [
            {
                "file_path": f"./data/r_{view}_{frame}.png",
                "time": float(time),
                "c2w": pose.tolist(),
                "intrinsic": camera.intrinsic.tolist(),
            }
            for frame, time in enumerate(times)
        ]
    return entries
