"""Every layout gives the cameras of the studio, and through ``init`` the same scene."""

from pathlib import Path

import numpy as np
import pytest

import pacnerf_lpo.phases  # noqa: F401  (short class names exist once their modules are imported)
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.data.pac_nerf import read_pac_nerf
from pacnerf_lpo.data.recordings.layouts import LAYOUTS, read_recording
from pacnerf_lpo.data.recordings.scene_file import MARGIN
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.mpm.physics import Physics
from tests.data.recordings.layouts import WRITERS
from tests.data.recordings.studio import (
    CONTACT,
    FRAMES,
    RADIUS,
    SIZE,
    START,
    VIEWS,
    body,
    centred,
    films,
    hull_bounds,
    intrinsic,
    rig,
)

pytestmark = pytest.mark.slow

CENTRED = ("spring_gaus_real", "d_nerf", "dynerf")
"""Layouts that can only say a centred principal point."""
UNIT_KNOWN = ("pac_nerf", "gic", "phystwin", "opencv_shared", "opencv_each", "anipose", "caliscope")
"""Layouts in metres, or in a unit that free fall recognises."""
PIXEL = 0.4 / 30
"""At the ball [m], which is 0.4 m and 30 pixels wide."""


def test_every_layout_is_tried(made):
    tried = {read_recording(made(name).source).layout for name in WRITERS}
    assert tried == {layout.name for layout in LAYOUTS}


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_cameras(made, name):
    """Files hold seven digits or more; 1e-4 of the unit and of a pixel's focal length is what was asked for."""
    done = made(name)
    recording = read_recording(done.source)
    assert len(recording.cameras) == VIEWS
    expected = {pose.round(2).tobytes(): pose for pose in done.world.poses()}
    for camera in recording.cameras:
        pose = min(expected.values(), key=lambda true, own=camera.pose: np.abs(true - own).max())
        np.testing.assert_allclose(camera.pose, pose, atol=1e-4 * max(1.0, np.abs(pose).max()))
        np.testing.assert_allclose(camera.intrinsic, centred() if name in CENTRED else intrinsic(), rtol=1e-4)
        np.testing.assert_allclose(
            np.trim_zeros(camera.lens.coefficients, "b"), np.trim_zeros(done.world.lens.coefficients, "b"), rtol=1e-6
        )
        assert len(camera.frames) == FRAMES
    if recording.up is not None:
        np.testing.assert_allclose(recording.up, done.world.up, atol=1e-9)


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_scene(made, name):
    done = made(name)
    scale, rotation, shift = done.similarity()
    up = np.degrees(np.arccos(min(1.0, rotation[1, 1])))
    assert up < 0.5
    # a unit is exact once it is recognised; free fall over 0.29 s, seen to 0.3 mm, gives it to 1 %
    assert scale == pytest.approx(1.0, rel=1e-6 if name in UNIT_KNOWN else 0.02)
    landed = body(FRAMES - 1)[0] * [1.0, 0.0, 1.0]
    assert abs((scale * rotation @ landed + shift)[1]) < 3e-3
    error = done.config["physics"].get("ground_error", 0.0)
    assert error == 0.0 if "# ground: stated" in done.text else 0.04 < error / (2 * RADIUS) < 0.08
    assert done.config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT

    config, centre = done.config, scale * rotation @ START + shift
    lower, upper = (np.array(config["data"][f"box_{side}"]) for side in ("lower", "upper"))
    room = MARGIN * (upper - lower).max() / (1.0 + 2.0 * MARGIN)
    cameras = scale * rig()[:, :, 3] @ rotation.T + shift
    found, expected = np.array([lower + room, upper - room]), hull_bounds(centre, scale * RADIUS, cameras)
    np.testing.assert_allclose(found, expected, atol=PIXEL)
    assert np.all(lower <= centre - RADIUS) and np.all(upper >= centre + RADIUS)
    np.testing.assert_allclose(config["physics"]["gravity"], [0.0, -9.81, 0.0], atol=0.09)  # 0.5 degrees
    assert all(entry["time_offset"] == 0.0 for entry in done.entries), "the studio's cameras are in step"


@pytest.mark.parametrize("name", WRITERS)
def test_the_scene_is_read_and_its_mattes_are_the_ball(made, name):
    """Masks and transparency up to interpolation; a plate or a median up to what the colours leave of a rim."""
    video = read_pac_nerf(made(name).scene)
    truth = films(off_centre=name not in CENTRED)[..., 3] > 0.5
    assert video.silhouettes.shape == (VIEWS, FRAMES, SIZE, SIZE)
    overlaps = []
    for own, true in zip(video.silhouettes.numpy()[made(name).order()] > 0.5, truth, strict=True):
        overlaps.append(np.logical_and(own, true).sum() / np.logical_or(own, true).sum())
    assert min(overlaps) > 0.93
    np.testing.assert_allclose(np.diff(video.times), 1 / 24, rtol=1e-4)


def test_every_value_of_the_scene_file_says_where_it_is_from(made):
    done = made("opencv_shared")
    assert "mm, as in it the body falls at 9." in done.text and "6 of them undistorted" in done.text
    assert "by background of the video and the other views, in all cameras; overlap (IoU) expected" in done.text
    keys = [line for line in done.text.splitlines() if ": " in line and not line.startswith("#")]
    bare = [line.split(":")[0].strip() for line in keys if "#" not in line]
    assert set(bare) <= {"class_path", "box_upper", "E", "nu"}  # explained one line above


@pytest.mark.parametrize("order", ["scene before cpu", "scene after cpu"])
def test_the_scene_file_is_a_config_of_fit(made, order):
    """In the order that init prints, and in that of the shipped scenes."""
    scene, configs = made("opencv_shared").scene / "scene.yaml", Path(__file__).parents[3] / "configs"
    files = [configs / "fit.yaml", configs / "cpu.yaml", scene]
    if order == "scene before cpu":
        files = [files[0], files[2], files[1]]
    cli = PhaseCLI([word for file in files for word in ("--config", str(file))], VideoModule, Physics)
    assert cli.phases["velocity"].frames == CONTACT and cli.physics.frame_rate == pytest.approx(24.0)
    data = cli.datamodule.prepare()
    assert len(data.train) == VIEWS and data.video.images.shape[1] == FRAMES
    spacing = made("opencv_shared").config["phases"]["static"]["init_args"]["base_spacing"]
    assert cli.phases["static"].base_spacing == (spacing if order == "scene after cpu" else 0.12)
