"""Which threads do what changes no number: launches that are stopped half-way, and the schedule written for CUDA.

That one, a thread per particle and atomic sums, is compiled for the CPU here.
"""

from __future__ import annotations

import pytest
import torch

from pacnerf_lpo.mpm import effects, kernels, materials, schedule_cpu
from pacnerf_lpo.mpm.effects import Effect, GroundFriction, LinearDrag, YieldStress
from pacnerf_lpo.mpm.materials import Material, NeoHookean
from pacnerf_lpo.mpm.simulator import Simulator
from pacnerf_lpo.mpm.taichi_calls import Launcher
from tests.mpm.scenes import CASES

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_threads")]
F64 = torch.float64
SLIDING = [LinearDrag(1.0), YieldStress(1e4, 0.0), GroundFriction(0.3)]
"""A body force, an effect on the law that keeps a history, and one on the ground."""
MODELS: dict[str, tuple[Material, list[Effect]]] = {
    **{case.law: (getattr(materials, case.law)(**case.parameters), []) for case in CASES},
    "sliding": (NeoHookean(), SLIDING),
    "initial state and softening": (NeoHookean(), [effects.InitialSpin(1.0, 2.0, 3.0), effects.ThermalSoftening(1.0)]),
    "two histories": (NeoHookean(), [effects.SurfaceTension(1.0), effects.KelvinVoigt(10.0)]),
}


def rolled_out(model: str, cuda: bool = False) -> list[torch.Tensor]:
    """Positions of a block that slides on impact, and gradients of their squares, by velocity and by every number of
    the model.
    """
    material, found = MODELS[model]
    simulator = Simulator(material, dx=0.1, substeps=60, effects=found, dtype="f64")
    simulator._engine.cuda = cuda
    axis = torch.arange(5, dtype=F64) * 0.05
    x = torch.cartesian_prod(axis, axis + 0.02, axis)
    v = torch.tensor([0.5, -3.0, 0.0], dtype=F64).expand_as(x).clone().requires_grad_()
    ones = torch.ones(len(x), dtype=F64)
    parameters = {name: torch.tensor(value, dtype=F64, requires_grad=True) for name, value in material.guess.items()}
    values = {name: value for effect in found for name, value in effect.guess.items()}
    of_effects = {name: torch.tensor(value, dtype=F64, requires_grad=True) for name, value in values.items()}
    path = simulator(x, v, 0.125 * ones, ones, parameters, 4, of_effects)
    (path[-1] ** 2).sum().backward()
    numbers = [value.grad for value in (*parameters.values(), *of_effects.values())]
    return [path.detach(), v.grad, *(torch.zeros((), dtype=F64) if grad is None else grad for grad in numbers)]


@pytest.mark.parametrize("model", MODELS)
def test_both_schedules_agree(model):
    """Up to the order of sums: rounding in float64 over 180 substeps."""
    for one, other in zip(rolled_out(model), rolled_out(model, cuda=True), strict=True):
        torch.testing.assert_close(other, one, rtol=1e-9, atol=1e-11 * float(one.abs().max()))


def test_launches_that_are_stopped_go_on_where_they_were(monkeypatch):
    """Threads that lose patience at once stop a launch whenever they would wait, at any place of a frame."""
    expected = rolled_out("sliding")
    launches: list[int] = []
    launch = Launcher.__call__

    def counted(self: Launcher, **changed: int) -> None:
        launches.append(1)
        launch(self, **changed)

    monkeypatch.setattr(Launcher, "__call__", counted)
    monkeypatch.setattr(schedule_cpu, "PATIENCE", 1)
    kernels.build.cache_clear()
    try:
        found = rolled_out("sliding")
    finally:
        kernels.build.cache_clear()
    assert len(launches) > 6, "three frames forward and backward; none was stopped"
    for one, other in zip(expected, found, strict=True):
        torch.testing.assert_close(other, one, rtol=0, atol=0)
