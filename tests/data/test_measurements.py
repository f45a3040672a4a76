"""Tracked points and point clouds: reading, refusing, and comparing with particles."""

from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pacnerf_lpo.data.measurements import read_point_clouds, read_tracked_points
from pacnerf_lpo.data.point_residuals import CLOUD_KINDS, attach, cloud_residuals, cloud_sigma, track_residuals
from pacnerf_lpo.errors import UserInputError

TIMES = np.arange(13) / 24
HEADER = "time_s,id,x_m,y_m,z_m"


def motion(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """A body that falls, turns about z and is stretched along x: affine in space, smooth in time (F, N, 3)."""
    frames = []
    for t in times:
        turn = np.array([[np.cos(3 * t), -np.sin(3 * t), 0], [np.sin(3 * t), np.cos(3 * t), 0], [0, 0, 1]])
        frames.append(points * [1 + 0.2 * t, 1, 1] @ turn.T + [0.5 * t, 1 - 4.9 * t**2, 0])
    return np.array(frames)


def ball(count: int = 3000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal((count, 3))
    return 0.1 * rng.random((count, 1)) ** (1 / 3) * direction / np.linalg.norm(direction, axis=1, keepdims=True)


def write_tracks(path: Path, times: np.ndarray, points: np.ndarray, noise: float = 0.0, header: str = HEADER) -> Path:
    rng = np.random.default_rng(1)
    rows = [header]
    for time, frame in zip(times, motion(points, times), strict=True):
        for name, point in enumerate(frame + noise * rng.standard_normal(frame.shape)):
            rows.append(f"{time:.6f},p{name}," + ",".join(f"{value:.7f}" for value in point))
    path.write_text("\n".join(rows) + "\n")
    return path


def write_cloud(path: Path, points: np.ndarray, comments: tuple[str, ...] = ()) -> None:
    vertices = np.empty(len(points), dtype=[(axis, "f4") for axis in "xyz"])
    for column, axis in enumerate("xyz"):
        vertices[axis] = points[:, column]
    PlyData([PlyElement.describe(vertices, "vertex")], comments=list(comments)).write(str(path))


def refused(reader, path: Path, *parts: str) -> None:
    with pytest.raises(UserInputError) as error:
        reader(path, TIMES)
    message = str(error.value)
    assert "\n" not in message and len(message) < 400
    for part in (path.name, *parts):
        assert part in message


def test_tracks_of_an_affine_motion_leave_no_residual(tmp_path):
    """Tracked between the frames, from the surface; what is left is the cubic spline's error, h^4 x''''/384 * 5."""
    marks = 0.1 * np.eye(3)
    tracks = read_tracked_points(write_tracks(tmp_path / "t.csv", np.linspace(0.01, 0.49, 20), marks), TIMES)
    trajectory = motion(ball(), TIMES)
    found = track_residuals(tracks, attach(tracks, trajectory, TIMES), trajectory, TIMES)
    spline = 5 / 384 * (1 / 24) ** 4 * 0.12 * 3**4 * 10  # x'''' <= 0.12 m 3^4; ten times that at the natural ends
    assert found.residual.shape == (3 * 19, 3)
    assert np.abs(found.residual).max() < spline + 1e-6  # the file has seven digits


def test_a_shift_after_first_sight_is_the_residual(tmp_path):
    tracks = read_tracked_points(write_tracks(tmp_path / "t.csv", TIMES, 0.08 * np.eye(3)), TIMES)
    trajectory = motion(ball(), TIMES)
    late = trajectory + 0.01 * TIMES[:, None, None] * np.array([1.0, 0, 0])
    found = track_residuals(tracks, attach(tracks, trajectory, TIMES), late, TIMES)
    np.testing.assert_allclose(found.residual[:, 0], -0.01 * found.times, atol=1e-5)
    np.testing.assert_allclose(found.residual[:, 1:], 0.0, atol=1e-5)


def test_noise_is_estimated_where_it_is_not_given(tmp_path):
    noisy = write_tracks(tmp_path / "t.csv", TIMES, ball(40), noise=2e-3)
    sigma = read_tracked_points(noisy, TIMES).sigma
    assert sigma[0] == pytest.approx(2e-3, rel=0.15)  # 1200 correlated differences: 5 % and a little


def test_sigma_column_is_read_and_rows_are_sorted(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(f"id,{HEADER.replace(',id', '')},sigma_m\na,0.2,1,2,3,0.004\n\na,0.1,1,2,3,0.002\n")
    tracks = read_tracked_points(path, TIMES)
    assert tracks.times.tolist() == [0.1, 0.2] and tracks.sigma.tolist() == [0.002, 0.004]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("is empty",)),
        (HEADER, ("no row",)),
        ("time_s,id,x_m,y_m,z\n0,a,1,1,1", ("z_m is missing", "'z'")),
        (f"{HEADER}\n0,a,1,nan,1", ("line 2", "y_m is nan")),
        (f"{HEADER}\n0,a,1,1,1\n0.1,a,1,,1", ("line 3", "y_m is empty")),
        (f"{HEADER}\n0,a,1,1,one", ("line 2", "z_m 'one'")),
        (f"{HEADER}\n0,a,1,420,1", ("line 2", "divide millimetres")),
        (f"{HEADER}\n0,a,1,1,1\n9,a,1,1,1", ("line 3", "outside the video")),
        (f"{HEADER}\n0,a,1,1,1\n0,a,1,1,2", ("line 3", "also in line 2")),
        (f"{HEADER}\n0,a,1,1,1\n0.1,b,1,1,1", ("no id occurs twice",)),
        (f"{HEADER},sigma_m\n0,a,1,1,1,-0.1\n0.1,a,1,1,1,0.1", ("line 2", "sigma_m", "positive")),
    ],
)
def test_bad_tracks_are_refused(tmp_path, text, parts):
    (tmp_path / "points.csv").write_text(text)
    refused(read_tracked_points, tmp_path / "points.csv", *parts)


def test_a_point_away_from_the_body_is_refused(tmp_path):
    tracks = read_tracked_points(write_tracks(tmp_path / "t.csv", TIMES, np.array([[0.5, 0, 0]])), TIMES)
    with pytest.raises(UserInputError, match=r"t\.csv: id p0 is first seen 0\.4.* m away"):
        attach(tracks, motion(ball(), TIMES), TIMES)


def test_clouds_of_the_model_agree_and_a_shift_is_seen(tmp_path):
    """Clouds of other points of the same body, shifted along x after the first."""
    shift = {0: 0.0, 4: 0.01, 8: 0.02}
    for frame, x in shift.items():
        write_cloud(
            tmp_path / f"cloud_{frame:03d}.ply", motion(ball(1500, seed=5 + frame), TIMES[[frame]])[0] + [x, 0, 0]
        )
    clouds = read_point_clouds(tmp_path, TIMES)
    trajectory = motion(ball(6000), TIMES)
    residual, sigma = cloud_residuals(clouds, trajectory, TIMES), cloud_sigma(clouds, trajectory[3])
    assert residual.shape == sigma.shape == (3, len(CLOUD_KINDS))
    along_x = np.isin(CLOUD_KINDS, ("cloud x", "cloud low x", "cloud high x"))
    z = (residual - np.outer(list(shift.values()), along_x)) / np.hypot(sigma, sigma[0])
    assert (residual[0] == 0).all() and np.abs(z[:, :-1]).max() < 5  # 30 values, sigma from 24 resamples
    assert (residual[1:, 0] / sigma[1:, 0] > 3).all()


def test_clouds_of_a_surface_are_compared_with_the_surface(tmp_path):
    """The body is stretched along x by 6 % a frame: its surface spreads by sqrt(5 / 3) as much as the volume does."""
    grown = np.array([ball(6000) * [1 + 0.06 * frame, 1, 1] for frame in range(5)])
    for frame in (0, 4):
        direction = np.random.default_rng(frame).standard_normal((3000, 3))
        sphere = 0.1 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        write_cloud(tmp_path / f"cloud_{frame:03d}.ply", sphere * [1 + 0.06 * frame, 1, 1])
    clouds = read_point_clouds(tmp_path, TIMES[:5])
    residual, sigma = cloud_residuals(clouds, grown, TIMES[:5]), cloud_sigma(clouds, grown[0])
    spread = CLOUD_KINDS.index("cloud spread xx")
    assert abs(residual[1, spread]) < 4 * np.hypot(*sigma[:, spread])
    # with particles of the volume it would be 0.24 * 0.1 m (1 / sqrt 3 - 1 / sqrt 5) = 3.1 mm
    assert 4 * np.hypot(*sigma[:, spread]) < 3.1e-3


def test_headers_may_give_time_and_sigma(tmp_path):
    write_cloud(tmp_path / "cloud_000.ply", ball(), ("time_s 0.125", "sigma_m 0.002"))
    clouds = read_point_clouds(tmp_path, TIMES)
    assert clouds.times.tolist() == [0.125] and clouds.sigma.tolist() == [0.002]


def test_bad_clouds_are_refused(tmp_path):
    refused(read_point_clouds, tmp_path / "none", "no such folder")
    refused(read_point_clouds, tmp_path, "cloud_000.ply")
    path = tmp_path / "cloud_000.ply"
    for points, part in (
        (ball(5), "5 points"),
        (ball() * 1e4, "divide millimetres"),
        (np.where(np.arange(9000).reshape(-1, 3) == 30, np.nan, ball()), "vertex 10 holds NaN"),
    ):
        write_cloud(path, points)
        refused(read_point_clouds, tmp_path, path.name, part)
    path.write_text("ply?")
    refused(read_point_clouds, tmp_path, path.name, "no PLY")
    write_cloud(path, ball(), ("time_s soon",))
    refused(read_point_clouds, tmp_path, "time_s soon")
    path.unlink()
    write_cloud(tmp_path / "cloud_020.ply", ball())
    refused(read_point_clouds, tmp_path, "cloud_020.ply", "frames 0 to 12")
