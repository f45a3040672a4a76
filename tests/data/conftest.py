"""A small ball seen by four cameras in four frames, 32 x 32 pixels, and a copy of it that a test may spoil."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pacnerf_lpo.data.synthetic import Drawing, hemisphere_rig, write_scene
from pacnerf_lpo.data.video_module import VideoModule

SIZE, VIEWS, FRAMES = 32, 4, 4
CENTRE, RADIUS = np.array([0.0, 0.42, 0.0]), 0.2
BOX = {"box_lower": [-0.25, 0.15, -0.25], "box_upper": [0.25, 0.7, 0.25]}


def ball(spacing: float = 0.04) -> np.ndarray:
    axis = np.arange(-RADIUS, RADIUS + spacing / 2, spacing)
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    return points[np.linalg.norm(points, axis=-1) <= RADIUS] + CENTRE


def colours(points: np.ndarray) -> np.ndarray:
    return np.where(points[:, :1] > 0.0, [0.9, 0.4, 0.5], [0.4, 0.9, 0.4])


@pytest.fixture(scope="session")
def pristine(tmp_path_factory) -> Path:
    points = ball()
    falling = np.stack([points - [0.0, 0.02 * frame, 0.0] for frame in range(FRAMES)])
    rig = hemisphere_rig(VIEWS, SIZE)
    return write_scene(tmp_path_factory.mktemp("scenes") / "ball", falling, colours(points), rig, Drawing(SIZE, 0.04))


@pytest.fixture
def scene(pristine: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(pristine, tmp_path / "ball"))


@pytest.fixture
def edit(scene: Path) -> Callable[[Callable[[dict[tuple[int, int], dict[str, Any]]], None]], None]:
    """Change ``all_data.json`` through a dictionary by (view, frame)."""

    def apply(change):
        path = scene / "all_data.json"
        entries = json.loads(path.read_text())
        by_shot = {tuple(int(n) for n in entry["file_path"][9:-4].split("_")): entry for entry in entries}
        change(by_shot)
        path.write_text(json.dumps(list(by_shot.values())))

    return apply


def load(root: Path, **options) -> VideoModule:
    module = VideoModule(str(root), **{**BOX, **options})
    module.prepare()
    return module
