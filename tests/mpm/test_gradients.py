"""Trajectories and every gradient of the engine against the twin, and against finite differences, through a contact.

Float64: both sides commit some 1e3 roundings of 1e-16 per substep and drop different nodes of less than 1e-10 kg next to
particles of 0.1 kg, so 1e-8 relative bounds both with room; float32 is judged by eps = 6e-8 times the same counts.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from tests.mpm.engine import Setup, run_engine
from tests.mpm.scenes import BY_LAW, block, probe, run_twin, twin_of

pytestmark = pytest.mark.usefixtures("small_threads")

SETUPS = {
    **{law: Setup(law) for law in BY_LAW},
    "slip and drag": Setup("NeoHookean", ground="slip", drag=3.0),
    "separate": Setup("NeoHookean", ground="separate", friction=0.3),
}
TOLERANCE = {"f64": 1e-8, "f32": 2e-3}


@dataclass(frozen=True)
class Outcome:
    """Positions [m, (frames, N, 3)] and the gradient of the probe by each input."""

    trajectory: Tensor
    gradients: dict[str, Tensor]


def _inputs(setup: Setup) -> tuple[dict[str, Tensor], dict[str, Tensor], dict[str, Tensor]]:
    """Leaves: particles, material parameters, coefficients of effects and of the ground."""
    return block().leaves(), BY_LAW[setup.law].tensors(requires_grad=True), setup.coefficients(requires_grad=True)


def _outcome(trajectory: Tensor, leaves: dict[str, Tensor]) -> Outcome:
    gradients = torch.autograd.grad(probe(trajectory), list(leaves.values()))
    return Outcome(trajectory.detach().double(), {k: g.double() for k, g in zip(leaves, gradients, strict=True)})


@functools.cache
def by_twin(name: str) -> Outcome:
    """Autograd through the twin."""
    setup = SETUPS[name]
    particles, parameters, coefficients = _inputs(setup)
    twin = twin_of(BY_LAW[setup.law], ground=setup.ground)
    return _outcome(run_twin(twin, particles, parameters, **coefficients)[0], {**particles, **parameters, **coefficients})


@functools.cache
def by_engine(name: str, dtype: str) -> Outcome:
    """The engine's own backward pass."""
    setup = SETUPS[name]
    particles, parameters, coefficients = _inputs(setup)
    trajectory = run_engine(setup, particles, parameters, coefficients, dtype=dtype)
    return _outcome(trajectory, {**particles, **parameters, **coefficients})


def names(setup: Setup) -> list[str]:
    """Every differentiable input of a set-up."""
    return ["positions", "velocity", "mass", "stiffness", *BY_LAW[setup.law].parameters, *setup.coefficients()]


RUNS = [(name, "f64") for name in SETUPS] + [(law, "f32") for law in BY_LAW]
EACH = [pytest.param(name, dtype, key, id=f"{name}-{dtype}-{key}") for name, dtype in RUNS for key in names(SETUPS[name])]


@pytest.mark.parametrize(("name", "dtype"), RUNS)
def test_trajectory(name, dtype):
    moved = by_twin(name).trajectory - by_twin(name).trajectory[:1]
    error = (by_engine(name, dtype).trajectory - by_twin(name).trajectory).norm() / moved.norm()
    assert moved.norm() > 0.05 * len(moved) ** 0.5, "the scene must move for the comparison to mean anything"
    assert error < {"f64": 1e-10, "f32": 1e-4}[dtype]


@pytest.mark.parametrize(("name", "dtype", "key"), EACH)
def test_gradient(name, dtype, key):
    mine, truth = by_engine(name, dtype).gradients[key], by_twin(name).gradients[key]
    norm, inner = truth.norm(), (mine * truth).sum()
    assert norm > 0, "the probe must depend on this input"
    tolerance = TOLERANCE[dtype]
    assert (mine - truth).norm() / norm < tolerance, "relative L2"
    assert 1 - inner / (mine.norm() * norm) < tolerance**2 + 1e-14, "cosine"
    assert abs(inner / norm**2 - 1) < tolerance, "signed bias"


@pytest.mark.parametrize("name", SETUPS)
def test_gradient_equals_finite_differences_through_a_rollout(name):
    """Along a random direction per input in float64: central differences, truncation h^2, rounding 1e-16/h."""
    setup, gradients = SETUPS[name], by_engine(name, "f64").gradients
    particles, parameters, coefficients = _inputs(setup)
    leaves = {k: v.detach() for k, v in {**particles, **parameters, **coefficients}.items()}
    generator = torch.Generator().manual_seed(3)
    h = 1e-6
    for key, value in leaves.items():
        direction = torch.randn(value.shape, generator=generator, dtype=value.dtype) * value.abs().mean()

        def at(step: float, key: str = key, direction: Tensor = direction) -> Tensor:
            moved = {**leaves, key: leaves[key] + step * direction}
            groups = ({k: moved[k] for k in group} for group in (particles, parameters, coefficients))
            return probe(run_engine(setup, *groups, dtype="f64"))

        slope = (at(h) - at(-h)) / (2 * h)
        expected = (gradients[key] * direction).sum()
        torch.testing.assert_close(slope, expected, rtol=1e-4, atol=1e-7 * float(gradients[key].norm() * direction.norm()))


def test_no_gradient_is_computed_for_inputs_that_need_none():
    setup = SETUPS["NeoHookean"]
    particles = {k: v.requires_grad_(k == "velocity") for k, v in {k: v.detach() for k, v in block().leaves().items()}.items()}
    trajectory = run_engine(setup, particles, BY_LAW[setup.law].tensors(), {}, dtype="f64")
    probe(trajectory).backward()
    torch.testing.assert_close(particles["velocity"].grad, by_engine("NeoHookean", "f64").gradients["velocity"], rtol=1e-12, atol=1e-12)
    assert all(particles[k].grad is None for k in ("positions", "mass", "stiffness"))

