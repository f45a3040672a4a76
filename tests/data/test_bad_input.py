"""Every inconsistency is found before training: one line that names the file or the key and how to mend it."""

import json
import logging

import numpy as np
import pytest
from PIL import Image

from pacnerf_lpo.errors import UserInputError
from tests.data.conftest import SIZE, load

WHITE = Image.new("RGB", (SIZE, SIZE), "white")


def refused(root, *parts: str, **options) -> None:
    with pytest.raises(UserInputError) as error:
        load(root, **options)
    message = str(error.value)
    assert "\n" not in message and len(message) < 400
    for part in parts:
        assert part in message


def test_the_unspoilt_scene_is_accepted(scene):
    assert load(scene, train_views=[0, 2]).test == [1, 3]


def test_wrong_path_names_the_nearest_folder(scene):
    refused(scene.parent / "bal", "there is no folder", "did you mean", "ball")


def test_empty_folder(tmp_path):
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "is empty", "all_data.json")


def test_unknown_shipped_scene():
    refused("asset:fish", "asset:fish", "asset:bird")


def test_missing_index(scene):
    (scene / "all_data.json").unlink()
    refused(scene, "all_data.json", "missing")


@pytest.mark.parametrize("text", ['[{"file_path": ', "\x00\x01", ""])
def test_invalid_json(scene, text):
    (scene / "all_data.json").write_text(text)
    refused(scene, "all_data.json", "cannot be read")


@pytest.mark.parametrize("content", [{}, [], {"frames": []}, "text"])
def test_json_that_is_no_list_of_images(scene, content):
    (scene / "all_data.json").write_text(json.dumps(content))
    refused(scene, "all_data.json", "expected a list")


def test_entry_that_is_no_object(scene):
    (scene / "all_data.json").write_text("[3]")
    refused(scene, "entry 0", "expected an object")


@pytest.mark.parametrize(("right", "wrong"), [("c2w", "c2W"), ("intrinsic", "intrinsics"), ("file_path", "filepath")])
def test_wrong_key_names_the_right_one(scene, edit, right, wrong):
    edit(lambda shots: shots[1, 2].update({wrong: shots[1, 2].pop(right)}))
    refused(scene, "all_data.json, entry 9", f"rename '{wrong}' to '{right}'")


def test_missing_key_lists_what_is_there(scene, edit):
    edit(lambda shots: shots[0, 0].pop("time"))
    refused(scene, "entry 0", "'time' is missing", "'c2w'")


def test_file_path_of_another_form(scene, edit):
    edit(lambda shots: shots[0, 0].update(file_path="./data/view0.png"))
    refused(scene, "entry 0", "view0.png", "r_<camera>_<frame>.png")


@pytest.mark.parametrize(
    ("key", "value", "part"),
    [("c2w", [[1, 2, 3]], "3 x 4"), ("intrinsic", [[1, 0], [2]], "3 x 3"), ("time", "soon", "one finite number")],
)
def test_wrong_shape(scene, edit, key, value, part):
    edit(lambda shots: shots[0, 0].update({key: value}))
    refused(scene, "entry 0", key, part)


def test_nan_pose(scene, edit):
    edit(lambda shots: shots[0, 0]["c2w"][1].__setitem__(3, float("nan")))
    refused(scene, "entry 0", "c2w", "NaN")


def test_pose_that_is_no_rotation(scene, edit):
    def stretch(shots):
        for (view, _), shot in shots.items():
            if view == 2:
                shot["c2w"][0][0] *= 1.1

    edit(stretch)
    refused(scene, "view 2", "not orthonormal")


def test_mirrored_pose(scene, edit):
    def mirror(shots):
        for (view, _), shot in shots.items():
            if view == 2:
                shot["c2w"] = (np.array(shot["c2w"]) * [-1, 1, 1, 1]).tolist()

    edit(mirror)
    refused(scene, "view 2", "mirrored")


def test_moving_camera(scene, edit):
    edit(lambda shots: shots[3, 2]["c2w"][0].__setitem__(3, 0.5))
    refused(scene, "view 3, frame 2", "camera moves")


def test_shot_listed_twice(scene):
    path = scene / "all_data.json"
    entries = json.loads(path.read_text())
    path.write_text(json.dumps([*entries, entries[5]]))
    refused(scene, "listed twice", "entries 5 and 16")


def test_two_views_of_one_camera(scene, edit):
    def copy(shots):
        for frame in range(4):
            shots[1, frame]["c2w"] = shots[0, frame]["c2w"]

    edit(copy)
    refused(scene, "view 1", "same camera as view 0")


def test_view_without_a_frame(scene, edit):
    edit(lambda shots: shots.pop((2, 1)))
    refused(scene, "all_data.json", "view 2", "frame 1")
    assert load(scene, train_views=[0, 1], test_views=[3]).video.view_ids == (0, 1, 3)


def test_frame_missing_in_every_view(scene, edit):
    edit(lambda shots: [shots.pop((view, 2)) for view in range(4)])
    refused(scene, "all_data.json", "frame 2")
    assert load(scene, frames=2).video.frame_ids == (0, 1)


def test_missing_png_in_the_middle(scene):
    (scene / "data" / "m_1_2.png").unlink()
    refused(scene, "m_1_2.png", "missing", "data.frames")
    load(scene, frames=2)


def test_no_images(scene):
    for path in (scene / "data").iterdir():
        path.unlink()
    refused(scene, "data", "no images")


def test_truncated_png(scene):
    path = scene / "data" / "m_1_2.png"
    path.write_bytes(path.read_bytes()[:200])
    refused(scene, "m_1_2.png", "cannot be read", "again")


def test_file_that_is_no_png(scene):
    (scene / "data" / "m_1_2.png").write_bytes(b"")
    refused(scene, "m_1_2.png", "cannot be read")


def test_size_that_differs(scene):
    WHITE.resize((16, 32)).save(scene / "data" / "m_2_1.png")
    refused(scene, "m_2_1.png", "16 x 32", "32 x 32")


@pytest.mark.parametrize(
    ("row", "column", "value", "part"),
    [(0, 2, 200.0, "principal point"), (1, 2, -1.0, "principal point"), (0, 0, -50.0, "focal"), (0, 1, 3.0, "skew")],
)
def test_intrinsics_that_do_not_fit(scene, edit, row, column, value, part):
    def change(shots):
        for (view, _), shot in shots.items():
            if view == 1:
                shot["intrinsic"][row][column] = value

    edit(change)
    refused(scene, "view 1", part)


def test_times_that_do_not_increase(scene, edit):
    edit(lambda shots: [shots[view, 2].update(time=0.0) for view in range(4)])
    refused(scene, "frame 2", "do not increase")


def test_times_that_are_not_uniform(scene, edit):
    edit(lambda shots: [shots[view, 3].update(time=0.5) for view in range(4)])
    refused(scene, "frame 1", "not evenly spaced")


def test_cameras_that_are_not_synchronous(scene, edit):
    edit(lambda shots: shots[2, 1].update(time=0.06))
    refused(scene, "view 2, frame 1", "synchronous")


def test_rounded_times_pass(scene, edit):
    edit(lambda shots: [shot.update(time=round(shot["time"], 3)) for shot in shots.values()])
    assert load(scene).video.times.tolist() == pytest.approx([0.0, 0.042, 0.083, 0.125])


@pytest.mark.parametrize("key", ["train_views", "test_views"])
def test_view_that_does_not_exist_lists_those_that_do(scene, key):
    refused(scene, f"data.{key}", "view 9 does not exist", "0, 1, 2, 3", **{key: [9]})


def test_view_named_twice(scene):
    refused(scene, "data.train_views", "view 1 is named twice", train_views=[1, 1])


def test_no_training_view(scene):
    refused(scene, "data.train_views", "empty", train_views=[])


def test_view_trained_on_and_tested_is_said_aloud(scene, caplog):
    with caplog.at_level(logging.WARNING):
        load(scene, train_views=[0, 1], test_views=[1, 2])
    assert "data.test_views: 1 also" in caplog.text


@pytest.mark.parametrize("frames", [0, 5])
def test_frames_out_of_range(scene, frames):
    refused(scene, "data.frames", "1..4", frames=frames)


@pytest.mark.parametrize("scale", [0.0, 2.0])
def test_image_scale_out_of_range(scene, scale):
    refused(scene, "data.image_scale", image_scale=scale)


def test_view_that_never_shows_the_object(scene):
    for frame in range(4):
        WHITE.save(scene / "data" / f"m_1_{frame}.png")
    refused(scene, "view 1 never shows the object")
    load(scene, train_views=[0, 2])


def test_first_frame_empty(scene):
    WHITE.save(scene / "data" / "m_1_0.png")
    refused(scene, "view 1 shows no object at frame 0")


def test_black_background(scene):
    for path in (scene / "data").glob("m_1_*.png"):
        pixels = np.array(Image.open(path))
        pixels[(pixels == 255).all(-1)] = 0
        Image.fromarray(pixels).save(path)
    refused(scene, "view 1 has no background", "white")


def test_sixteen_bit_grey(scene):
    Image.fromarray(np.full((SIZE, SIZE), 65535, np.uint16)).save(scene / "data" / "m_1_2.png")
    refused(scene, "m_1_2.png", "8-bit RGB")


def test_object_may_leave_late(scene):
    WHITE.save(scene / "data" / "m_1_3.png")
    load(scene)


@pytest.mark.parametrize(
    ("corner", "parts"),
    [([-0.25, 0.9, -0.25], ("box_lower", "y = 0.9", "0.7")), ([0.0, 0.1], ("box_lower", "three finite numbers"))],
)
def test_box_that_is_none(scene, corner, parts):
    refused(scene, *parts, box_lower=corner)


def test_box_outside_all_views_names_axes_and_units(scene):
    both = {"train_views": [0, 2], "box_lower": [5, 5, 5], "box_upper": [6, 6, 6]}
    refused(scene, "no training view sees the box data.box_lower, data.box_upper = [5, 5, 5]", **both)
    refused(scene, "most likely axes or units differ: y must point up", **both)


def test_box_beside_the_object(scene):
    beside = {"box_lower": [-0.6, 0.3, -0.6], "box_upper": [-0.45, 0.4, -0.45]}
    refused(scene, "misses the object in every training view at frame 0; most likely axes or units", **beside)


def test_box_that_cuts_the_object_warns(scene, caplog):
    with caplog.at_level(logging.WARNING):
        load(scene, box_upper=[0.25, 0.42, 0.25])
    assert "of the object in view" in caplog.text and "enlarge it" in caplog.text


def test_good_box_does_not_warn(scene, caplog):
    with caplog.at_level(logging.WARNING):
        load(scene)
    assert not caplog.text


def test_raw_images_without_plate(scene):
    for path in sorted((scene / "data").glob("m_*.png")):
        path.rename(path.with_name("r" + path.name[1:]))
    refused(scene, "r_0_-1.png", "background plate")


def test_occluder_without_alpha(scene):
    WHITE.save(scene / "data" / "r_0_-2.png")
    refused(scene, "r_0_-2.png", "alpha channel")


def test_occluder_of_another_size(scene):
    Image.new("RGBA", (8, 8)).save(scene / "data" / "r_0_-2.png")
    refused(scene, "r_0_-2.png", "8 x 8")
