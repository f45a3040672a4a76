"""How large an error of the reconstruction is taken to be, and what null replicates repeat."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from pacnerf_lpo.identification import replicates
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.identification.forward_model import BodyModel
from pacnerf_lpo.identification.problem import Part
from pacnerf_lpo.identification.replicates import _typical_squares
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics

VIEWS, KINDS = 11, 10


def deviates(**wrong: float) -> np.ndarray:
    """Normal deviates [(V, K)], those of some views ``v3=5.0`` times as large."""
    values = np.random.default_rng(0).standard_normal((VIEWS, KINDS))
    for view, factor in wrong.items():
        values[int(view[1:])] *= factor
    return values


def test_of_normal_deviates_either_estimate_is_about_one():
    many = np.random.default_rng(0).standard_normal((50, VIEWS, KINDS))
    assert _typical_squares(many) == pytest.approx([1.0, 1.0], abs=0.1)


def test_a_camera_that_is_wrong_does_not_count():
    right, wrong = _typical_squares(deviates()), _typical_squares(deviates(v3=100.0))
    assert (wrong < 1.5 * right).all()


def test_a_shape_that_is_wrong_in_some_views_counts_by_its_mean():
    median, mean = _typical_squares(deviates(v1=6.0, v3=6.0, v6=6.0, v7=6.0))
    assert mean > 5 and mean > 2 * median


def test_views_that_see_nothing_do_not_count():
    values = deviates()
    values[4] = np.nan
    assert np.isfinite(_typical_squares(values)).all()


def ball(spacing: float) -> Body:
    """Whole cells of a lattice inside a sphere, and the outermost half full."""
    axis = torch.arange(-1.0, 1.0, spacing / 2)
    points = torch.cartesian_prod(axis, axis, axis)
    points = points[points.norm(dim=1) < 0.8]
    away = points.norm(dim=1)
    discs = Discs.within(lambda places: 0.8 - places.norm(dim=1), points, spacing / 2)
    return Body(points, torch.where(away < 0.7, 1.0, 0.5), spacing, discs)


def test_shaken_particles_are_a_sampling_of_the_same_body():
    body = ball(0.1)
    shaken = [replicates.shaken(body, np.random.default_rng(seed)) for seed in range(20)]
    # the outer shell keeps half of its N particles, sqrt(N) / 2 of them more or less
    shell = int((body.fraction < 1).sum())
    assert all(abs(one.volume - body.volume) < 4 * shell**0.5 / 2 * 0.05**3 for one in shaken)
    mean = torch.stack([one.positions.mean(0) for one in shaken]).mean(0)
    assert mean.norm() < 0.01
    assert all((one.fraction == 1).all() for one in shaken)
    assert not torch.equal(shaken[0].positions[:5], shaken[1].positions[:5])


class Squares(BodyModel):
    """Every moment is the mean square distance of the matter from the centre."""

    def __init__(self, body: Body, physics: Physics):
        self.body, self.physics, self.start = body, physics, np.zeros(0)

    def predict(self, free: np.ndarray) -> np.ndarray:
        squares, mass = self.body.positions.square().sum(1), self.body.fraction
        return np.full((1, 2, 11), float((mass * squares).sum() / mass.sum()))


class Recording(SimpleNamespace):
    """As much of a recording as replicates ask for."""

    spacing, views, least_shape_error, errors, sensor = 0.1, 0, 0.1, None, np.zeros((1, 2, 11))
    body = coarse_body = ball(0.1)

    def sample(self, spacing: float, seed: int) -> Body:
        return ball(spacing)

    def model(self, effects: object, known: object, body: Body) -> Squares:
        return Squares(body, self.physics)

    def coarse_model(self, effects: object, known: object) -> Squares:
        return self.model(effects, known, self.coarse_body)

    def relative(self, values: np.ndarray) -> np.ndarray:
        return values

    def drawn_noise(self, random: np.random.Generator) -> np.ndarray:
        return np.zeros_like(self.sensor)

    lasting_noise = drawn_noise


def test_the_bias_of_a_distorted_body_is_told_from_the_residuals():
    """A displacement of mean square s^2 that does not know the place makes the mean square distance larger by s^2."""
    recording = Recording(physics=Physics(NeoHookean()))
    part = Part("ball", recording, (), {})  # type: ignore[arg-type]
    reference = recording.model((), {}, recording.body).predict(np.zeros(0))
    found, _, bias = replicates._of_recording(part, reference, 40, 0, lambda _: None)
    assert bias == pytest.approx(recording.least_shape_error**2, rel=0.2)
    assert abs(found.mean()) < 4 * found[..., 0, 0].std() / 40**0.5
