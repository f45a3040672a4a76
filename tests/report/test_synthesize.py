"""A synthetic scene is readable, shows the motion that was simulated, and carries its truth."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.shapes import Ball, Block, Torus, fill
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.evaluation.parameter_errors import read_truth

OPTIONS = ["--dx", "0.08", "--substep_rate", "1200", "--frames", "4", "--views", "2", "--image_size", "64"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    root = tmp_path_factory.mktemp("scenes") / "ball"
    material = ["--material", "NeoHookean", "--material.E", "2e5", "--shape", "Ball", "--shape.radius", "0.15"]
    effects = ["--effects+=LinearDrag", "--effects.drag", "1.5"]
    assert main(["synthesize", str(root), *material, *effects, *OPTIONS, "--velocity", "[0.6,-1.0,0.0]"]) == 0
    return root


def test_the_scene_can_be_read_and_the_ball_moves_as_it_was_thrown(scene):
    video = VideoData(str(scene), [-0.3, 0.3, -0.3], [0.3, 0.9, 0.3]).prepare().video
    assert video.images.shape == (2, 4, 64, 64, 3)
    assert video.times.tolist() == pytest.approx([0, 1 / 24, 2 / 24, 3 / 24], abs=1e-6)
    columns = torch.arange(64) + 0.5
    silhouette = video.silhouettes[0]
    centre = (silhouette.sum(1) * columns).sum(-1) / silhouette.sum((1, 2))
    # view 0 looks along -z: x is to the right. Displacement with drag: v (1 - exp(-c t)) / c
    time = 3 / 24
    moved = 0.6 * (1 - np.exp(-1.5 * time)) / 1.5
    focal, distance = video.intrinsics[0, 0, 0].item(), 2.5
    # half a pixel of rasterisation; the distance to the ball varies by 5 % as it falls
    assert (centre[3] - centre[0]).item() == pytest.approx(focal * moved / distance, abs=0.6)


def test_truth_names_parameters_velocity_and_hidden_effects(scene):
    truth = read_truth(scene / "truth.json")
    assert truth.parameters == {"E": 2e5, "nu": 0.3}
    assert truth.velocity == (0.6, -1.0, 0.0)
    assert truth.hidden_effects == {"linear_drag": {"drag": 1.5}}


def test_truth_of_another_ground_is_a_hidden_effect(tmp_path):
    root = tmp_path / "scene"
    ground = ["--ground", "Separate", "--ground.friction", "0.2", "--material", "Newtonian"]
    assert main(["synthesize", str(root), *ground, *OPTIONS[:-6], "--frames", "1", "--views", "1"]) == 0
    assert read_truth(root / "truth.json").hidden_effects == {"separate": {"friction": 0.2}}
    assert json.loads((root / "truth.json").read_text())["material"] == "newtonian"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--height", "0.1"], "reaches 0.28 m below its centre"),
        (["--material", "NeoHookean", "--material.E", "-1"], "E = -1 Pa is not a possible"),
        (["--shape", "Ball", "--shape.radius", "0"], "give a positive length"),
        (["--dx", "0"], "give a positive spacing"),
    ],
)
def test_scenes_that_cannot_be_are_one_line(tmp_path, capsys, options, message):
    assert main(["synthesize", str(tmp_path / "scene"), *options]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and message in lines[0]


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Ball(0.2), 4 / 3 * np.pi * 0.2**3),
        (Block((0.4, 0.2, 0.3)), 0.024),
        (Torus(0.2, 0.08), 2 * np.pi**2 * 0.2 * 0.08**2),
    ],
)
def test_particles_fill_the_volume_of_the_shape(shape, volume):
    spacing = 0.02
    points = fill(shape, spacing, torch.Generator().manual_seed(0))
    # particles at the surface are in or out by chance: sqrt(area / spacing^2) is below 40 of 3000
    assert len(points) * spacing**3 == pytest.approx(volume, rel=0.03)
    assert points.abs().max() <= shape.reach + 1e-6
    assert points.mean(0).abs().max() < 0.01
