"""Tangent planes, free fall and the lowest point against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from pacnerf_lpo.data.recordings.conventions import (
    pose_from_llff,
    pose_from_opencv,
    rotation_from_vector,
    rotation_onto,
)
from pacnerf_lpo.data.recordings.fall import fit_ballistic, lowest_point
from pacnerf_lpo.data.recordings.findings import find_scale
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.data.recordings.tangents import Planes, ball, bounds, outline_planes
from pacnerf_lpo.errors import UserInputError
from tests.data.recordings.studio import RADIUS, SIZE, START, VIEWS, films, intrinsic, rig

EDGE = 3.5e-3
"""A quarter of a pixel [m], 14 mm at 2.5 m: where a round outline only just enters a row of pixels, their averages
say no more."""
UP = np.array([0.0, 1.0, 0.0])
SUPPORTS = {
    "ball": lambda n, sine: np.full(len(n), 0.2),
    "torus": lambda n, sine: 0.3 * sine + 0.08,
    "flattened ball": lambda n, sine: np.sqrt((0.25 * sine) ** 2 + (0.13 * n[:, 1]) ** 2),
}
BOTTOMS = {"ball": 0.2, "torus": 0.08, "flattened ball": 0.13}


def inclined(count: int = 400) -> np.ndarray:
    """Normals that cameras 12 degrees above the horizon or higher can have: none is nearer to straight down."""
    n = np.random.default_rng(0).standard_normal((count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return n[np.abs(n[:, 1]) < np.cos(np.radians(12.0))]


def support(name: str, centre) -> Planes:
    n = inclined()
    return Planes(n, n @ np.asarray(centre) + SUPPORTS[name](n, np.sqrt(1.0 - n[:, 1] ** 2)))


@pytest.mark.parametrize("name", SUPPORTS)
def test_lowest_point_of_bodies_of_the_model(name):
    """Exact but for where the optimiser stops: its steps of 1e-8 relative to half a metre, weakly determined by 1e3."""
    assert lowest_point(support(name, (0.3, 0.7, -0.2)), UP) == pytest.approx(0.7 - BOTTOMS[name], abs=1e-4)


def test_lowest_point_needs_planes():
    few = support("ball", (0.0, 0.5, 0.0))
    assert np.isnan(lowest_point(Planes(few.normals[:5], few.offsets[:5]), UP))


def test_free_fall_is_found_exactly():
    """Planes without noise: the ridge of 1e-4 bends the shape, which is the same in all frames, and not the motion."""
    times, gravity = np.arange(5) / 24.0, np.array([1.0, -9.0, 3.0])
    path = [np.array([0.1, 0.9, 0.2]) + np.array([0.5, 0.0, -0.3]) * t + 0.5 * gravity * t**2 for t in times]
    motion = fit_ballistic([support("flattened ball", place) for place in path], times)
    np.testing.assert_allclose(motion.acceleration, gravity, atol=1e-6)
    np.testing.assert_allclose(motion.at(times) - motion.start, np.array(path) - path[0], atol=1e-6)


def test_outlines_give_planes_that_touch_the_ball():
    """Within EDGE of the radius."""
    for view, pose in enumerate(rig()):
        planes = outline_planes(films()[view, 0, ..., 3], intrinsic(), pose)
        np.testing.assert_allclose(planes.offsets - planes.normals @ START, RADIUS, atol=EDGE)


def test_box_and_ball_of_all_views():
    planes = Planes.of([outline_planes(films()[view, 0, ..., 3], intrinsic(), rig()[view]) for view in range(VIEWS)])
    lower, upper = bounds(planes)
    assert np.all(lower <= START - RADIUS + EDGE) and np.all(upper >= START + RADIUS - EDGE)
    centre, radius = ball(planes)
    assert radius == pytest.approx(RADIUS, abs=EDGE) and np.linalg.norm(centre - START) < EDGE


def test_an_outline_cut_off_at_the_border_gives_the_planes_of_the_rest():
    opacity = films()[0, 0, ..., 3].copy()
    middle = int(np.nonzero(opacity.max(axis=0) > 0.5)[0].mean())
    cut, shifted = opacity[:, : middle + 1], intrinsic()
    planes = outline_planes(cut, shifted, rig()[0])
    assert 0 < len(planes.offsets) < len(outline_planes(opacity, shifted, rig()[0]).offsets)
    np.testing.assert_allclose(planes.offsets - planes.normals @ START, RADIUS, atol=EDGE)


def test_nothing_seen_gives_no_planes():
    assert len(outline_planes(np.zeros((SIZE, SIZE)), intrinsic(), rig()[0]).offsets) == 0


@pytest.mark.parametrize("source", [(0, 0, 1), (0, -1, 0), (0.6, 0.0, 0.8), (0, 1, 0)])
def test_rotation_onto(source):
    turn = rotation_onto(np.array(source, float), UP)
    np.testing.assert_allclose(turn @ source, UP, atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_point_in_front_of_an_opencv_camera_projects_alike():
    """OpenCV: x = R X + t, to the right and down; the pose found sees the same point to the right and up, at -z."""
    rotation, translation = rotation_from_vector(np.array([0.3, -0.5, 0.2])), np.array([0.1, 0.2, 3.0])
    point = np.array([0.4, -0.3, 0.2])
    pose = pose_from_opencv(rotation, translation)
    own = pose[:, :3].T @ (point - pose[:, 3])
    np.testing.assert_allclose(own * [1, -1, -1], rotation @ point + translation, atol=1e-12)


def test_llff_columns():
    down, right, back, centre = np.array([0, -1, 0]), np.array([1, 0, 0]), np.array([0, 0, 1]), np.array([5, 6, 7])
    pose = pose_from_llff(np.column_stack((down, right, back, centre)))
    np.testing.assert_array_equal(pose, np.column_stack((np.eye(3), centre)))


def falling(acceleration: float, **known) -> tuple[float, str]:
    """Scale and reason for a body that falls so fast, in units per s^2 along -y."""
    times = np.arange(6) / 24.0
    places = [np.array([0.0, 900.0 - 0.5 * acceleration * t**2, 0.0]) for t in times]
    n = inclined()
    planes = [Planes(n, n @ place + 200.0) for place in places]
    return find_scale(Recording("x", Path("."), (), **known), fit_ballistic(planes, times))


def test_a_unit_is_recognised_although_drag_slows_the_fall():
    """A board was measured in a unit that people use; a scale of COLMAP's is anything, so only gravity says it."""
    assert falling(9810.0)[0] == 0.001
    scale, why = falling(6700.0, metric=True)
    assert scale == 0.001 and "6.7 m/s^2" in why
    scale, why = falling(6700.0)
    assert scale == pytest.approx(9.81 / 6700.0, rel=1e-6) and "drag, would pass for scale" in why


def test_a_stated_unit_that_gravity_contradicts_is_refused():
    with pytest.raises(UserInputError, match="with --unit mm"):
        falling(9810.0, unit=1.0)
    assert falling(9810.0, unit=0.0015)[0] == 0.0015
