"""Films and turntables hold what was predicted; they are read by PyAV, which did not write them."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest
import torch
from PIL import Image

from pacnerf_lpo.commands import export, render
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.prediction import predict
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.report.turntable import Orbit


def read_film(path: Path) -> tuple[float, np.ndarray]:
    """Frames per second and pictures [0..255, (F, H, W, 3)]."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        return float(stream.average_rate), np.stack(pictures)


@pytest.fixture(scope="module")
def exported(finished_run: Path) -> Path:
    export.run(str(finished_run), views=[2])
    return finished_run


def test_film_of_the_model_alone(exported: Path, tmp_path: Path):
    export.run(str(exported), output=str(tmp_path / "model.mp4"), views=[2])
    rate, frames = read_film(tmp_path / "model.mp4")
    assert rate == pytest.approx(6.0)  # 24 frames/s, four times slower
    run = Run(exported)
    images = predict(run, run.last).images[1].astype(float)
    factor = frames.shape[1] // images.shape[1]
    assert factor > 1 and len(frames) == len(images)
    small = frames.reshape(5, images.shape[1], factor, images.shape[2], factor, 3).mean((2, 4))
    # lossy compression with subsampled colour: some grey levels on average, of a motion that changes more
    errors = np.abs(small.mean(-1)[:, None] - images.mean(-1)).mean((2, 3))
    assert (errors.argmin(1) == np.arange(5)).all() and errors.diagonal().max() < 4


def test_film_shows_measured_model_and_residual(exported):
    rate, frames = read_film(exported / "videos" / "view_2.mp4")
    assert len(frames) == 5
    assert rate == pytest.approx(6.0)  # 24 frames/s, four times slower
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
