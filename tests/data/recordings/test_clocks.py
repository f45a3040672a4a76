"""Cameras out of step, repeated and missing frames, other frame rates: found from the images, and used."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.pac_nerf import read_pac_nerf
from pacnerf_lpo.data.recordings.clocks import Sighting, find_clocks, resampled
from pacnerf_lpo.data.recordings.shots import mend_dropouts
from pacnerf_lpo.data.recordings.tangents import outline_points
from pacnerf_lpo.data.video_data import VideoData
from tests.data.recordings.layouts import write_json
from tests.data.recordings.studio import (
    CONTACT,
    FPS,
    FRAMES,
    IN_STEP,
    SOFT,
    VELOCITY,
    VIEWS,
    World,
    background,
    before_background,
    film,
    films,
    intrinsic,
    rig,
    save,
    save_video,
)

pytestmark = pytest.mark.slow

LATE = (0.1, -0.4, 0.25, 0.0, 0.3, 0.0)
TENTH = 0.1
"""Of a frame: what was asked for."""


def sightings(films: np.ndarray, poses: np.ndarray) -> list[Sighting]:
    found = []
    for pose, images in zip(poses, films, strict=True):
        outlines = [outline_points(image[..., 3], intrinsic()) for image in images]
        points, inside = zip(*outlines, strict=True)
        found.append(Sighting(pose, intrinsic()[0, 0], np.arange(len(images)) / FPS, points, inside))
    return found


def record(root: Path, moments: list[np.ndarray]) -> Path:
    """PAC-NeRF's layout with each camera's frames at its own moments [frames of the studio], stamped as if in step."""
    entries = []
    for view, own in enumerate(moments):
        save(root / f"data/r_{view}_-1.png", background(view))
        for f, shown in enumerate(before_background(view, film(view, own))):
            save(root / f"data/r_{view}_{f}.png", shown)
            entries.append(
                {
                    "file_path": f"./data/r_{view}_{f}.png",
                    "c2w": World().poses()[view].tolist(),
                    "intrinsic": intrinsic().tolist(),
                    "time": f / FPS,
                }
            )
    write_json(root / "all_data.json", entries)
    return root


def imported(source: Path, *options: str) -> tuple[Path, dict, str]:
    scene = source.parent / "scene"
    assert main(["init", str(source), str(scene), *options]) == 0
    text = (scene / "scene.yaml").read_text()
    return scene, yaml.safe_load(text), text


def test_resampling_is_exact_for_parabolas():
    stamps, times = np.array([0.0, 0.1, 0.25, 0.3, 0.5]), np.array([-0.05, 0.0, 0.17, 0.3, 0.41, 0.55])
    curve = [1.0, -2.0, 3.0]
    np.testing.assert_allclose(
        resampled(np.polyval(curve, stamps), stamps, times), np.polyval(curve, times), atol=1e-12
    )
    holes = np.polyval(curve, stamps)
    holes[0] = np.nan
    found = resampled(holes, stamps, times)
    assert np.isnan(found[:3]).all() and found[3] == holes[3] and np.isfinite(found[4:]).all()


@pytest.mark.parametrize("late", [IN_STEP, LATE, (0, 0, 3.0, 0, 0, 0), (0, 0, -2.7, 0, 1.5, 0)])
def test_offsets_within_a_tenth_of_a_frame(late):
    found = find_clocks(sightings(films(late=late), rig()))
    off = found.offsets * FPS
    np.testing.assert_allclose(off - off[3], late, atol=TENTH)
    assert np.all(found.errors * FPS < TENTH)
    if not any(late):
        assert not found.offsets.any(), "what is within its error is no offset"


def test_a_camera_a_second_late():
    """The body is held, dropped and lies; one of four cameras was started a second after the others."""
    late = (0, 0, 24, 0)
    shown = [film(view, np.maximum(np.arange(-24, 14) + later, 0)) for view, later in enumerate(late)]
    found = find_clocks(sightings(np.stack(shown), rig()[:4]))
    np.testing.assert_allclose(found.offsets * FPS, late, atol=TENTH)


def test_three_cameras_and_a_calibration_that_is_a_little_wrong():
    """Cameras turned by 0.3 degrees, a pixel, as after a bump; one late by a third of a frame."""
    late, poses = (0, 1 / 3, 0, 0, 0, 0), rig().copy()
    turn = np.radians(0.3) * np.random.default_rng(0).standard_normal((VIEWS, 3))
    for pose, (x, y, z) in zip(poses, turn, strict=True):
        pose[:, :3] = pose[:, :3] @ (np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
    found = find_clocks(sightings(films(late=late), poses))
    np.testing.assert_allclose(found.offsets * FPS, late, atol=TENTH)
    some = [1, 3, 5]
    three = find_clocks([sightings(films(late=late), rig())[view] for view in some])
    off = three.offsets * FPS
    assert off[0] - off[1] == pytest.approx(1 / 3, abs=TENTH)


def test_a_camera_that_fits_at_no_time_keeps_its_stamps():
    poses = rig().copy()
    poses[2, :, 3] += [0.5, 0.0, 0.3]
    assert find_clocks(sightings(films(), poses)).offsets[2] == 0.0


def test_a_scene_of_cameras_out_of_step(tmp_path):
    """Box, ground and contact are those of one time, the offsets are in the scene, and a reader and fit have them."""
    source = record(tmp_path / "case", [np.arange(FRAMES) + late for late in LATE])
    scene, config, text = imported(source)
    video = read_pac_nerf(scene)
    np.testing.assert_allclose(np.array(video.offsets) * FPS, LATE, atol=TENTH)
    assert "camera" in text and "of a frame" in text.split("# clocks: ")[1].splitlines()[0]
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT
    np.testing.assert_allclose(config["data"]["velocity"], VELOCITY, atol=0.05)
    data = VideoData(**config["data"]).prepare()
    moved = data.first_rays(1).origins[0] - data.rays(1).origins[0]
    np.testing.assert_allclose(moved, 0.4 / FPS * VELOCITY, atol=0.002)


def test_a_camera_a_second_late_is_aligned_by_whole_frames(tmp_path):
    """One of six was started three frames later than the others, and counts from zero."""
    moments = [np.arange(FRAMES) if view != 4 else np.arange(3, FRAMES + 3) for view in range(VIEWS)]
    scene, config, text = imported(record(tmp_path / "case", moments))
    assert (
        "4 +3.0" in text and len({e["time"] for e in json.loads((scene / "all_data.json").read_text())}) == FRAMES - 3
    )
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT - 3
    assert "velocity" not in config["data"], "in whole frames no camera is out of step any more"


def test_another_frame_rate(tmp_path, write):
    """One camera of six takes 40 frames a second: what it shows at the times of the others is filled in."""
    folder = write("opencv_shared")
    save_video(folder / "back.mp4", before_background(3, film(3, np.arange(18) * FPS / 40.0, SOFT)), 40.0)
    scene, config, text = imported(folder)
    assert "camera back: filled in between two images: frames" in text
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT
    overlap = read_pac_nerf(scene).silhouettes.numpy()[3] > 0.5, films()[3, ..., 3] > 0.5
    both, either = (overlap[0] & overlap[1]).sum((1, 2)), (overlap[0] | overlap[1]).sum((1, 2))
    assert (both / either).min() > 0.9


def test_a_repeated_frame_is_left_out_and_filled_in(tmp_path, caplog):
    """Frame 4 of camera 1 repeats frame 3; frame 5 is in time again."""
    moments = [np.arange(FRAMES, dtype=float) for _ in range(VIEWS)]
    moments[1][4] = 3.0
    with caplog.at_level(logging.WARNING):
        scene, config, text = imported(record(tmp_path / "case", moments))
    assert "camera 1: frame 4 repeats frame 3" in text and "camera 1: filled in between two images: frames 4" in text
    seen = read_pac_nerf(scene).silhouettes.numpy()[1, 4] > 0.5
    true = films()[1, 4, ..., 3] > 0.5
    assert (seen & true).sum() / (seen | true).sum() > 0.93
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT


def test_an_inserted_and_a_missing_frame(tmp_path):
    moments = [np.arange(FRAMES, dtype=float) for _ in range(VIEWS)]
    moments[1] = np.array([0, 1, 2, 2, 3, 4, 5, 6, 7, 8, 9], float)
    moments[5] = np.array([0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11], float)
    _, config, text = imported(record(tmp_path / "case", moments))
    assert "camera 1: frame 3 repeats frame 2, and all later ones are late" in text
    assert "camera 5: 1 frame missing before frame 3" in text
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT


def test_a_rest_and_a_bounce_are_no_dropouts():
    """A body that stands still, one that turns at its highest point, and one that bounces."""
    times = np.arange(12) / FPS
    flights = [
        np.zeros(12),
        3.0 * (np.arange(12) - 5.5) ** 2 / 2,
        np.where(np.arange(12) < 6, 8.0 * np.arange(12), 48.0 - 6.0 * (np.arange(12) - 6)),
        np.minimum(8.0 * np.arange(12), 43.0),
    ]
    for height in flights:
        centres = np.stack((0.3 * np.arange(12), height), axis=-1)
        kept, mended, said = mend_dropouts(centres, np.abs(np.gradient(height)) / 100 + 1e-4, times)
        assert not said and len(kept) == 12
        np.testing.assert_array_equal(mended, times)
