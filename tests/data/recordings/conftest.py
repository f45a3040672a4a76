"""Every layout written once, and the scene that ``init`` makes of it."""

import functools
import json
import os
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from filelock import FileLock

from pacnerf_lpo.__main__ import main
from tests.data.recordings.layouts import WRITERS, opencv_plates
from tests.data.recordings.studio import FPS, NAMES, World

OPTIONS = {"spring_gaus_real": ["--fps", FPS], "spring_gaus_synthetic": ["--fps", FPS], "d_nerf": ["--fps", FPS]}
"""What a layout does not say: Spring-Gaus and D-NeRF have no times for these images."""
OPTIONS["opencv_each"] = ["--fps", FPS]
OPTIONS["colmap_text"] = ["--fps", FPS]


class Made:
    """A layout's folder and world, and the scene made of it: ``entries`` of all_data.json, ``config`` of scene.yaml."""

    def __init__(self, name: str, source: Path, world: World):
        self.source, self.world, self.scene = source, world, source.with_name(f"{name}_scene")
        words = ["init", self.source, self.scene, *OPTIONS.get(name, [])]
        with FileLock(source.with_name(f"{name}_scene.lock")):
            assert self.scene.exists() or main([str(word) for word in words]) == 0
        self.entries = json.loads((self.scene / "all_data.json").read_text())
        self.text = (self.scene / "scene.yaml").read_text()
        self.config = yaml.safe_load(self.text)

    def order(self) -> list[int]:
        """The scene's numbers of the studio's cameras, by their order in the file."""
        names = [name for _, name in re.findall(r"(\d+) (\w+)[,;]", re.search("# cameras: (.*)", self.text)[1])]
        return [names.index(name) for name in sorted(names, key=_place)]

    def similarity(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Scale, rotation (3, 3) and shift (3,) from the true metric world, y up, to that of the scene."""
        poses = {entry["file_path"].split("_")[1]: np.array(entry["c2w"]) for entry in self.entries}
        found = np.stack([poses[str(view)] for view in self.order()])
        true = np.stack(World().poses())
        rotation = found[0, :, :3] @ true[0, :, :3].T
        spread_found, spread_true = (np.ptp(c, axis=0) for c in (found[..., 3], true[..., 3] @ rotation.T))
        scale = float(np.linalg.norm(spread_found) / np.linalg.norm(spread_true))
        shift = (found[..., 3] - scale * true[..., 3] @ rotation.T).mean(axis=0)
        return scale, rotation, shift


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """The folder of a layout and its world, written once when first asked for by any process of the session."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "recordings"
    folder.mkdir(exist_ok=True)

    @functools.cache
    def make(name: str) -> tuple[Path, World]:
        place, kept = folder / name, folder / f"{name}.pickle"
        with FileLock(folder / f"{name}.lock"):
            if not kept.exists():
                place.mkdir()
                kept.write_bytes(pickle.dumps({**WRITERS, opencv_plates.__name__: opencv_plates}[name](place)))
        return place, pickle.loads(kept.read_bytes())

    return make


@pytest.fixture(scope="session")
def made(written):
    """The layouts, made once each when first asked for."""
    return functools.cache(lambda name: Made(name, *written(name)))


@pytest.fixture
def write(tmp_path, written):
    """A fresh copy of a layout that a test may spoil."""
    return lambda name: Path(shutil.copytree(written(name)[0], tmp_path / "case" / name))


def _place(name: str) -> int:
    return NAMES.index(name) if name in NAMES else int(re.sub(r"\D", "", name))
