"""One time axis for cameras that count differently, and one image size for cameras that have several."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.pac_nerf import read_pac_nerf
from pacnerf_lpo.data.recordings.recording import Camera, Frame, Recording
from pacnerf_lpo.data.recordings.timeline import Timeline, common_times, stated_times
from pacnerf_lpo.errors import UserInputError
from tests.data.recordings.studio import CONTACT, NAMES, SIZE


def recording(*stamps) -> Recording:
    cameras = [
        Camera(str(n), np.eye(3), np.eye(3, 4), tuple(Frame(Path(f"{n}_{i}.png"), t) for i, t in enumerate(times)))
        for n, times in enumerate(stamps)
    ]
    return Recording("x", Path("films"), tuple(cameras))


def schedule(*stamps) -> Timeline:
    found = recording(*stamps)
    return common_times(found, stated_times(found))


def test_different_frame_rates_and_starts():
    """60 a second from 0 s, 30 a second from 0.1 s: every second frame of the first, from its sixth on."""
    found = schedule(np.arange(40) / 60, 0.1 + np.arange(10) / 30)
    np.testing.assert_allclose(found.times, np.arange(10) / 30, atol=1e-12)
    np.testing.assert_array_equal(found.places[0], 6 + 2 * np.arange(10))
    np.testing.assert_array_equal(found.places[1], np.arange(10))
    assert found.start == pytest.approx(0.1) and not found.offsets.any()


def test_a_constant_offset_is_kept_and_stated():
    """Two in step and one 0.3 of a frame later: its frames are taken as they are."""
    times = np.arange(10) / 30
    found = schedule(times, times + 0.01, times)
    np.testing.assert_allclose(found.offsets, [0.0, 0.01, 0.0], atol=1e-12)
    assert all(np.array_equal(places, np.arange(10)) for places in found.places)


def test_frame_rates_that_do_not_divide_are_filled_in():
    found = schedule(np.arange(12) / 24, np.arange(20) / 40)
    np.testing.assert_allclose(found.places[1], np.arange(len(found.times)) * 40 / 24, atol=1e-9)
    assert found.offsets[1] == 0.0 and len(found.times) == 12


def test_one_dropped_frame_is_filled_in_and_several_are_named():
    times = np.arange(12) / 30
    found = schedule(times, np.delete(times, 6))
    assert found.places[1][5:8].tolist() == [5.0, 5.5, 6.0]
    with pytest.raises(UserInputError, match=r"camera 1: no frames between 0\.1667 and 0\.2667 s"):
        schedule(times, np.delete(times, [6, 7]))


def test_no_overlap_and_no_times():
    times = np.arange(6) / 30
    with pytest.raises(UserInputError, match="at least 4 are needed"):
        schedule(times, times + 1.0)
    with pytest.raises(UserInputError, match="--fps"):
        schedule(times, [None] * 6)
    with pytest.raises(UserInputError, match="do not increase"):
        schedule(times, np.zeros(6))
    with pytest.raises(UserInputError, match="it has 2 frames"):
        schedule(times, times[:2])


@pytest.mark.slow
def test_cameras_of_different_size(tmp_path, write):
    """Images of one camera end eight rows and five columns earlier; there nothing is known, and no more changes."""
    source, scene = write("opencv_each"), tmp_path / "scene"
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
