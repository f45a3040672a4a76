"""What ``fit SCENE`` stacks: the scene file wins over a preset, sizes follow the scene, the method is the preset's."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
import yaml
from PIL import Image

import pacnerf_lpo.commands.fit  # noqa: F401  (makes the short class names known)
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.presets import LEAST_GPU_MEMORY, PRESETS, stack

BY_HAND = {
    "data": {"box_lower": [-0.4, 0.2, -0.2], "box_upper": [0.4, 0.8, 0.2]},
    "physics": {"material": "NeoHookean"},
    "phases": {
        "static": {"class_path": "StaticGridModule", "init_args": {"entropy_weight": 1e-3, "surface_weight": 1e-3}},
        "velocity": {"class_path": "VelocityModule", "init_args": {"hit_frame": 4}},
    },
}
PAPER_ADAM = {"class_path": "PhysicsIDModule", "init_args": {"method": {"class_path": "PaperAdam"}}}


@pytest.fixture
def scene(tmp_path: Path):
    """Writes a scene of one image of 400 x 300 pixels."""

    def write(**changes) -> Path:
        folder = tmp_path / "scene"
        (folder / "data").mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (400, 300)).save(folder / "data" / "m_0_0.png")
        (folder / "all_data.json").write_text("[]")
        (folder / "scene.yaml").write_text(yaml.safe_dump({**BY_HAND, **changes}))
        return folder

    return write


def parsed(folder: Path, *words: str):
    return PhaseCLI(stack(folder, words)[0], VideoModule, Physics).config


@pytest.mark.slow
@pytest.mark.parametrize("preset", PRESETS)
def test_sizes_follow_body_and_images(scene, preset: str):
    config = parsed(scene(), "--preset", preset)
    assert config.phases.static.init_args.base_spacing == 0.2  # a quarter of 0.8 m, whatever cpu.yaml says
    assert config.physics.substep_rate == 1512.0  # 300 m/s / 0.2 m, in whole steps of 24 frames
    assert config.data.image_scale == {"quick": 0.32, "cpu": 0.5, "paper": 1.0}[preset]
    assert config.data.root == str(scene()) and config.outer_loop.run_dir == str(scene() / "run")
    assert config.preset == preset and config.intervals


def test_the_run_goes_where_out_says(scene, tmp_path: Path):
    assert parsed(scene(), "--out", str(tmp_path / "elsewhere")).outer_loop.run_dir == str(tmp_path / "elsewhere")


def test_the_scene_file_wins_and_what_is_typed_wins_over_it(scene):
    static = {"class_path": "StaticGridModule", "init_args": {**BY_HAND["phases"]["static"]["init_args"]}}
    static["init_args"]["base_spacing"] = 0.1
    folder = scene(phases={**BY_HAND["phases"], "static": static}, data={**BY_HAND["data"], "image_scale": 0.9})
    config = parsed(folder, "--preset=cpu", "--data.image_scale=0.7")
    assert config.phases.static.init_args.base_spacing == 0.1 and config.data.image_scale == 0.7
    assert config.physics.substep_rate == 3000.0
    assert parsed(folder, "--preset=cpu").data.image_scale == 0.9


@pytest.mark.parametrize("preset", PRESETS)
def test_another_method_in_the_scene_is_replaced_and_said(scene, preset: str):
    folder = scene(phases={**BY_HAND["phases"], "physics": PAPER_ADAM})
    method = {"quick": "OutlineGaussNewton", "cpu": "GaussNewton", "paper": "PaperAdam"}[preset]
    said = stack(folder, ["--preset", preset])[1]
    change = f"phases.physics.init_args.method from PaperAdam ({folder / 'scene.yaml'}) to {method}"
    assert said == ([] if preset == "paper" else [f"preset {preset} changes {change}"])
    found = parsed(folder, "--preset", preset).phases.physics.init_args.method
    assert found.class_path.endswith(f".{method}")
    if preset == "quick":
        assert found.init_args.samples == 32


@pytest.mark.slow
@pytest.mark.parametrize(("memory", "chosen"), [(LEAST_GPU_MEMORY, "paper"), (LEAST_GPU_MEMORY - 1, "cpu")])
def test_auto_goes_by_the_machine(scene, monkeypatch: pytest.MonkeyPatch, memory: int, chosen: str):
    assert parsed(scene()).preset == "cpu" or torch.cuda.is_available()
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda _: SimpleNamespace(total_memory=memory))
    config = parsed(scene())
    assert (config.preset, config.trainer.accelerator) == (chosen, "gpu" if chosen == "paper" else "cpu")
