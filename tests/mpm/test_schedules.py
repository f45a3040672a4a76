"""Which threads do what changes no number: launches that are stopped half-way, and the schedule written for CUDA.

That one, a thread per particle and atomic sums, is compiled for the CPU here.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from pacnerf_lpo.mpm import effects, kernels, materials, taichi_calls
from pacnerf_lpo.mpm.effects import Effect, GroundFriction, LinearDrag, YieldStress
from pacnerf_lpo.mpm.materials import Material, NeoHookean
from pacnerf_lpo.mpm.simulator import Simulator
from pacnerf_lpo.mpm.taichi_calls import Launcher
from tests.mpm.scenes import CASES

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_threads")]
F64 = torch.float64
ROOT = Path(__file__).parents[2]
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


class Remembering:
    """Taichi's program, which keeps the contexts that it launches."""

    def __init__(self, program: Any):
        self.program, self.held = program, []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.program, name)

    def launch_kernel(self, kernel: Any, context: Any) -> None:
        self.held.append(context)
        self.program.launch_kernel(kernel, context)


def test_arguments_that_a_launch_uses_up_are_set_again(monkeypatch):
    """As on CUDA: what holds the arguments serves one launch."""
    expected, compiled = rolled_out("sliding"), Launcher._compile

    def compiled_for_one_launch(self: Launcher, arguments: list) -> None:
        compiled(self, arguments)
        self._used_once = True

    runtime = taichi_calls.impl.get_runtime()
    program = Remembering(runtime.prog)
    monkeypatch.setattr(Launcher, "_compile", compiled_for_one_launch)
    monkeypatch.setattr(runtime, "prog", program)
    kernels.build.cache_clear()
    found = rolled_out("sliding")
    kernels.build.cache_clear()
    assert len(program.held) == len({id(context) for context in program.held}) > 3
    for one, other in zip(expected, found, strict=True):
        torch.testing.assert_close(other, one, rtol=0, atol=0)


ON_A_GPU = """
import sys, torch
from pacnerf_lpo.mpm import runtime
runtime.start("cuda")
from tests.mpm.test_schedules import MODELS, rolled_out
torch.save({model: [x.cpu() for x in rolled_out(model, cuda=True)] for model in MODELS}, sys.argv[1])
"""


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_a_gpu_agrees(tmp_path):
    """Up to rounding. Sand in free flight lies on the tip of its cone, where rounding decides whether it resists: its
    gradient by velocity is left out.
    """
    subprocess.run([sys.executable, "-c", ON_A_GPU, str(tmp_path / "found.pt")], check=True, cwd=ROOT)
    for model, found in torch.load(tmp_path / "found.pt").items():
        for place, (one, other) in enumerate(zip(rolled_out(model), found, strict=True)):
            if (model, place) != ("DruckerPrager", 1):
                torch.testing.assert_close(other, one, rtol=1e-9, atol=1e-11 * float(one.abs().max()))


STOPPED = """
import os
os.environ["PACNERF_LPO_THREADS"] = "2"  # of a process of its own, as Taichi starts once
from pacnerf_lpo.mpm import kernels, rollout, schedule_cpu
from pacnerf_lpo.mpm.taichi_calls import Launcher
from tests.mpm.test_schedules import rolled_out

rollout.LEAST_PARTICLES, launch, launches = 1, Launcher.__call__, []
Launcher.__call__ = lambda self, **changed: (launches.append(1), launch(self, **changed))[1]
expected, usual = rolled_out("sliding"), len(launches)
schedule_cpu.PATIENCE = 1
kernels.build.cache_clear()
stopped = 0
for _ in range(400):  # whether a thread has to wait is up to the machine
    before = len(launches)
    found = rolled_out("sliding")
    stopped += len(launches) - before > usual
    assert all((one == other).all() for one, other in zip(expected, found, strict=True))
    if stopped == 5:
        break
print(stopped)
"""


def test_launches_that_are_stopped_go_on_where_they_were():
    """Threads that lose patience at once stop a launch whenever they would wait, at any place of a frame."""
    run = subprocess.run([sys.executable, "-c", STOPPED], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout.split()[-1]) > 0, "no launch was stopped"
