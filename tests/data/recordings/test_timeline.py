"""One time axis for cameras that count differently, and one image size for cameras that have several."""

import logging
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.pac_nerf import read_pac_nerf
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.data.recordings.timeline import synchronous
from pacnerf_lpo.errors import UserInputError
from tests.data.recordings.layouts import WRITERS
from tests.data.recordings.studio import CONTACT, NAMES, SIZE


def recording(*stamps) -> Recording:
    cameras = [
        Camera(str(n), np.eye(3), np.eye(3, 4), tuple(Frame(Path(f"{n}_{i}.png"), t) for i, t in enumerate(times)))
        for n, times in enumerate(stamps)
    ]
    return Recording("x", Path("films"), tuple(cameras))


def files(camera: Camera) -> list[str]:
    return [frame.file.stem for frame in camera.frames]


def test_different_frame_rates_and_starts():
    """60 a second from 0 s, 30 a second from 0.1 s: every second frame of the first, from its sixth on."""
    found, times = synchronous(recording(np.arange(40) / 60, 0.1 + np.arange(10) / 30))
    np.testing.assert_allclose(times, np.arange(10) / 30, atol=1e-12)
    assert files(found.cameras[0]) == [f"0_{6 + 2 * i}" for i in range(10)]
    assert files(found.cameras[1]) == [f"1_{i}" for i in range(10)]


def test_jitter_is_taken_and_said(caplog):
    jitter = np.arange(10) / 30 + 0.004 * (-1.0) ** np.arange(10)
    with caplog.at_level(logging.WARNING):
        _, times = synchronous(recording(np.arange(10) / 30, jitter - jitter[0]))
    np.testing.assert_allclose(np.diff(times), np.diff(times)[0])
    assert "camera" in caplog.text and "of a frame away" in caplog.text


def test_a_dropped_frame_is_named():
    times = np.arange(12) / 30
    with pytest.raises(UserInputError, match=r"camera 1: no frame near 0\.2 s"):
        synchronous(recording(times, np.delete(times, 6)))


def test_no_overlap_and_no_times():
    times = np.arange(6) / 30
    with pytest.raises(UserInputError, match="at least 4 are needed"):
        synchronous(recording(times, times + 1.0))
    with pytest.raises(UserInputError, match="--fps"):
        synchronous(recording(times, [None] * 6))
    with pytest.raises(UserInputError, match="do not increase"):
        synchronous(recording(times, np.zeros(6)))


def test_cameras_of_different_size(tmp_path):
    """Images of one camera end eight rows and five columns earlier; there nothing is known, and no more changes."""
    source, scene = tmp_path / "source", tmp_path / "scene"
    source.mkdir()
    WRITERS["opencv_each"](source)
    for path in [*(source / NAMES[1]).iterdir(), *(source / "masks" / NAMES[1]).iterdir()]:
        with Image.open(path) as image:
            cut = image.crop((0, 0, SIZE - 5, SIZE - 8))
        cut.save(path)
    assert main(["init", str(source), str(scene), "--fps", "24"]) == 0
    config = yaml.safe_load((scene / "scene.yaml").read_text())
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT
    video = read_pac_nerf(scene)
    assert video.images.shape[2:4] == (SIZE, SIZE)
    view = sorted(NAMES).index(NAMES[1])
    assert not video.valid[view, SIZE - 8 :].any() and not video.valid[view, :, SIZE - 5 :].any()
    assert video.valid[view, SIZE // 4 : SIZE // 2, SIZE // 4 : SIZE // 2].all()
