"""Tracked points and clouds in a diagnosis: a ball in flight whose drag is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from pacnerf_lpo.data.measurements import PointClouds, TrackedPoints
from pacnerf_lpo.data.point_residuals import CLOUD_KINDS
from pacnerf_lpo.data.synthetic import hemisphere_rig
from pacnerf_lpo.diagnosis.catalogue import whole_catalogue
from pacnerf_lpo.diagnosis.comparison import compare
from pacnerf_lpo.diagnosis.refitting import refit
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.points import Points
from pacnerf_lpo.identification.problem import BodyProblem, independent, relative
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.types import Video
from tests.diagnosis.examples import screened

FRAMES, SIZE, SPACING, RADIUS, PIXEL = 10, 24, 0.08, 0.15, 0.01
TIMES = np.arange(FRAMES) / 24
CENTRE, VELOCITY, DRAG, GRAVITY = np.array([0.0, 2.0, 0.0]), np.array([2.0, 0.5, 0.0]), 1.5, -9.8
SIGMA = 1e-3
GUESS = {"E": 1e5, "nu": 0.3, "ground_height": 0.0, "v_x": 1.5, "v_y": 0.5, "v_z": 0.0}
MARKS = CENTRE + RADIUS * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def flight(points: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Points of a body that flies without turning, v' = g - k v [m, (F, N, 3)]."""
    t, fall = times[:, None], np.array([0.0, GRAVITY / DRAG, 0.0])
    moved = fall * t + (VELOCITY - fall) * (1 - np.exp(-DRAG * t)) / DRAG
    return points + moved[:, None]


def lattice(spacing: float, shift: float = 0.0) -> np.ndarray:
    axis = np.arange(-RADIUS, RADIUS, spacing / 2) + shift + spacing / 4
    points = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)
    return points[np.linalg.norm(points, axis=1) < RADIUS] + CENTRE


def tracked(rate: float = 24.0) -> TrackedPoints:
    times = np.arange(0, TIMES[-1] + 1e-6, 1 / rate)
    noise = SIGMA * np.random.default_rng(0).standard_normal((len(times), len(MARKS), 3))
    ids = np.tile([f"p{k}" for k in range(len(MARKS))], len(times))
    positions = (flight(MARKS, times) + noise).reshape(-1, 3)
    return TrackedPoints(np.repeat(times, len(MARKS)), ids, positions, np.full(len(ids), SIGMA))


def clouds() -> PointClouds:
    """Points of the ball in three frames, others in each."""
    frames, random = [1, 4, 8], np.random.default_rng(3)
    samples = []
    for frame in frames:
        direction = random.standard_normal((2000, 3))
        ball = RADIUS * random.random((2000, 1)) ** (1 / 3) * direction / np.linalg.norm(direction, axis=1)[:, None]
        samples.append(flight(CENTRE + ball, TIMES[[frame]])[0])
    return PointClouds(TIMES[frames], samples, np.zeros(len(frames)))


class Ball(BodyProblem):
    """Nothing is compared but points; material known, so that velocity and effects are left."""

    spacing = SPACING
    first_guess = GUESS

    def __init__(self, points: Points):
        rig = hemisphere_rig(3, SIZE)
        video = Video(
            torch.zeros(3, FRAMES, SIZE, SIZE, 3),
            torch.zeros(3, FRAMES, SIZE, SIZE),
            torch.ones(3, SIZE, SIZE, dtype=torch.bool),
            torch.tensor(rig.camera_to_world, dtype=torch.float32),
            torch.tensor(rig.intrinsics, dtype=torch.float32),
            torch.tensor(TIMES, dtype=torch.float32),
            (0, 1, 2),
            tuple(range(FRAMES)),
        )
        physics = Physics(NeoHookean(1e5, 0.3, known=["E", "nu"]), substep_rate=2400.0)
        held = Split(np.array([True, True, False]), np.arange(FRAMES) < FRAMES - 2, points.fitted)
        blank = np.ones((3, FRAMES, 11))
        super().__init__("ball", video, held, physics, SPACING, blank, independent(blank), points)
        self.usable[:3] = False

    def sample(self, spacing: float, seed: int) -> Body:
        positions = torch.tensor(lattice(spacing, 0.1 * spacing * (seed % 3)), dtype=torch.float32)
        return Body.full(positions, spacing)


def points(tracks: TrackedPoints | None, measured_clouds: PointClouds | None) -> Points:
    return Points(tracks, measured_clouds, TIMES, PIXEL, lattice(SPACING))


@pytest.mark.slow
def test_tracks_alone_name_the_drag_and_give_its_coefficient(small_threads):
    problem = Ball(points(tracked(), None))
    comparison = compare(problem, (), problem.first_guess, (5, 1), False, lambda _: None)
    wanted = ("LinearDrag", "UniformForce", "InitialSpin", "GravityMagnitude")
    candidates = [c for c in whole_catalogue(problem.physics.material, (0, 1, 2), ()) if c.name in wanted]
    screening = screened(problem, (), comparison, candidates)
    drag = screening.score("LinearDrag")
    assert drag is not None and screening.p_value(drag.log_bayes_factor) < LEVEL
    chosen = next(c for c in candidates if c.name == "LinearDrag")
    found = refit(problem, (), comparison, chosen, screening, lambda _: None)
    assert found is not None and found.p_value < LEVEL
    # quadratic course from 4 points in 8 frames at 1 mm: about 2 %; three times that, and 2 % for step and grid
    assert found.known["drag"] == pytest.approx(DRAG, rel=0.08)
    assert found.known["v_x"] == pytest.approx(VELOCITY[0], rel=0.03)
    (told,) = (interval for interval in found.intervals if interval.name == "drag")
    assert told.low < DRAG < told.high


def test_the_true_motion_leaves_noise_only_whatever_the_frame_rate_of_the_tracks():
    """At 72 Hz three sightings share a frame, two the first one: means are compared, relative to that of the first."""
    path = torch.tensor(flight(lattice(SPACING), TIMES))
    for rate, shared, first in ((24.0, 1, 1), (72.0, 3, 2)):
        rows = points(tracked(rate), None)
        assert rows.names == [f"point p{k}" for k in range(6)]
        middle = rows.sensor[:, 1:-1, :3] * PIXEL
        assert middle == pytest.approx(SIGMA / np.sqrt(shared))
        residual = relative(rows.measured - rows.predict(path), 0) * PIXEL
        expected = SIGMA * np.sqrt(1 / shared + 1 / first)
        assert np.nanstd(residual[:, 1:-1, :3]) == pytest.approx(expected, rel=0.35)  # 144 values, 18 common errors
        assert np.isnan(residual[..., 3:]).all()


def test_clouds_are_rows_and_the_true_motion_leaves_noise():
    rows = points(tracked(), clouds())
    problem = Ball(rows)
    assert problem.usable.shape == (3 + 6 + 2, FRAMES, 11)
    assert problem.usable[9:].sum() == 2 * len(CLOUD_KINDS)  # the first cloud is what the others are compared with
    assert problem.usable[3:9].sum() == 6 * 3 * (FRAMES - 1)
    layout = problem.layout(problem.usable)
    assert set(layout.kind) == {"point x", "point y", "point z", *CLOUD_KINDS}
    assert layout.view.max() == -1 and len(np.unique(layout.view)) == 8
    path = torch.tensor(flight(lattice(SPACING), TIMES))
    deviates = relative(rows.measured - rows.predict(path), 0)[6:] / rows.sensor[6:]
    assert np.nanmax(np.abs(deviates)) < 5 * np.sqrt(2)


def test_every_third_track_and_the_last_frames_are_held_out():
    problem = Ball(points(tracked(), clouds()))
    assert problem.split.fitted[3:, 0].tolist() == [True, True, False, True, True, False, True, True]
    assert not problem.fitted[:, FRAMES - 2 :].any() and problem.split.held[5].all()
