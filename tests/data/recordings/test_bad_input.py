"""What is wrong with a recording is named: one line with file or camera, and an option or a remedy."""

import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.recordings.layouts import read_recording
from pacnerf_lpo.errors import UserInputError
from tests.data.recordings.layouts import write_json
from tests.data.recordings.studio import FRAMES, NAMES, SIZE, background, raw, save

pytestmark = pytest.mark.slow


def refused(capsys, source: Path, *options) -> str:
    """The one line of ``init``; nothing is left behind but mattes that it names."""
    scene = source.parent / "scene"
    assert main(["init", str(source), str(scene), *map(str, options)]) == 2
    line = capsys.readouterr().err.strip().splitlines()[-1]
    left, mattes = {path.name for path in source.parent.iterdir()}, scene.with_name("scene_mattes")
    assert left == {source.name, mattes.name} if str(mattes) in line else left == {source.name}
    return line


@pytest.fixture
def spoil(write):
    """The shared OpenCV calibration after a change of its cameras."""

    def make(change) -> Path:
        folder = write("opencv_plates")
        path = folder / "calibration.json"
        cameras = json.loads(path.read_text())
        change(cameras)
        write_json(path, cameras)
        return folder

    return make


def each(change):
    return lambda cameras: [change(camera) for camera in cameras.values()]


def test_no_folder_and_no_layout(tmp_path, capsys):
    source = tmp_path / "case" / "films"
    source.parent.mkdir()
    with pytest.raises(UserInputError, match="no such folder"):
        read_recording(source)
    source.mkdir()
    (source / "notes.txt").write_text("")
    said = refused(capsys, source)
    assert "transforms.json" in said and "poses_bounds.npy" in said and "There lies: notes.txt" in said


def test_two_layouts(write, capsys):
    folder = write("dynerf")
    write_json(folder / "transforms.json", {})
    said = refused(capsys, folder)
    assert "nerfstudio (transforms.json)" in said and "dynerf" in said and "--format" in said


def test_another_format_than_there_is(write, capsys):
    assert "transforms.json: missing" in refused(capsys, write("opencv_plates"), "--format", "nerfstudio")


def test_transposed_rotations(spoil, capsys):
    def transpose(camera):
        camera["R"] = np.array(camera["R"]).T.tolist()

    assert "transposed" in refused(capsys, spoil(each(transpose)))


def test_poses_the_other_way_round(spoil, capsys):
    def invert(camera):
        rotation = np.array(camera["R"])
        camera["R"], camera["t"] = rotation.T.tolist(), (-rotation.T @ camera["t"]).tolist()

    said = refused(capsys, spoil(each(invert)))
    assert "world to camera instead of camera to world" in said or "disagrees with the other views" in said


def test_mirrored_axis(spoil, capsys):
    def mirror(camera):
        camera["R"] = (np.array(camera["R"]) * [1, 1, -1]).tolist()

    assert "mirrored (determinant -1)" in refused(capsys, spoil(each(mirror)))


def test_scaled_rotation(spoil, capsys):
    def scale(camera):
        camera["R"] = (1.1 * np.array(camera["R"])).tolist()

    assert "camera left: its rotation is not orthonormal" in refused(capsys, spoil(each(scale)))


def test_swapped_cameras(spoil, capsys):
    def swap(cameras):
        cameras["left"], cameras["door"] = cameras["door"], cameras["left"]

    said = refused(capsys, spoil(swap))
    assert "disagrees" in said or "swapped" in said


def test_one_wrong_pose_is_named(spoil, capsys):
    def move(cameras):
        cameras["front"]["t"][0] += 150.0  # millimetres, on a body of 400

    said = refused(capsys, spoil(move))
    assert "camera front disagrees with the other views" in said and "--leave_out front" in said


def test_millimetres_taken_for_metres(write, capsys):
    said = refused(capsys, write("opencv_plates"), "--unit", "m")
    in_metres, in_millimetres = (float(x) for x in re.findall(r"the body falls at (\S+)", said))
    assert "with 1 m per unit" in said and in_metres == pytest.approx(
        9.81e3, rel=5e-3
    )  # as measured, to half a percent
    assert "with --unit mm" in said and in_millimetres == pytest.approx(9.81, rel=5e-3)


def test_upside_down(write, capsys):
    assert "falls against the stated up direction (0, 0, -1); give --up" in refused(
        capsys, write("opencv_plates"), "--up=-z"
    )


def test_size_that_the_calibration_does_not_have(spoil, capsys):
    def larger(camera):
        camera["image_width"] = camera["image_height"] = 2 * SIZE

    said = refused(capsys, spoil(each(larger)))
    assert f"{SIZE} x {SIZE} pixels, but camera left was calibrated for {2 * SIZE} x {2 * SIZE}" in said


def test_intrinsics_of_another_size(spoil, capsys):
    def larger(camera):
        camera["K"] = (np.diag([2, 2, 1]) @ camera["K"]).tolist()
        del camera["image_width"], camera["image_height"]

    assert "do not fit the intrinsics of camera left" in refused(capsys, spoil(each(larger)))


def test_transposed_intrinsics(spoil, capsys):
    def transpose(camera):
        camera["K"] = np.array(camera["K"]).T.tolist()

    assert "they may be transposed" in refused(capsys, spoil(each(transpose)))


def test_missing_key_and_wrong_count(spoil, capsys):
    assert "camera left: 't' is missing" in refused(capsys, spoil(each(lambda camera: camera.pop("t"))))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"dist": ["a", 0, 0, 0]}, "camera left, distortion: expected 4 numbers"),
        ({"size": ["wide", 64]}, "camera left, size: expected 2 numbers"),
        ({"K": "here"}, "camera left, K: expected 3 x 3 numbers"),
    ],
)
def test_words_in_place_of_numbers(spoil, capsys, change, expected):
    assert expected in refused(capsys, spoil(each(lambda camera: camera.update(change))))


@pytest.mark.parametrize(
    ("layout", "file", "key", "value", "expected"),
    [
        ("nerfstudio", "transforms.json", "fl_x", "long", "'fl_x' is 'long'; give one finite number"),
        ("nerfstudio", "transforms.json", "k1", [0.1], "'k1' is [0.1]; give one finite number"),
        ("d_nerf", "transforms_train.json", "camera_angle_x", None, "'camera_angle_x' is None; give one finite number"),
        ("phystwin", "metadata.json", "fps", 0, "'fps' is 0; give the frames per second, a positive number"),
    ],
)
def test_what_is_no_number_is_named(write, capsys, layout, file, key, value, expected):
    folder = write(layout)
    values = json.loads((folder / file).read_text())
    write_json(folder / file, {**values, key: value})
    assert expected in refused(capsys, folder)


def test_wrong_number_of_coefficients(spoil, capsys):
    assert "3 distortion coefficients" in refused(capsys, spoil(each(lambda camera: camera.update(dist=[0.1, 0, 0]))))


def test_missing_and_damaged_videos(write, capsys):
    folder = write("opencv_plates")
    video = folder / "top.mp4"
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    assert "top.mp4: the video is damaged" in refused(capsys, folder)
    video.unlink()
    assert "no video and no folder named top" in refused(capsys, folder)


def test_a_single_view_and_an_unknown_camera(write, capsys):
    folder = write("opencv_plates")
    assert "there is no such camera" in refused(capsys, folder, "--leave_out", "attic")
    cameras = json.loads((folder / "calibration.json").read_text())
    write_json(folder / "calibration.json", {"left": cameras["left"]})
    assert "1 camera with images (left)" in refused(capsys, folder)


def test_a_pickle_that_would_run_code(write, capsys):
    folder = write("phystwin")
    ran = folder / "ran"

    class Evil:
        def __reduce__(self):
            return Path.touch, (ran,)

    (folder / "calibrate.pkl").write_bytes(pickle.dumps([Evil()]))
    assert "refused, only arrays and numbers are read from a pickle" in refused(capsys, folder)
    assert not ran.exists()
    (folder / "calibrate.pkl").write_bytes(b"\x80\x04nonsense")
    assert "calibrate.pkl" in refused(capsys, folder)


def test_masks_inverted_and_too_few(write, capsys):
    folder = write("opencv_each")
    masks = folder / "masks" / NAMES[0]
    for frame in range(FRAMES):
        save(masks / f"{frame}.png", np.ones((SIZE, SIZE)))
    assert "invert the masks" in refused(capsys, folder, "--fps", 24)
    (masks / "0.png").unlink()
    assert f"{FRAMES - 1} masks for {FRAMES} frames" in refused(capsys, folder, "--fps", 24)


def test_no_times(write, capsys):
    assert "give the frames per second by --fps" in refused(capsys, write("opencv_each"))


def test_damaged_colmap_model(write, capsys):
    folder = write("colmap_binary")
    path = folder / "sparse/0/images.bin"
    path.write_bytes(path.read_bytes()[:50])
    assert "a damaged COLMAP model" in refused(capsys, folder)


def test_an_object_that_hides_its_own_background_is_noticed(write, capsys):
    """In camera 3 the object leaves only half of its place: the matte keeps a ghost, and the other views say so."""
    folder = write("phystwin")
    for frame in range(FRAMES):
        image = raw()[3, frame].copy()
        image[20:45, 30:70] = [0.8, 0.3, 0.1] if frame < 8 else image[20:45, 30:70]
        save(folder / "color/3" / f"{frame}.png", image)
    assert "camera 3 disagrees with the other views" in refused(capsys, folder)


def test_nothing_moves(write, capsys):
    folder = write("phystwin")
    for frame in range(FRAMES):
        save(folder / "color/2" / f"{frame}.png", background(2))
    assert "nothing moves in camera 2" in refused(capsys, folder)


def test_no_contact(write, capsys):
    """The first five frames, all in the air."""
    folder = write("opencv_each")
    for path in folder.rglob("*.png"):
        if int(path.stem) > 4:
            path.unlink()
    assert "is not seen to fall onto a ground" in refused(capsys, folder, "--fps", 24)


def test_a_moving_camera(write, capsys):
    folder = write("nerfstudio")
    values = json.loads((folder / "transforms.json").read_text())
    for number, frame in enumerate(values["frames"]):
        frame["transform_matrix"][0][3] += 0.01 * number
    write_json(folder / "transforms.json", values)
    assert "the camera moves" in refused(capsys, folder)


def test_a_folder_in_use_is_left_alone(write, capsys, tmp_path):
    folder = write("pac_nerf")
    used = tmp_path / "used"
    used.mkdir()
    (used / "mine.txt").write_text("mine")
    assert main(["init", str(folder), str(used)]) == 2
    assert "not empty" in capsys.readouterr().err
    assert [path.name for path in used.iterdir()] == ["mine.txt"]


def test_options_override(made, tmp_path):
    """Stated unit, axis, ground and frame rate are taken, and the scene file says so."""
    source, scene = made("opencv_plates").source, tmp_path / "scene"
    words = ["--unit", "mm", "--up", "z", "--ground", "800", "--leave_out", "top", "door", "--fps", "24"]
    assert main(["init", str(source), str(scene), *words]) == 0
    text = (scene / "scene.yaml").read_text()
    assert "up: z of the calibration: stated by --up" in text and "0.001 m: stated by --unit" in text
    assert "ground: stated by --ground; 800 along z" in text and "ground_error" not in text
    assert (
        "door" not in text and len({e["file_path"][9] for e in json.loads((scene / "all_data.json").read_text())}) == 4
    )
    assert yaml.safe_load(text)["phases"] == made("opencv_plates").config["phases"]
