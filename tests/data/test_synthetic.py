"""Written scenes: deterministic, in the layout, lit alike in all views, with noise on the object alone."""

import json
import logging

import numpy as np
import pytest
from pytorch_lightning import LightningModule, Trainer

from pacnerf_lpo.data.synthetic import Drawing, draw_discs, hemisphere_rig, shade, write_scene
from pacnerf_lpo.errors import UserInputError
from tests.data.conftest import CENTRE, SIZE, ball, colours, load


def write(root, truth=None, **options):
    points = ball(0.05)
    rig = hemisphere_rig(2, SIZE)
    return write_scene(root, points[None], colours(points), rig, Drawing(SIZE, 0.05, **options), truth=truth)


def test_same_arguments_same_files(tmp_path):
    one, two = (write(tmp_path / name, noise=0.05, seed=3) for name in "ab")
    other = write(tmp_path / "c", noise=0.05, seed=4)
    for path in sorted(one.rglob("*.*")):
        assert path.read_bytes() == (two / path.relative_to(one)).read_bytes()
    assert (one / "data/m_0_0.png").read_bytes() != (other / "data/m_0_0.png").read_bytes()


def test_truth_is_written_only_when_given(tmp_path):
    assert not (write(tmp_path / "a") / "truth.json").exists()
    assert json.loads((write(tmp_path / "b", truth={"E_Pa": 1e5}) / "truth.json").read_text()) == {"E_Pa": 1e5}


def test_noise_is_on_the_object_alone(tmp_path):
    clean, noisy = load(write(tmp_path / "a")).video, load(write(tmp_path / "b", noise=0.05)).video
    difference = (noisy.images - clean.images)[clean.silhouettes > 0]
    assert np.array_equal(clean.silhouettes, noisy.silhouettes)
    # some 300 pixels in 3 channels: the standard deviation is known to 1 / sqrt(2 * 900) = 2.4 %, four of these
    assert float(difference.std()) == pytest.approx(0.05, rel=0.1)


def test_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "kept.txt").write_text("mine")
    with pytest.raises(UserInputError, match="not empty"):
        write(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["kept.txt"]


def test_nearer_particle_hides_the_farther():
    rig = hemisphere_rig(1, 9, target=(0.0, 0.0, 0.0), distance=2.0)
    back = rig.camera_to_world[0, :, 2]
    points, two = np.stack((0.1 * back, -0.1 * back)), np.array([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1]])
    for order in ([0, 1], [1, 0]):
        image = draw_discs(points[order], two[order], rig.camera_to_world[0], rig.intrinsics[0], 9, 0.1)
        assert image[4, 4].tolist() == pytest.approx([0.9, 0.1, 0.1])
        assert image[0, 0].tolist() == [1.0, 1.0, 1.0]


def test_particle_behind_the_camera_is_not_drawn():
    rig = hemisphere_rig(1, 9, target=(0.0, 0.0, 0.0), distance=2.0)
    behind = 3.0 * rig.camera_to_world[0, :, 2][None]
    assert (draw_discs(behind, np.zeros((1, 3)), rig.camera_to_world[0], rig.intrinsics[0], 9, 0.1) == 1.0).all()


def test_light_comes_from_above():
    points = ball()
    bright = shade(points, np.full((len(points), 3), 0.8)).mean(-1)
    assert bright[points[:, 1] > CENTRE[1] + 0.15].mean() > 1.3 * bright[points[:, 1] < CENTRE[1] - 0.15].mean()


def test_cameras_look_at_the_target_from_above():
    rig = hemisphere_rig(11, 64, target=(0.1, 0.4, 0.0), distance=2.5)
    rotation, position = rig.camera_to_world[:, :, :3], rig.camera_to_world[:, :, 3]
    np.testing.assert_allclose(rotation.transpose(0, 2, 1) @ rotation, np.tile(np.eye(3), (11, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    np.testing.assert_allclose(position - 2.5 * rotation[:, :, 2], np.tile([0.1, 0.4, 0.0], (11, 1)), atol=1e-12)
    assert (position[:, 1] > 0.4).all()


class Recorder(LightningModule):
    """A phase that keeps the batches it was handed."""

    def __init__(self):
        super().__init__()
        self.automatic_optimization = False
        self.given, self.seen = [], []

    def batches(self, data):
        self.given = [{"view": data.train[0], "pixels": data.video.images[data.train[0], 0]}]
        return self.given

    def training_step(self, batch, batch_index):
        self.seen.append(batch)

    def configure_optimizers(self):
        return None


@pytest.mark.filterwarnings("ignore:.*configure_optimizers")
def test_phase_gets_its_batches_without_a_copy(scene):
    logging.getLogger("pytorch_lightning").setLevel(logging.ERROR)
    phase, data = Recorder(), load(scene, train_views=[2])
    Trainer(max_epochs=1, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False).fit(
        phase, datamodule=data
    )
    assert phase.seen[0]["pixels"].data_ptr() == phase.given[0]["pixels"].data_ptr()
    assert phase.seen[0]["pixels"].data_ptr() == data.video.images[2, 0].data_ptr()


def test_large_discs_hide_the_inside_and_reach_no_farther_than_the_outline():
    rig = hemisphere_rig(1, 64, target=(0.0, 0.0, 0.0))
    view = rig.camera_to_world[0], rig.intrinsics[0], 64
    point, black = np.zeros((1, 3)), np.zeros((1, 3))
    small = draw_discs(point, black, *view, 0.05)
    np.testing.assert_array_equal(draw_discs(point, black, *view, 0.1, outline=0.05), small)
    assert (draw_discs(point, black, *view, 0.1) < small).any()
    towards_camera = rig.camera_to_world[0][:, 2] * 0.1
    beside = np.array([0.07, 0.0, 0.0])
    two, colours = np.stack((point[0] + towards_camera + beside, point[0])), np.array([[0.5] * 3, [0.0] * 3])
    hidden = draw_discs(two, colours, *view, 0.15, outline=0.05)
    assert hidden.min() == 0.5 and (draw_discs(two, colours, *view, 0.05) == 0.0).any()
