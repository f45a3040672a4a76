"""The schedule written for CUDA, compiled for the CPU: a thread per particle, atomic sums, the same numbers."""

from __future__ import annotations

import pytest
import torch

from pacnerf_lpo.mpm.effects import GroundFriction, LinearDrag, YieldStress
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.simulator import Simulator

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_threads")]
F64 = torch.float64


def rolled_out(cuda: bool) -> list[torch.Tensor]:
    """Positions of a sliding block that yields on impact, and gradients of their squares."""
    effects = [LinearDrag(1.0), YieldStress(1e4, 0.0), GroundFriction(0.3)]
    simulator = Simulator(NeoHookean(), dx=0.1, substeps=60, effects=effects, dtype="f64")
    simulator._engine.cuda = cuda
    axis = torch.arange(5, dtype=F64) * 0.05
    x = torch.cartesian_prod(axis, axis + 0.02, axis)
    v = torch.tensor([0.5, -3.0, 0.0], dtype=F64).expand_as(x).clone().requires_grad_()
    ones = torch.ones(len(x), dtype=F64)
    E, drag, friction = (torch.tensor(value, dtype=F64, requires_grad=True) for value in (1e5, 1.0, 0.3))
    fixed = {"yield_stress": torch.tensor(1e4), "hardening": torch.tensor(0.0)}
    parameters = {"E": E, "nu": torch.tensor(0.3)}
    path = simulator(x, v, 0.125 * ones, ones, parameters, 4, {"drag": drag, "ground_friction": friction, **fixed})
    (path[-1] ** 2).sum().backward()
    return [path.detach(), v.grad, E.grad, drag.grad, friction.grad]


def test_both_schedules_agree():
    """Up to the order of sums: rounding in float64 over 180 substeps."""
    for one, other in zip(rolled_out(False), rolled_out(True), strict=True):
        assert float(one.abs().max()) > 0
        torch.testing.assert_close(other, one, rtol=1e-9, atol=1e-11 * float(one.abs().max()))
