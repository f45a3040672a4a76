"""The side force on spinning bodies in flight, against circular motion."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.effects import InitialSpin, Magnus
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.simulator import Simulator
from tests.mpm.effects.test_rollouts import centre, uniform
from tests.mpm.scenes import DT, DX, Particles, block

pytestmark = pytest.mark.usefixtures("small_threads")
WEIGHTLESS = (0.0, 0.0, 0.0)


def fly(body: Particles, effects: list, frames: int, substeps: int, dx: float = DX, dtype: str = "f64") -> Tensor:
    """Positions of a stiff weightless body at every frame [m, (frames, N, 3)]."""
    simulator = Simulator(
        NeoHookean(), dx=dx, substeps=substeps, frame_dt=substeps * DT, gravity=WEIGHTLESS, effects=effects, dtype=dtype
    )
    stiff = {"E": torch.tensor(1e6).double(), "nu": torch.tensor(0.3).double()}
    return simulator(body.positions, body.velocity, body.mass, body.stiffness, stiff, frames)


def circle(rate: float, speed: float, times: Tensor) -> Tensor:
    """Way from the start at uniform circular motion, begun along x, turned from x to y [m, (T, 2)]."""
    angle = rate * times
    return speed / rate * torch.stack([torch.sin(angle), 1 - torch.cos(angle)], 1)


def test_a_ball_with_a_given_spin_flies_in_a_circle():
    """Of radius v / (S omega), whatever its particles do, and closed after 2 pi / (S omega), for every particle: by
    explicit steps h = S omega dt the speed grows by exp(h angle / 2), and positions are late by half a step.
    """
    S, omega, speed, substeps = 0.02, 500.0, 3.0, 120
    rate = S * omega
    body = uniform(block(bottom=2.0), (speed, 0.0, 0.0))
    frames = 1 + math.ceil(2 * math.pi / rate / (substeps * DT))
    way = fly(body, [Magnus(S, spin=(0.0, 0.0, omega))], frames, substeps) - body.positions
    times = torch.arange(frames).double() * substeps * DT
    expected, radius, h = circle(rate, speed, times), speed / rate, rate * DT
    error = (way.mean(1)[:, :2] - expected).norm(dim=1)
    assert (error <= radius * h * (rate * times / 2 + 2)).all()
    assert expected.norm(dim=1).max() > 1.9 * radius, "it has been on the other side"
    assert way[..., 2].abs().max() < 1e-8 and (way - way[:, :1]).abs().max() < 1e-8, "nodes of 1e-10 are dropped"


@pytest.mark.parametrize("cells", [2, 4])
def test_a_body_that_turns_is_deflected_by_its_own_spin(cells):
    """S omega x v with the spin omega at frame 0, of a body of 2 and of 4 nodes in width. Of n = 240 steps symplectic
    Euler is ahead by 1 / n; the body widens, and turns slower, by rho omega^2 r^2 / E = 0.4 %. The grid adds nothing:
    the velocity gradient of a rigid motion is exact.
    """
    S, omega, speed, substeps, dx = 0.5, 10.0, 2.0, 60, 4 * DX / cells
    body = block(cells=(cells,) * 3, bottom=2.0, dx=dx, jitter=0.0)
    ones = torch.ones(len(body.mass)).double()
    velocity = torch.tensor([speed, 0.0, 0.0]).double().expand_as(body.positions)
    body = Particles(body.positions, velocity, 1000 * (dx / 2) ** 3 * ones, ones)
    path = centre(fly(body, [Magnus(S), InitialSpin(0.0, 0.0, omega)], 5, substeps, dx), body)
    way, time = (path - path[0])[-1], torch.tensor([4 * substeps * DT]).double()
    torch.testing.assert_close(way[:2], circle(S * omega, speed, time)[0], rtol=0.01, atol=0)
    assert way[1] > 0.04 and way[2].abs() < 1e-8


@pytest.mark.slow
def test_a_body_without_spin_is_left_alone():
    """In float32 its velocity gradient is rounding, 4 v / dx eps = 2e-5 / s."""
    body = uniform(block(bottom=2.0), (3.0, 0.0, 0.0))
    flights = [fly(body, effects, 5, 60, dtype="f32") for effects in ([], [Magnus(1.0)])]
    assert (flights[1] - flights[0]).abs().max() < 1e-5


@pytest.mark.parametrize("spin", [(1.0, 2.0), (0.0, math.nan, 0.0)])
def test_a_spin_is_three_finite_numbers(spin):
    with pytest.raises(UserInputError, match=r"Magnus: spin .*give three finite numbers in rad/s"):
        Magnus(spin=spin)
