"""Balls that fill a body reach to its surface, and no farther, also after its particles were sampled otherwise."""

import numpy as np
import pytest
import torch

from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.discs import SHELL, Discs
from pacnerf_lpo.identification.replicates import shaken

RADIUS, APART = 0.2, 0.02


def distance(points: torch.Tensor) -> torch.Tensor:
    return RADIUS - points.norm(dim=1)


@pytest.fixture
def ball() -> Body:
    axis = torch.arange(-RADIUS, RADIUS, APART) + APART / 3
    points = torch.cartesian_prod(axis, axis, axis)
    points = points[distance(points) > 0]
    return Body(points, torch.ones(len(points)), 2 * APART, Discs.within(distance, points, APART))


def test_balls_around_particles_come_first_and_others_fill_the_shell(ball):
    discs, count = ball.discs, len(ball.positions)
    assert torch.equal(discs.ends[:count, 0], torch.arange(count))
    assert torch.equal(discs.ends[:count, 0], discs.ends[:count, 1])
    torch.testing.assert_close(discs.depth, distance(ball.positions[discs.ends].mean(1)))
    between = discs.ends[count:]
    assert (distance(ball.positions)[between] < SHELL * APART).all() and len(between) > count / 2
    outwards = torch.nn.functional.normalize(ball.positions, dim=1)[: count // 3]
    assert ((discs.inwards[: count // 3] * outwards).sum(1) < -0.9).all()


def test_particles_at_random_places_know_how_deep_they_are(ball):
    """To a tenth of their spacing, and nowhere is a ball much too large."""
    found = shaken(ball, np.random.default_rng(0))
    away = found.discs.depth - distance(found.positions[found.discs.ends].mean(1))
    near = found.discs.depth < APART
    assert float(away[near].square().mean().sqrt()) < 0.1 * APART
    assert float(away[near].max()) < 0.3 * APART


def test_particles_that_are_left_out_are_in_no_ball(ball):
    ball.fraction[::2] = 0.0
    found = shaken(ball, np.random.default_rng(0))
    assert len(found.positions) == len(ball.positions) // 2
    assert int(found.discs.ends.max()) == len(found.positions) - 1
    assert found.discs.depth.isfinite().all()
