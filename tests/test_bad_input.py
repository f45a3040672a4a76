"""A new user's mistakes, tried on the shipped scene with the real command: one line, before anything is written."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.assets import demo_scene
from pacnerf_lpo.outer_loop import OuterLoop

pytestmark = pytest.mark.slow

CONFIGS = Path(__file__).resolve().parents[1] / "configs"


@pytest.fixture
def complain(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, small_threads: None):
    """Runs the demo with these options and returns the one line it prints."""

    def begin(loop: OuterLoop, correction: bool) -> None:
        raise AssertionError("the run began")

    monkeypatch.setattr(OuterLoop, "start", begin)

    def run(*options: str) -> str:
        configs = [word for name in ("fit", "demo") for word in ("--config", str(CONFIGS / f"{name}.yaml"))]
        status = main(["fit", *configs, "--outer_loop.run_dir", str(tmp_path / "run"), *options])
        lines = [line for line in capsys.readouterr().err.split("\n") if line.strip()]
        lines = [line.split("\r")[-1] for line in lines]  # on a slow machine a bar shows the images being read
        assert status == 2 and len(lines) == 1, lines
        assert len(lines[0]) < 400 and not (tmp_path / "run").exists()
        return lines[0]

    return run


def change_index(root: Path, change: Callable[[dict[str, dict]], None]) -> None:
    """Change ``all_data.json`` through a dictionary by file name."""
    path = root / "all_data.json"
    entries = {Path(entry["file_path"]).stem: entry for entry in json.loads(path.read_text())}
    change(entries)
    path.write_text(json.dumps(list(entries.values())))


def misspell_pose(root: Path) -> None:
    change_index(root, lambda shots: shots["r_4_6"].update(c2W=shots["r_4_6"].pop("c2w")))


def repeat_camera(root: Path) -> None:
    def copy(shots: dict[str, dict]) -> None:
        for name, shot in shots.items():
            if name.startswith("r_1_"):
                shot.update(c2w=shots["r_0_0"]["c2w"], intrinsic=shots["r_0_0"]["intrinsic"])

    change_index(root, copy)


def remove_image(root: Path) -> None:
    (root / "data" / "m_4_6.png").unlink()


def cut_image(root: Path) -> None:
    path = root / "data" / "m_4_6.png"
    path.write_bytes(path.read_bytes()[:300])


def whiten(root: Path) -> None:
    for path in (root / "data").glob("m_*.png"):
        Image.new("RGB", (128, 128), "white").save(path)


def empty(root: Path) -> None:
    shutil.rmtree(root)
    root.mkdir()


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (misspell_pose, "rename 'c2W' to 'c2w'"),
        (repeat_camera, "the same camera as view 0"),
        (remove_image, "m_4_6.png: the image is missing"),
        (cut_image, "m_4_6.png: the image cannot be read"),
        (whiten, "view 0 never shows the object"),
        (empty, "is empty"),
        (shutil.rmtree, "there is no folder"),
    ],
)
def test_spoilt_scene(complain, tmp_path: Path, spoil: Callable[[Path], None], expected: str):
    root = tmp_path / "bird"
    shutil.copytree(demo_scene(), root)
    spoil(root)
    line = complain("--data.root", str(root))
    assert str(root) in line and expected in line


ADAM = "--phases.physics.method=PaperAdam"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            ["--data.box_lower=[5,5,5]", "--data.box_upper=[6,6,6]"],
            "no training view sees the box",
        ),
        (["--data.train_views=[0,0,4]"], "view 0 is named twice"),
        (
            ["--physics.material.nu=0.6"],
            "nu = 0.6 is not a possible Poisson's ratio; give a value above -0.45 and below 0.45",
        ),
        (["--physics.material.known=[e]"], "NeoHookean.known: 'e' is no parameter of it; choose from E, nu"),
        (["--physics.effects+=LinearDrg"], "did you mean LinearDrag?"),
        (["--physics.effects+=LinearDrag", "--physics.effects+=LinearDrag"], "two parameters 'drag'"),
        (["--phases.physics.hit_frame=14"], "hit_frame = 14 but"),
        ([ADAM, '--phases.physics.method.learning_rates={"mu": 0.1}'], "mu, which is not identified here"),
        (["--physics.material.known=[E,nu]", "--physics.fit_ground_height=false"], "nothing to identify"),
        (["--phases.physics.method.iterations=0"], "main_iterations = 0; give at least 0 and 1"),
        (["--phases.physics.method.pool=0"], "pool = 0"),
        (["--phases.static.base_spacing=-0.1"], "phases.static.base_spacing = -0.1 m must be positive"),
        (["--phases.static.rays_per_step=0"], "phases.static.rays_per_step = 0"),
        (["--phases.velocity.max_iterations=0"], "VelocityModule: give at least one iteration"),
        (["--phases.correction.iterations=-1"], "LPOModule: give at least one iteration"),
        (["--truth=nowhere.json"], "--truth nowhere.json: no such file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_settings_that_do_not_fit(complain, options: list[str], expected: str):
    assert expected in complain(*options)
