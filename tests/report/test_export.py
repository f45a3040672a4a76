"""PLY files, films and turntables hold what was predicted."""

from __future__ import annotations

import imageio_ffmpeg
import numpy as np
import pytest
import torch
from PIL import Image
from plyfile import PlyData

from pacnerf_lpo.commands import export, render
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.prediction import predict
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.report.export import frame_velocities
from pacnerf_lpo.report.turntable import Orbit


def read_film(path) -> tuple[dict, np.ndarray]:
    reader = imageio_ffmpeg.read_frames(str(path))
    meta = next(reader)
    width, height = meta["size"]
    return meta, np.stack([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader])


@pytest.fixture(scope="module")
def exported(evaluated_run):
    export.run(str(evaluated_run), views=[2])
    return evaluated_run


def test_particles_as_ply(exported):
    run = Run(exported)
    positions = predict(run, run.last).positions
    files = sorted((exported / "particles" / "03_r1_correction").glob("*.ply"))
    assert [file.name for file in files] == [f"frame_{frame:03d}.ply" for frame in range(5)]
    vertices = PlyData.read(files[3])["vertex"]
    np.testing.assert_array_equal(np.stack([vertices[axis] for axis in "xyz"], axis=1), positions[3])
    np.testing.assert_array_equal(vertices["density"], run.last.state.density.numpy())
    assert vertices["red"].dtype == np.uint8
    first = PlyData.read(files[0])["vertex"]
    np.testing.assert_allclose(first["vy"], -0.5)


def test_velocities_of_free_fall_are_exact():
    """Second-order differences of a parabola in time are exact up to float64 rounding of x / dt."""
    times = np.arange(6) / 24
    start, speed = np.array([[0.1, 1.0, -0.3]]), np.array([[1.0, -0.5, 0.2]])
    positions = start + speed * times[:, None, None] + 0.5 * np.array([0, -9.8, 0]) * times[:, None, None] ** 2
    expected = speed + np.array([0, -9.8, 0]) * times[:, None, None]
    np.testing.assert_allclose(frame_velocities(positions, speed, times), expected, atol=1e-12)


def test_film_shows_measured_model_and_residual(exported):
    meta, frames = read_film(exported / "videos" / "view_2.mp4")
    assert len(frames) == 5
    assert meta["fps"] == pytest.approx(6.0)  # 24 frames/s, four times slower
    run = Run(exported)
    side = frames.shape[2] // 3
    factor = side // run.data.video.images.shape[3]
    pictured = frames[3, :side:factor, :side:factor]
    measured = run.data.video.images[1, 3].numpy() * 255
    # lossy compression with subsampled colour: some grey levels on average
    assert np.abs(pictured[: len(measured)].mean(-1) - measured.mean(-1)).mean() < 8


def test_a_picture_from_a_training_camera_is_what_that_camera_shows(exported, tmp_path):
    """The orbit's axes: looking from azimuth 90 deg, the world's +z axis points left in the picture."""
    orbit = Orbit((0.0, 0.5, 0.0), 2.0, 0.0, 64)
    pose = orbit.camera_to_world(90.0)
    torch.testing.assert_close(pose[:, 3], torch.tensor([2.0, 0.5, 0.0], dtype=torch.float64))
    torch.testing.assert_close(pose[:, 0], torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64))
    torch.testing.assert_close(torch.linalg.det(pose[:, :3]), torch.tensor(1.0, dtype=torch.float64))
    centre = orbit.rays(90.0).directions.view(64, 64, 3)[31:33, 31:33].mean((0, 1))
    torch.testing.assert_close(centre, torch.tensor([-1.0, 0.0, 0.0]), atol=1e-3, rtol=0)


def test_orbit_keeps_every_particle_in_view():
    positions = torch.rand(2, 500, 3, generator=torch.Generator().manual_seed(0))
    orbit = Orbit.around(positions, 30.0, 64)
    for azimuth in (0.0, 77.0, 200.0):
        pose = orbit.camera_to_world(azimuth).float()
        local = (positions.flatten(0, 1) - pose[:, 3]) @ pose[:, :3]
        half = np.tan(np.radians(35.0 / 2))
        assert (local[:, :2].abs() <= -local[:, 2:] * half).all()


def test_rendering_a_still_and_a_turn(exported, tmp_path, monkeypatch):
    monkeypatch.setattr(render, "SECONDS", 1)
    monkeypatch.setattr(render, "FILM_RATE", 8)
    render.run(str(exported), output=str(tmp_path / "still.png"), frame=4, elevation=60.0, size=48)
    still = np.asarray(Image.open(tmp_path / "still.png"))
    assert still.shape == (48, 48, 3)
    assert still.min() < 200 and (still == 255).any()
    render.run(str(exported), output=str(tmp_path / "turn.mp4"), size=48)
    _, frames = read_film(tmp_path / "turn.mp4")
    assert len(frames) == 8
    assert np.abs(frames[0].astype(int) - frames[4]).max() > 50  # seen from the other side


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"output": "turn.gif"}, "ends in .mp4"),
        ({"frame": 5}, "frames 0 to 4"),
        ({"size": 33}, "even number"),
        ({"phase": "09_none"}, "no finished phase"),
    ],
)
def test_render_options_that_cannot_be(exported, options, message):
    with pytest.raises(UserInputError, match=message):
        render.run(str(exported), **options)


def test_export_refuses_an_unknown_view_before_it_writes(evaluated_run):
    with pytest.raises(UserInputError, match="no view 3"):
        export.run(str(evaluated_run), views=[3])
