"""Positions in every layout, and what ``init`` makes of them."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from plyfile import PlyData, PlyElement

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.trajectories.scene import read_scene, scenes_in
from pacnerf_lpo.data.trajectories.tables import read_table
from pacnerf_lpo.errors import UserInputError
from tests.data.trajectories.throws import BALL, flight, write, write_drops, write_throws

pytestmark = pytest.mark.slow

TIMES = np.arange(0.0, 0.4, 0.01)
PATH = flight(TIMES, (0.1, 1.5, -0.2), (1.0, 2.0, 3.0))


def init(source: Path, scene: Path, *options: str) -> None:
    assert main(["init", str(source), str(scene), *BALL, *options]) == 0


def refused(capsys: pytest.CaptureFixture, source: Path, *parts: str, options: tuple[str, ...] = BALL) -> None:
    """One line that names what is wrong, and no scene."""
    scene = source.parent / "refused"
    assert main(["init", str(source), str(scene), *options]) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said, said
    for part in parts:
        assert part in said, said
    assert not scene.exists()


def columns(positions: np.ndarray, times: np.ndarray = TIMES) -> dict[str, np.ndarray]:
    return {"time_s": times, **dict(zip(("x_m", "y_m", "z_m"), positions.T, strict=True))}


def test_every_layout_of_one_flight_becomes_the_same_scene(tmp_path):
    """Long; bare and z up; DeepLabCut and Anipose in millimetres with frame numbers; clouds. Files have 7 digits."""
    x, y, z = PATH.T
    sources = {"long": (write(tmp_path / "long.csv", columns(PATH)), ())}
    bare = tmp_path / "bare.csv"
    np.savetxt(bare, np.column_stack((TIMES, x, -z, y)), delimiter=";", fmt="%.7f")
    sources["bare"] = (bare, ())
    wide = tmp_path / "wide.csv"
    rows = [["scorer", *["net"] * 3], ["bodyparts", *["ball"] * 3], ["coords", "x", "y", "z"]]
    rows += [[str(k), *(f"{1000 * value:.5f}" for value in p)] for k, p in enumerate(PATH)]
    wide.write_text("\n".join(",".join(row) for row in rows))
    sources["wide"] = (wide, ("--fps", "100", "--unit", "mm"))
    frames = {"ball_x": 1000 * x, "ball_y": 1000 * y, "ball_z": 1000 * z, "ball_error": 0 * x}
    anipose = write(tmp_path / "anipose.csv", {**frames, "fnum": np.arange(len(TIMES))})
    sources["anipose"] = (anipose, ("--fps", "100", "--unit", "mm"))
    (tmp_path / "clouds").mkdir()
    shell = 0.02 * np.concatenate((np.eye(3), -np.eye(3)))
    for number, centre in enumerate(PATH):
        vertices = np.array([tuple(p) for p in centre + shell], dtype=[(axis, "f8") for axis in "xyz"])
        PlyData([PlyElement.describe(vertices, "vertex")]).write(str(tmp_path / "clouds" / f"cloud_{number:03d}.ply"))
    sources["clouds"] = (tmp_path / "clouds", ("--fps", "100"))
    for name, (source, options) in sources.items():
        init(source, tmp_path / f"{name}_scene", *options)
        scene = read_scene(tmp_path / f"{name}_scene")
        np.testing.assert_allclose(scene.one.positions, PATH, atol=2e-6, err_msg=name)
        np.testing.assert_allclose(scene.one.times, TIMES, atol=1e-6, err_msg=name)
        assert not scene.held, name


def test_markers_of_a_c3d_file_are_read_in_its_own_unit(tmp_path):
    c3d = pytest.importorskip("c3d")
    writer = c3d.Writer(point_rate=100.0)
    marks = np.array([[20.0, 0.0, 0.0], [-20.0, 0.0, 0.0]])
    for centre in PATH:
        points = np.concatenate((1000 * centre + marks, np.zeros((2, 2))), axis=1)
        writer.add_frames([(points, np.zeros((0, 0)))])
    writer.set_point_labels(["left", "right"])
    writer.point_group.add_str("UNITS", "unit", "mm") if "UNITS" not in writer.point_group else None
    with (tmp_path / "throw.c3d").open("wb") as file:
        writer.write(file)
    init(tmp_path / "throw.c3d", tmp_path / "scene", "--unit", "mm")
    np.testing.assert_allclose(read_scene(tmp_path / "scene").one.positions, PATH, atol=1e-4)  # float32 of 1.5 m in mm


def test_drops_in_one_file_are_released_late_and_lack_two_coordinates(tmp_path):
    init(write_drops(tmp_path / "ball.csv", drag=0.02), tmp_path / "scene")
    folders = scenes_in(tmp_path / "scene")
    assert [folder.name for folder in folders] == ["ball_1", "ball_2"]
    for folder, release in zip(folders, (0.21, 0.12), strict=True):
        scene = read_scene(folder)
        assert scene.held
        assert scene.guess["release"] == pytest.approx(release, abs=0.07)  # a sample
        assert [noise is None for noise in scene.noise] == [True, False, True]
        assert scene.noise[1] is not None and scene.noise[1].white == pytest.approx(0.01, rel=0.4)


def test_a_flight_ends_before_its_bounce_and_has_its_own_spin(tmp_path):
    spins = write_throws(tmp_path / "throws", 6, drag=0.15, magnus=0.0)
    rise = flight(TIMES, (0.0, 0.0, 2.0), (0.0, 2.5, 3.0))
    fall = flight(np.arange(0.0, 0.3, 0.01), (0.0, 0.6, 0.8), (0.0, -1.0, 4.0))
    last = int(np.argmax(fall[:, 1] < 0))
    both = 1000 * np.concatenate((fall[:last], rise))
    times = np.arange(len(both)) * 0.01
    write(tmp_path / "throws" / "000.csv", {"t": times, "x_mm": both[:, 0], "y_mm": -both[:, 2], "z_mm": both[:, 1]})
    init(tmp_path / "throws", tmp_path / "scene", "--spins", str(spins))
    scenes = [read_scene(folder) for folder in scenes_in(tmp_path / "scene")]
    assert scenes[0].one.times[-1] == pytest.approx(0.01 * last, abs=0.021)
    row = np.loadtxt(spins, delimiter=",", skiprows=1)[3]
    np.testing.assert_allclose(scenes[3].one.spin, [row[1], row[3], -row[2]], rtol=1e-4)


def test_gaps_stay_gaps(tmp_path):
    holes = PATH.copy()
    holes[5:9] = np.nan
    holes[20, 0] = np.nan
    init(write(tmp_path / "gaps.csv", columns(holes)), tmp_path / "scene")
    np.testing.assert_allclose(read_scene(tmp_path / "scene").one.positions, holes, atol=2e-6)


def test_wrong_positions_are_named_in_one_line(tmp_path, capsys):
    good, csv = columns(PATH), tmp_path / "points.csv"
    back = TIMES.copy()
    back[[10, 11]] = back[[11, 10]]
    refused(capsys, write(csv, columns(PATH, back)), "times go back", "sort")
    twice = TIMES.copy()
    twice[11] = twice[10]
    refused(capsys, write(csv, columns(PATH, twice)), "two positions are at 0.1 s", "recording")
    refused(capsys, write(csv, columns(1000 * PATH)), "9.81e+03 m/s^2", "--unit mm")
    refused(
        capsys, write(csv, {"clock": TIMES, **{k: v for k, v in good.items() if k != "time_s"}}), "no column is a time"
    )
    refused(capsys, write(csv, {"time_s": TIMES, "left": PATH[:, 0]}), "no column is a coordinate", "left")
    refused(capsys, write(csv, columns(PATH[:5], TIMES[:5])), "5 positions", "at least 8")
    refused(capsys, write(csv, good), "--mass missing", options=BALL[:4])
    refused(capsys, write(csv, good), "mass = -1", options=(*BALL[:5], "-1"))
    refused(capsys, write(csv, good), "its three edges", options=("--shape", "Block", *BALL[2:]))
    text = csv.read_text().replace("\n0.1,", "\nsoon,")
    csv.write_text(text)
    refused(capsys, csv, "line 12", "'soon' is not a number")
    csv.write_text("")
    refused(capsys, csv, "is empty")


def test_a_cloud_needs_a_time_that_is_a_number(tmp_path, capsys):
    (folder := tmp_path / "clouds").mkdir()
    points = PlyElement.describe(np.zeros(3, [(axis, "f4") for axis in "xyz"]), "vertex")
    PlyData([points], comments=["time_s late"]).write(str(folder / "cloud_1.ply"))
    refused(capsys, folder, "cloud_1.ply", "does not read 'comment time_s <number>'")
    PlyData([points]).write(str(folder / "cloud_1.ply"))
    refused(capsys, folder, "cloud_1.ply", "says no time; give --fps", options=(*BALL, "--fps", "0"))


def test_the_scene_file_says_where_values_come_from_and_what_is_wrong_in_it(tmp_path):
    init(write(tmp_path / "throw.csv", columns(PATH)), tmp_path / "scene")
    path = tmp_path / "scene" / "scene.yaml"
    content = yaml.safe_load(path.read_text())
    for line in ("# up: y, the axis against which bodies fall", "# measured: x, y, z in 40 samples"):
        assert line in path.read_text()
    content["flight"].pop("mass")
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ValueError, match=r"scene\.yaml: flight cannot be read \('mass'\)"):
        read_scene(tmp_path / "scene")


@pytest.mark.parametrize("names", [["ball"], ["ball", "bat"]])
def test_a_file_that_follows_several_bodies_is_refused(tmp_path: Path, names: list[str]):
    """DeepLabCut's header of four rows; columns of the last body would take the place of the others."""
    path, wide = tmp_path / "wide.csv", 3 * len(names)
    rows = [["scorer", *["net"] * wide], ["individuals", *(name for name in names for _ in range(3))]]
    rows += [["bodyparts", *["centre"] * wide], ["coords", *["x", "y", "z"] * len(names)]]
    rows += [[str(k), *(f"{value:.5f}" for value in [*p] * len(names))] for k, p in enumerate(PATH)]
    path.write_text("\n".join(",".join(row) for row in rows))
    if len(names) == 1:
        (found,) = read_table(path, fps=100.0)
        assert found.positions.shape[0] == len(PATH)
        return
    with pytest.raises(UserInputError, match=r"follows 2 bodies \(ball, bat\)"):
        read_table(path, fps=100.0)
