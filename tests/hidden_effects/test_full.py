"""What a user would say of a video that is to be reconstructed, and how its effects are measured."""

import json

import numpy as np
import pytest
import torch
from PIL import Image

from pacnerf_lpo.data.synthetic import draw_discs
from pacnerf_lpo.identification.problem import PARTICLES
from validation.hidden_effects import generate
from validation.hidden_effects.full import as_diagnosed, first_touch, reconstructed_from
from validation.hidden_effects.setting import FULL, Setting, Size

TINY = {"particles": 300, "views": 5, "frames": 8, "image_size": 48}
NULL = 2  # seed of a development scene


def test_a_body_that_a_coarse_grid_holds_off_the_ground_touches_it():
    assert first_touch(np.array([0.5, 0.2, 0.03, 0.025, 0.03]), spacing=0.05) == 2
    assert first_touch(np.array([0.5, 0.015, 0.005]), spacing=0.02) == 1


def test_without_contact_the_last_frame_has_to_do():
    assert first_touch(np.array([0.5, 0.4, 0.3]), spacing=0.05) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trained", "said", "held"),
    [((0, 2, 4), "3 views", [1, 3]), ((0, 1, 2, 3, 4), "all views", [1, 2, 4])],
)
def test_a_video_is_judged_by_the_views_that_its_diagnosis_holds_out(tmp_path, trained, said, held):
    scene = generate.generate(tmp_path, NULL, Size(**TINY, trained=trained))
    assert reconstructed_from(scene) == said
    setting = Setting(**json.loads((scene / "setting.json").read_text()))
    assert setting.held_views == held
    assert len(list((scene / "video").rglob("*.png"))) >= 5 * 8


@pytest.mark.slow
def test_a_video_shows_the_body_as_large_as_it_is(tmp_path):
    scene = generate.generate(tmp_path, NULL, Size(**TINY, trained=(0, 2, 4)))
    setting = Setting(**json.loads((scene / "setting.json").read_text()))
    points, apart = setting.filled(0.008, torch.Generator().manual_seed(0)).double().numpy(), 0.004
    for view, camera in enumerate(zip(np.array(setting.cameras), np.array(setting.intrinsics), strict=True)):
        true = draw_discs(points, np.zeros_like(points), *camera, setting.image_size, apart)
        shown = np.asarray(Image.open(scene / f"video/data/m_{view}_0.png").convert("L")) / 255
        covered = [(image < 0.99).sum() for image in (true[..., 0], shown)]
        assert covered[1] == pytest.approx(covered[0], rel=0.07)


def test_the_truth_moves_on_a_finer_grid_than_the_model():
    for size in FULL.values():
        assert 0.8 * (size.particles / PARTICLES) ** (1 / 3) > size.finer


def test_effects_are_measured_in_images_of_the_size_that_is_compared(tmp_path):
    scene = generate.generate(tmp_path, NULL, Size(**TINY))
    assert reconstructed_from(scene) is None
    setting = Setting(**json.loads((scene / "setting.json").read_text()))
    small, whole = as_diagnosed(setting).video(), setting.video()
    assert small.images.shape[2:4] == (24, 24)
    point = torch.tensor([0.1, 0.2, 1.0])
    torch.testing.assert_close(2 * (small.intrinsics[0] @ point)[:2], (whole.intrinsics[0] @ point)[:2])
