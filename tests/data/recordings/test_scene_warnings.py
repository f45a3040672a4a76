"""What is planted in a scene is warned of, with its camera and frames; a clean scene has none of it."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy import ndimage

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.recordings.conversion import frame_ranges
from pacnerf_lpo.data.recordings.look import examine
from pacnerf_lpo.data.recordings.scene_warnings import LEAST_BLUR, SceneWarning, scene_warnings
from pacnerf_lpo.data.recordings.sharpness import blur, edge_widths
from pacnerf_lpo.data.recordings.written_scene import annotated, header, read_written_scene
from pacnerf_lpo.errors import UserInputError
from tests.data.recordings.studio import CONTACT, FRAMES, RADIUS, SIZE, VIEWS, body
from tests.data.recordings.test_clocks import LATE, record

pytestmark = pytest.mark.slow

TRUE_OF_THE_STUDIO = {"contact", "pixels"}
"""Four frames from contact on, and a ball of 30 pixels."""


def warned(scene: Path) -> list[SceneWarning]:
    return scene_warnings(examine(scene))


def of_kind(scene: Path, kind: str) -> SceneWarning:
    found = [warning for warning in warned(scene) if warning.kind == kind]
    assert len(found) == 1, found
    return found[0]


@pytest.fixture
def scene(made, tmp_path) -> Path:
    """A copy of a scene that a test may spoil; its images have transparency and no background."""
    return shutil.copytree(made("gic").scene, tmp_path / "scene")


def change_images(scene: Path, pattern: str, change) -> None:
    """Replace colour and opacity [0..1, (H, W, 4)] of some images."""
    for path in scene.glob(f"data/{pattern}"):
        changed = change(np.asarray(Image.open(path)) / 255.0)
        Image.fromarray(np.round(255.0 * np.clip(changed, 0.0, 1.0)).astype(np.uint8)).save(path)


def change_entries(scene: Path, change) -> None:
    path = scene / "all_data.json"
    entries = json.loads(path.read_text())
    for entry in entries:
        change(entry, int(entry["file_path"].split("_")[1]))
    path.write_text(json.dumps(entries))


def change_value(scene: Path, change) -> None:
    path = scene / "scene.yaml"
    path.write_text(change(path.read_text()))


@pytest.mark.parametrize("name", ["gic", "opencv_shared", "spring_gaus_real", "colmap_binary"])
def test_a_clean_scene_has_no_other_warnings_than_are_true(made, name):
    """By white, background of the video, masks and transparency, with lenses, other axes and units."""
    look = examine(made(name).scene)
    assert {warning.kind for warning in scene_warnings(look)} <= TRUE_OF_THE_STUDIO
    assert look.scene.hit_frame == CONTACT
    np.testing.assert_allclose(np.linalg.norm(look.motion.acceleration), 9.81, rtol=0.02)
    # the convex hull of the outlines of six views around a ball, and its outline's half pixel
    assert 2 * RADIUS * 0.98 < look.size < 2 * RADIUS * 1.2
    expected = [body(frame)[0][1] for frame in range(CONTACT)]
    # the ground is found to 3 mm, and the scale, where it is measured, to 1 % of 0.75 m
    np.testing.assert_allclose(look.centre[:CONTACT], expected, atol=0.011)
    assert look.residual < 2e-3
    for hull in look.hulls.values():
        assert max(hull.outside) < 0.01
        assert np.ptp(hull.points, axis=0).max() < 2 * RADIUS * 1.2


def test_two_views(made, tmp_path, capsys):
    done = made("gic")
    words = ["init", done.source, tmp_path / "two", "--leave_out", "2", "3", "4", "5"]
    assert main([str(word) for word in words]) == 0
    said = capsys.readouterr().out
    assert "warning: only 2 views" in said and "add a camera" in said
    assert {"views"} <= {warning.kind for warning in warned(tmp_path / "two")} <= {"views", *TRUE_OF_THE_STUDIO}


def test_all_views_from_one_side(scene):
    def together(entry, view):
        pose = np.array(entry["c2w"])
        pose[:, 3] = np.array([0.0, 0.6, 3.0]) + 0.1 * np.array([view, 0.3 * view**2, 0.0])
        pose[:, :3] = np.eye(3)
        entry["c2w"] = pose.tolist()

    change_entries(scene, together)
    assert "depth of the body is a guess" in of_kind(scene, "views").what


def test_a_shifted_camera_is_named(scene):
    """By 3 % of the body's size, so little that init lets it pass."""

    def shift(entry, view):
        if view == 3:
            pose = np.array(entry["c2w"])
            pose[:, 3] += 0.05 * 2 * RADIUS * pose[:, 0]
            entry["c2w"] = pose.tolist()

    change_entries(scene, shift)
    found = of_kind(scene, "disagreement")
    assert found.cameras == ("3",) and "camera 3 disagrees" in found.what and "--leave_out 3" in found.remedy


def test_a_camera_cut_off_at_the_border_in_some_frames(scene):
    """The lower part of its images is what undistortion leaves: nothing."""
    row = examine(scene).appearances[2]
    bottoms = np.array([one.centre[1] + 0.5 * one.size for one in row])
    edge = int(bottoms[2])
    hidden = np.zeros((SIZE, SIZE, 4), np.uint8)
    hidden[edge:, :, 3] = 255
    Image.fromarray(hidden).save(scene / "data" / "r_2_-2.png")
    change_images(scene, "m_2_*.png", lambda pixels: pixels * (np.arange(SIZE) < edge)[:, None, None])
    found = [warning for warning in warned(scene) if warning.kind == "border"]
    assert {warning.cameras for warning in found} == {("2",)}
    touched = {frame for warning in found for frame in warning.frames}
    assert set(np.flatnonzero(bottoms > edge + 1)) <= touched <= set(np.flatnonzero(bottoms > edge - 4))
    assert 0 not in touched


def test_a_matte_that_loses_a_part_in_one_frame(scene):
    def halve(pixels):
        column = int(np.nonzero(pixels[..., 3] > 0.5)[1].mean())
        return pixels * (np.arange(SIZE) < column)[None, :, None]

    change_images(scene, "m_1_4.png", halve)
    found = of_kind(scene, "matte")
    assert found.cameras == ("1",) and 4 in found.frames and "masks" in found.remedy


def test_a_matte_with_another_piece(scene):
    def speck(pixels):
        pixels[5:20, 5:20] = [0.5, 0.5, 0.5, 1.0]
        return pixels

    change_images(scene, "m_0_[3-6].png", speck)
    found = of_kind(scene, "matte")
    assert found.frames == (3, 4, 5, 6) and "in several pieces" in found.what


def test_motion_blur_is_found_in_images(scene):
    """The images of all cameras smeared along their motion, by 0.8 of it: an exposure of most of the frame time."""
    look = examine(scene)
    for view, row in enumerate(look.appearances):
        for frame in range(1, FRAMES):
            step = 0.8 * (row[frame].centre - row[frame - 1].centre)[::-1]

            def smear(pixels, step=step):
                flat = np.dstack((pixels[..., :3] * pixels[..., 3:], pixels[..., 3]))
                parts = [ndimage.shift(flat, (*(share * step), 0.0), order=1) for share in np.linspace(-0.5, 0.5, 13)]
                mean = np.mean(parts, axis=0)
                return np.dstack((mean[..., :3] / np.maximum(mean[..., 3:], 1e-6), mean[..., 3]))

            change_images(scene, f"m_{view}_{frame}.png", smear)
    found = of_kind(scene, "blur")
    assert "possible" in found.what and "exposure" in found.remedy and len(found.cameras) >= VIEWS // 2


@pytest.mark.parametrize("length", [0.0, 3.0, 6.0])
@pytest.mark.parametrize("angle", [0.0, 40.0, 90.0, 200.0])
def test_the_length_of_a_blur(length, angle):
    """A textured disc of 40 pixels, moved during the exposure: to a third, as a side is 45 degrees wide."""
    way = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    fine = np.stack(np.meshgrid(*[(np.arange(4 * 80) + 0.5) / 4 - 40] * 2), axis=-1)
    texture = 0.7 + 0.25 * np.random.default_rng(0).random((10, 10, 3))
    total = np.zeros((320, 320, 4))
    for share in np.linspace(-0.5, 0.5, 25):
        own = fine - share * length * way
        column, row = (own // 8 + 5).clip(0, 9).astype(int).transpose(2, 0, 1)
        disc = (np.linalg.norm(own, axis=-1) < 20)[..., None]
        total += disc * np.concatenate((texture[row, column], np.ones((320, 320, 1))), axis=-1)
    colour, opacity = np.split(total.reshape(80, 4, 80, 4, 4).mean(axis=(1, 3)) / 25, [3], axis=-1)
    picture, opacity = colour + (1.0 - opacity) * [0.1, 0.2, 0.15], opacity[..., 0]
    measured = blur(edge_widths(picture, opacity, 8.0), way)
    assert measured == pytest.approx(length, rel=0.35, abs=0.0 if length else LEAST_BLUR)


def test_cameras_out_of_step_are_named_and_allowed_for(tmp_path):
    """Their outlines are of other times: planes, hull and box are compared at the same one."""
    source = tmp_path / "late"
    record(source, [np.arange(FRAMES) + late for late in LATE])
    assert main(["init", str(source), str(tmp_path / "scene")]) == 0
    look = examine(tmp_path / "scene")
    found = scene_warnings(look)
    assert {warning.kind for warning in found} <= {"clock", *TRUE_OF_THE_STUDIO}
    named = {warning.cameras[0]: warning.what for warning in found if warning.kind == "clock"}
    assert {"1", "2", "4"} <= set(named) and "earlier" in named["1"] and "later" in named["4"]
    assert max(look.hulls[0].outside) < 0.02


def test_values_that_a_person_changed_count(scene):
    change_value(scene, lambda text: text.replace(f"hit_frame: {CONTACT}", "hit_frame: 2"))
    assert "2 frames" in of_kind(scene, "flight").what
    lower = yaml.safe_load((scene / "scene.yaml").read_text())["data"]["box_lower"]
    change_value(scene, lambda text: text.replace(f"[{lower[0]:g},", f"[{lower[0] + 0.2:g},"))
    found = of_kind(scene, "box")
    assert "below the box along x" in found.what and "box_lower" in found.remedy


def test_a_wrong_frame_rate_shows_as_another_gravity(scene):
    change_entries(scene, lambda entry, _: entry.update(time=1.2 * entry["time"]))
    assert "6.8" in of_kind(scene, "gravity").what  # 9.81 / 1.2^2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace(f"hit_frame: {CONTACT}", "hit_frame: 40"), "hit_frame = 40; give a frame in 1..10"),
        (lambda text: text.replace(f"hit_frame: {CONTACT}", "hit_frame: soon"), "hit_frame' is 'soon'; give one"),
        (lambda text: re.sub(r"box_upper: .*", "box_upper: 3", text), "box_upper, [x, y, z]: expected 3 numbers"),
        (lambda text: text.replace("box_upper", "box_top"), "'data.box_upper' is missing"),
        (lambda text: text.replace("data:", "data: ]"), "no valid YAML"),
    ],
)
def test_what_cannot_be_in_a_scene_file_is_named(scene, change, said):
    change_value(scene, change)
    with pytest.raises(UserInputError, match=re.escape(said)):
        read_written_scene(scene)


def test_comments_of_a_scene_file():
    text = (
        "# cameras: 0 left, 1 right\n# Written by hand\n# clocks: late\n#   left: repeated\n"
        "data:\n  box_lower: [0, 1, 2] # m; measured\n"
        "  box_upper: [1, 2, 3]\nphysics: # a guess\n  E: '1 # 2'\n  # counted\n  # twice\n  frames: 24\n"
        "  effects:\n    - {k: 1} # none\n"
    )
    assert header(text) == {"cameras": "0 left, 1 right", "clocks": "late; left: repeated"}
    found = {value.key: (value.text, value.why) for value in annotated(text)}
    assert (
        found["data.box_upper"]
        == ("[1, 2, 3]", "m; measured")
        == (found["data.box_upper"][0], found["data.box_lower"][1])
    )
    assert found["physics.E"] == ("'1 # 2'", "a guess") and found["physics.frames"] == ("24", "counted twice")
    assert found["physics.effects[0]"][0] == "{k: 1}"


def test_frames_are_written_as_ranges():
    assert frame_ranges([0, 1, 2, 5, 7, 8]) == "0-2, 5, 7-8"
