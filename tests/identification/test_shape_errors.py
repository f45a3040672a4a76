"""Bodies that a reconstruction may have taken for the true one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.problem import StateProblem
from pacnerf_lpo.identification.replicates import distorted
from pacnerf_lpo.identification.shape_modes import DENSITY_ERROR, LOCAL, PLACES, THINNINGS, bumps, polynomials, spread
from pacnerf_lpo.identification.surface import SMOOTH, Lines, density_of
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.particles.sampling import interpolate
from pacnerf_lpo.scene.activation import surface_density
from pacnerf_lpo.types import ParticleState

RADIUS, DX, SIGMA = 0.2, 0.04, 0.005


class Ball(StateProblem):
    """A ball whose raw density falls off evenly over 4 cm, and that no camera sees."""

    surface_offset = 0.0
    lines = Lines(*(torch.zeros(0, *shape) for shape in ((3,), (3,), (), ())))

    def __init__(self) -> None:
        self.physics = Physics(NeoHookean())
        axis = torch.arange(-0.26, 0.26, DX / 2) + DX / 4
        positions = torch.cartesian_prod(axis, axis, axis)
        density = (RADIUS - positions.norm(dim=1)) * 2000
        blank = torch.zeros(len(positions), 3)
        self.particles = 4000
        self.state = ParticleState(
            positions, blank, density.clamp(-40, 40), torch.zeros(len(positions), 12), {}, DX, DX, surface_offset=0.0
        )


@pytest.fixture(scope="module")
def ball() -> Ball:
    return Ball()


def radius(body: Body) -> float:
    return (body.volume * 3 / (4 * np.pi)) ** (1 / 3)


def test_a_body_is_as_large_as_its_surface_says(ball):
    """It ends where 2.5 voxels stop half the light; a curved surface moves inwards as it is smoothed."""
    along = torch.linspace(0.1, 0.2, 500)[:, None] * torch.tensor([0.6, 0.48, 0.64])
    within = interpolate(density_of(ball.state), along)[0] > surface_density(DX, DX)
    visible = float(along[within].norm(dim=1).max())
    assert radius(ball.body) == pytest.approx(visible - (SMOOTH * DX) ** 2 / visible, abs=0.002)


def test_a_reconstruction_that_is_solid_nowhere_is_said_to_be_one():
    haze = Ball()
    haze.state = haze.state.with_(density=haze.state.density.clamp(max=-30.0))
    haze.data = SimpleNamespace(video=SimpleNamespace(source="videos/haze"))
    with pytest.raises(UserInputError, match=r"videos/haze: .*solid nowhere; train the static phase longer"):
        _ = haze.spacing


def test_a_layer_may_be_taken_away_here_and_put_on_there(ball):
    leaning = ball.wrong_bodies(ball.body, SIGMA * THINNINGS**0.5)[25]
    right, left = (leaning.positions[:, 0] * side > 0 for side in (1, -1))
    cut = (ball.body.positions[:, 0] > 0, right), (ball.body.positions[:, 0] < 0, left)
    (before, after), (other, grown) = ((ball.body.fraction[was].sum(), leaning.fraction[now].sum()) for was, now in cut)
    assert after < 0.95 * before and grown > 1.05 * other


def test_polynomials_have_mean_0_and_mean_square_1(ball):
    positions = ball.body.positions
    fields = polynomials(positions, positions)
    assert len(fields) == 9
    for field in fields:
        assert float(field.mean()) == pytest.approx(0, abs=1e-4)
        assert float(field.square().mean()) == pytest.approx(1, rel=1e-3)
    x, y = (positions[:, axis] - positions[:, axis].mean() for axis in range(2))
    assert correlation(fields[3], x**2) > 0.999 and correlation(fields[6], x * y) > 0.999


def correlation(one: Tensor, other: Tensor) -> float:
    return float(torch.corrcoef(torch.stack((one, other)))[0, 1])


def test_displacements_are_together_as_large_as_the_shape_may_be_wrong(ball):
    squares = torch.stack([move.square().sum(1) for move in moves(ball)[:24]])
    assert float(squares.mean(1).sum().sqrt()) == pytest.approx(SIGMA, rel=1e-3)


def test_places_lie_apart_and_leave_nothing_far_away(ball):
    positions = ball.body.positions
    places, reach = spread(positions, PLACES)
    apart = torch.cdist(places, places) + torch.eye(PLACES)
    distances = torch.cdist(positions, places).amin(1)
    assert places.shape == (PLACES, 3)
    assert float(distances.max()) == pytest.approx(reach, rel=1e-5)
    assert float(apart.min()) >= reach - 1e-6


def test_layers_are_taken_away_or_put_on(ball):
    """An even one first, then those that lean and curve."""
    thinner = ball.wrong_bodies(ball.body, SIGMA * THINNINGS**0.5)[24:34]
    assert all(len(body.positions) != len(ball.body.positions) for body in thinner)
    lost = ball.body.volume - thinner[0].volume
    assert lost == pytest.approx(SIGMA * 4 * np.pi * radius(ball.body) ** 2, rel=1 / 6)


def test_an_error_that_leaves_nothing_of_the_body_is_none(ball):
    thick = ball.wrong_bodies(ball.body, SIGMA)[24:34]
    gone = ball.wrong_bodies(ball.body, 2 * RADIUS * THINNINGS**0.5)[24:34]
    assert gone[0] is ball.body and all(body is not ball.body for body in thick)


def test_every_place_moves_along_every_axis_by_itself(ball):
    positions = ball.body.positions
    places = spread(positions, PLACES)[0]
    local = moves(ball)[24:]
    assert len(local) == 3 * PLACES
    for number, move in enumerate(local):
        at = int(move.norm(dim=1).argmax())
        expected = torch.zeros(3)
        expected[number % 3] = LOCAL * SIGMA
        assert torch.allclose(positions[at], places[number // 3])
        assert torch.allclose(move[at], expected, atol=1e-6)
    outer = int(places.norm(dim=1).argmax())
    opposite = positions @ places[outer] < -0.5 * float(places[outer].square().sum())
    assert float(local[3 * outer][opposite].norm(dim=1).max()) < 0.02 * LOCAL * SIGMA


def test_a_distorted_body_moves_by_so_much_and_more_finely_than_it_bends(ball):
    body = ball.coarse_body
    fields = polynomials(body.positions, body.positions)
    smooth = torch.cat((torch.ones_like(fields[:1]), fields)).T
    for seed in range(3):
        moved = distorted(body, SIGMA, np.random.default_rng(seed)).positions - body.positions
        assert float(moved.square().sum(1).mean().sqrt()) == pytest.approx(SIGMA, rel=1e-4)
        left = moved - smooth @ torch.linalg.lstsq(smooth, moved).solution
        assert float(left.square().sum() / moved.square().sum()) > 0.05
    assert bumps(body, body.positions).shape == (PLACES, len(body.positions))


def test_places_of_a_few_particles_are_no_narrower_than_a_node(ball):
    few = Body.full(ball.body.positions[:5], DX)
    places = bumps(few, few.positions)
    assert places.shape == (5, 5) and torch.isfinite(places).all()
    distances = torch.cdist(few.positions, few.positions).flatten().sort().values
    assert torch.allclose(places.flatten().sort().values, (-0.5 * distances.flip(0) ** 2 / DX**2).exp(), atol=1e-5)


def test_the_body_is_denser_here_than_there(ball):
    denser = ball.wrong_bodies(ball.body, SIGMA)[-4:]
    assert all(torch.equal(body.positions, ball.body.positions) for body in denser)
    ratios = torch.stack([body.fraction / ball.body.fraction for body in denser])
    assert ratios[:3].std(dim=1).tolist() == pytest.approx(3 * [DENSITY_ERROR], rel=1e-3)
    assert correlation(ratios[3], ball.body.positions.square().sum(1)) > 0.99


def moves(problem: StateProblem) -> list[Tensor]:
    """Displacements of the bodies that have the particles of the right one (N, 3)."""
    right, bodies = problem.body, problem.wrong_bodies(problem.body, SIGMA)
    return [body.positions - right.positions for body in (*bodies[:24], *bodies[34:-4])]
