"""Grounds that are not level, other gravities, objects that the image cuts off, and questions on a terminal."""

import io
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.pac_nerf import read_pac_nerf
from pacnerf_lpo.data.recordings.findings import check_slope
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.data.recordings.scene_file import MARGIN
from pacnerf_lpo.errors import UserInputError
from tests.data.recordings.layouts import opencv_plates, write_json
from tests.data.recordings.studio import (
    CONTACT,
    FPS,
    FRAMES,
    NAMES,
    RADIUS,
    SIZE,
    START,
    TILTED,
    VIEWS,
    World,
    film,
    films,
    hull_bounds,
    intrinsic,
    landing_time,
    rig,
    save,
)

pytestmark = pytest.mark.slow

SLOPE = np.radians(20.0)
OPTIONS = ("--fps", str(FPS))


def transparent(root: Path, world: World, shown: np.ndarray, lowered: tuple[int, int] = (0, 0)) -> Path:
    """nerfstudio's layout with images drawn on nothing; one camera (number, rows) looks so much higher."""
    entries, k = [], intrinsic()
    for view, pose in enumerate(world.poses()):
        for f, image in enumerate(shown[view]):
            name = f"images/{NAMES[view]}/{f:03}.png"
            rows = lowered[1] * (view == lowered[0])
            save(root / name, np.pad(image, ((rows, 0), (0, 0), (0, 0)))[:SIZE])
            pose4 = [*pose.tolist(), [0, 0, 0, 1]]
            entries.append({"file_path": name, "transform_matrix": pose4, "time": f / FPS, "cy": k[1, 2] + rows})
    write_json(
        root / "transforms.json",
        {"fl_x": k[0, 0], "fl_y": k[1, 1], "cx": k[0, 2], "w": SIZE, "h": SIZE, "frames": entries},
    )
    return root


def imported(source: Path, *options: str) -> tuple[Path, dict]:
    scene = source.parent / "scene"
    assert main(["init", str(source), str(scene), *options]) == 0
    return scene, yaml.safe_load((scene / "scene.yaml").read_text())


@pytest.mark.parametrize("known", ["gravity from free fall", "gravity stated"])
def test_a_slope(tmp_path, known):
    """A ball lands on a ground of 20 degrees: the ground is y = 0, and gravity points to where it does."""
    world = World(turn=TILTED, origin=(0.3, 0.2, -0.4))
    shown = np.stack([film(view, np.arange(FRAMES), tilt=SLOPE) for view in range(VIEWS)])
    source = transparent(tmp_path / "case", world, shown)
    normal = ",".join(map(str, 3.0 * world.up))
    options = [f"--ground_normal=[{normal}]", "--format", "nerfstudio", "--unit", "m"]
    down = world.turn @ [np.sin(SLOPE), -np.cos(SLOPE), 0.0]
    up = f"[{','.join(map(str, -down))}]"
    scene, config = imported(source, *options, "--up", "fall" if known == "gravity from free fall" else up)
    gravity = np.array(config["physics"]["gravity"])
    assert np.linalg.norm(gravity) == pytest.approx(9.81, rel=1e-3)
    assert np.degrees(np.arccos(-gravity[1] / np.linalg.norm(gravity))) == pytest.approx(20.0, abs=0.5)
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == int(np.ceil(landing_time(SLOPE) * FPS))
    video, pose = read_pac_nerf(scene), np.stack(world.poses())
    turn = video.camera_to_world[0, :, :3].numpy() @ pose[0, :, :3].T
    assert np.degrees(np.arccos(min(1.0, (turn @ world.up)[1]))) < 0.5
    heights = video.camera_to_world[:, 1, 3].numpy() - np.array([p[1, 3] for p in World().poses()])
    assert np.abs(heights).max() < 3e-3
    np.testing.assert_allclose(gravity / 9.81, turn @ down, atol=0.01)


def test_a_ball_on_another_planet(write, written):
    """The same videos at 1.62 m/s^2 show a larger or a smaller world; what is stated is in the scene."""
    source, (_, world) = write("colmap_binary"), written("colmap_binary")
    _, config = imported(source, "--gravity", "1.62")
    assert np.linalg.norm(config["physics"]["gravity"]) == pytest.approx(1.62, rel=1e-3)
    size = np.subtract(config["data"]["box_upper"], config["data"]["box_lower"]).mean()
    assert size == pytest.approx(0.4 * 1.12 * 1.62 / 9.81, rel=0.1) and world.unit != 1.0


def test_a_slope_that_nobody_stated_is_doubted(caplog):
    """After contact the body slides down: its lowest point along gravity sinks."""
    check_slope(np.array([0.5, 0.2, 0.0, -0.05, -0.1]), 2, 0.4, 0.0)
    assert "may be a slope (give --ground_normal)" in caplog.text


def test_an_object_that_is_cut_off(tmp_path):
    """A camera that loses the object at the lower border of its image while it falls: nothing else changes."""
    view = int(np.argmax([np.nonzero(shown[..., 3].max(axis=(0, 2)) > 0.5)[0].max() for shown in films()]))
    source = transparent(tmp_path / "case", World(), films(), (view, 25))
    scene, config = imported(source, "--up", "y", "--unit", "m")
    text = (scene / "scene.yaml").read_text()
    assert f"camera {view}: the image cuts the object off in its frames" in text
    assert config["phases"]["velocity"]["init_args"]["hit_frame"] == CONTACT
    box = np.array([config["data"]["box_lower"], config["data"]["box_upper"]])
    expected = hull_bounds(START, RADIUS, rig()[:, :, 3])
    room = MARGIN * (expected[1] - expected[0]).max()
    np.testing.assert_allclose(box, expected + room * np.array([[-1.0], [1.0]]), atol=0.025)
    heights = read_pac_nerf(scene).camera_to_world[:, 1, 3].numpy() - np.array([p[1, 3] for p in World().poses()])
    assert np.abs(heights).max() < 3e-3


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("answers", "fps"), [("24\n", 24.0), ("fast\n\n", 30.0)])
def test_what_cannot_be_measured_is_asked(write, monkeypatch, answers, fps):
    """Frames per second, by answer and by default; a wrong answer is asked again."""
    source = write("opencv_each")
    shown = Terminal()
    monkeypatch.setattr(sys, "stdin", Terminal(answers))
    monkeypatch.setattr(sys, "stderr", shown)
    _, config = imported(source)
    assert config["physics"]["frame_rate"] == fps
    assert "How many frames per second have the videos? [30]" in shown.getvalue()
    assert shown.getvalue().count("is no answer") == answers.count("fast")


def test_scale_without_gravity_is_asked_and_given(tmp_path, write, monkeypatch, capsys):
    source = write("opencv_each")
    words = ["init", str(source), str(tmp_path / "scene"), *OPTIONS, "--gravity", "0", "--up=-x"]
    assert main(words) == 2
    assert "the scale cannot be measured" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", Terminal("cm\n"))
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert main(words) == 0
    config = yaml.safe_load((tmp_path / "scene" / "scene.yaml").read_text())
    assert config["physics"]["gravity"] == [0.0, 0.0, 0.0]


def test_wrong_answers_and_options():
    recording = Recording("x", Path("."), ())
    assert recording.with_unit("0.75").unit == 0.75 and recording.with_unit("mm").unit == 0.001
    assert recording.with_up("0,3,4").up == (0.0, 0.6, 0.8) and recording.with_up("-z").up == (0, 0, -1)
    for wrong in ("w", "0,0,0", "1,2"):
        with pytest.raises(UserInputError, match="--up"):
            recording.with_up(wrong)
    assert recording.with_up("0,3,4").up == (0.0, 0.6, 0.8) and recording.with_up("-z").up == (0, 0, -1)
    for wrong in ("w", "0,0,0", "1,2"):
        with pytest.raises(UserInputError, match="--up"):
            recording.with_up(wrong)
    for wrong in ("feet", "-1", "nan"):
        with pytest.raises(UserInputError, match="--unit"):
            recording.with_unit(wrong)
    with pytest.raises(UserInputError, match="--ground_normal"):
        recording.with_ground(None, [0.0, 1.0])


def test_the_file_says_who_stated_what(tmp_path):
    for name, options, rho, said in (
        ("all", ("--unit", "mm", "--density", "1100", "--fps", "24"), 1100, ("by --density", "s by --fps")),
        ("few", ("--unit", "mm"), 1000, ("assumed: water", "s by the times of the recording")),
    ):
        source = tmp_path / name / "studio"
        source.mkdir(parents=True)
        opencv_plates(source)
        scene, config = imported(source, *options)
        text = (scene / "scene.yaml").read_text()
        assert config["physics"]["rho"] == rho
        assert "stated by --unit" in text and all(words in text for words in said)
