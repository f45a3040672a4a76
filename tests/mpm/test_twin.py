"""The reference itself: its matrix functions, its laws and its conservation properties, before anything is judged by
it.
"""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from tests.mpm import twin
from tests.mpm.scenes import CASES, DT, Case, block, probe, run_twin, twin_of

pytestmark = pytest.mark.usefixtures("small_threads")

STRETCHES = {
    "distinct": [1.3, 0.8, 1.1],
    "two equal": [1.2, 0.9, 0.9],
    "all equal": [0.95, 0.95, 0.95],
    "nearly equal": [1.1, 1.1 + 1e-9, 0.9],
}


def deformation(stretches: list[float], seed: int = 3) -> Tensor:
    """Two deformation gradients (2, 3, 3) with the given stretches and random rotations."""
    generator = torch.Generator().manual_seed(seed)
    left, right = (torch.linalg.qr(torch.randn(2, 3, 3, generator=generator, dtype=torch.float64))[0] for _ in range(2))
    left = left * torch.sign(torch.linalg.det(left))[:, None, None]
    right = right * torch.sign(torch.linalg.det(right))[:, None, None]
    return left @ torch.diag(torch.tensor(stretches, dtype=torch.float64)) @ right


@pytest.mark.parametrize("name", STRETCHES)
@pytest.mark.parametrize("function", [twin.log_symmetric, twin.exp_symmetric, twin.floored_log_symmetric])
def test_matrix_functions_have_exact_gradients(function, name):
    F = deformation(STRETCHES[name]).requires_grad_()
    assert torch.autograd.gradcheck(lambda F: function(F @ F.mT), (F,))


def test_floored_logarithm_has_exact_gradients_across_the_floor():
    F = deformation([0.03, 0.02, 0.9]).requires_grad_()
    assert torch.autograd.gradcheck(lambda F: twin.floored_log_symmetric(F @ F.mT), (F,), eps=1e-7, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["distinct", "two equal", "nearly equal"])
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_laws_have_exact_gradients(case: Case, name: str):
    """Strains of ten per cent are far in the plastic range of every plastic case; stresses are scaled to order one."""
    F = deformation(STRETCHES[name]).requires_grad_()
    C = (5 * torch.randn(2, 3, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)).requires_grad_()
    values = torch.tensor(list(case.parameters.values()), dtype=torch.float64)
    relative = torch.ones_like(values).requires_grad_()

    def evaluate(F: Tensor, C: Tensor, relative: Tensor) -> tuple[Tensor, Tensor]:
        parameters = dict(zip(case.parameters, relative * values, strict=True))
        new, tau = twin.LAWS[case.law](F, C, DT, parameters, torch.full((2, 1, 1), 0.7, dtype=torch.float64))
        return new, tau / 1e4

    assert torch.autograd.gradcheck(evaluate, (F, C, relative))


def test_matrix_functions_agree_with_torch():
    b = (lambda F: F @ F.mT)(deformation([1.3, 0.8, 1.1]))
    torch.testing.assert_close(torch.linalg.matrix_exp(twin.log_symmetric(b)), b, rtol=1e-13, atol=1e-13)
    torch.testing.assert_close(twin.exp_symmetric(b), torch.linalg.matrix_exp(b), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_twin_conserves_momentum_and_angular_momentum(case: Case):
    """Without gravity and ground; angular momentum counts the affine part of APIC, m D C with D = dx^2/4."""
    particles = block(bottom=1.0)
    reference = twin_of(case, ground="none", gravity=(0.0, 0.0, 0.0))

    def momenta(state: twin.State) -> Tensor:
        m = particles.mass[:, None]
        affine = (particles.mass * reference.dx**2 / 4)[:, None, None] * state.C
        spin = torch.stack(
            [affine[:, 2, 1] - affine[:, 1, 2], affine[:, 0, 2] - affine[:, 2, 0], affine[:, 1, 0] - affine[:, 0, 1]], 1
        )
        return torch.cat([(m * state.v).sum(0), (m * torch.linalg.cross(state.x, state.v) + spin).sum(0)])

    _, end = run_twin(reference, vars(particles), case.tensors(), frames=2, substeps=20)
    before = momenta(reference.start(particles.positions, particles.velocity))
    # Nodes lighter than 1e-10 kg of some 10 kg are dropped in every substep: 1e-8 is far above that and above rounding.
    torch.testing.assert_close(momenta(end), before, rtol=0, atol=1e-8 * float(before.norm()))


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.law)
def test_twin_gradient_equals_finite_differences(case: Case):
    """Through a contact, along a random direction of all inputs; central differences of step h: error of order h^2."""
    leaves, parameters = block().leaves(), case.tensors(requires_grad=True)
    reference, inputs = twin_of(case), [*leaves.values(), *parameters.values()]
    generator = torch.Generator().manual_seed(5)
    directions = [torch.randn(x.shape, generator=generator, dtype=x.dtype) * x.detach().abs().mean() for x in inputs]
    gradients = torch.autograd.grad(probe(run_twin(reference, leaves, parameters)[0]), inputs)
    slope = sum((g * d).sum() for g, d in zip(gradients, directions, strict=True))
    h = 1e-7

    def at(step: float) -> Tensor:
        moved = [x.detach() + step * d for x, d in zip(inputs, directions, strict=True)]
        return probe(
            run_twin(
                reference, dict(zip(leaves, moved[:4], strict=True)), dict(zip(parameters, moved[4:], strict=True))
            )[0]
        )

    torch.testing.assert_close((at(h) - at(-h)) / (2 * h), slope, rtol=1e-5, atol=0)
