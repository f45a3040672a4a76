"""Levenberg-Marquardt on problems whose minimum is known."""

import pytest
import torch

from pacnerf_lpo.identification.levenberg_marquardt import LevenbergMarquardt, NormalEquations, damped_step

TIMES = torch.linspace(0, 2, 40, dtype=torch.float64)


class Decay:
    """Fit amplitude * exp(-rate t) to samples made with amplitude 3 and rate 1.5."""

    def __init__(self, amplitude: float, rate: float):
        self.unknowns = [torch.tensor([amplitude, rate], dtype=torch.float64)]

    def residual(self, values):
        return values[0] * torch.exp(-values[1] * TIMES) - 3.0 * torch.exp(-1.5 * TIMES)

    def loss(self) -> float:
        return self.residual(self.unknowns[0]).square().mean().item()

    def model(self) -> NormalEquations:
        residual = self.residual(self.unknowns[0])
        jacobian = torch.autograd.functional.jacobian(self.residual, self.unknowns[0].clone())
        count = len(residual)
        return NormalEquations(
            residual.square().mean().item(), jacobian.T @ residual / count, jacobian.T @ jacobian / count
        )


@pytest.mark.parametrize("start", [(1.0, 0.2), (10.0, 6.0)])
def test_reaches_the_known_minimum(start):
    problem = Decay(*start)
    optimiser = LevenbergMarquardt(problem.unknowns, torch.tensor([5.0, 1.0]).double(), problem.loss)
    for _ in range(30):
        optimiser.step(problem.model)
    torch.testing.assert_close(problem.unknowns[0], torch.tensor([3.0, 1.5]).double(), rtol=1e-6, atol=1e-6)


def test_an_entry_stays_inside_its_bounds_and_the_others_make_the_best_of_it():
    problem = Decay(2.0, 1.0)
    low, high = torch.tensor([[-torch.inf, 0.5], [torch.inf, 1.2]], dtype=torch.float64)
    optimiser = LevenbergMarquardt(problem.unknowns, torch.tensor([5.0, 1.0]).double(), problem.loss, (low, high))
    for _ in range(30):
        optimiser.step(problem.model)
        assert 0.5 <= problem.unknowns[0][1] <= 1.2 + 1e-12
    assert problem.unknowns[0][1] == pytest.approx(1.2)
    assert abs(float(problem.model().gradient[0])) < 1e-9


def test_an_entry_that_begins_outside_its_bounds_moves_back_only():
    unknown = torch.tensor([2.0, -2.0]).double()
    optimiser = LevenbergMarquardt([unknown], torch.ones(2).double(), lambda: 0.0, (-1.0, 1.0))
    optimiser.step(lambda: NormalEquations(1.0, torch.tensor([-1.0, 1.0]).double(), torch.eye(2).double()))
    assert unknown.tolist() == [2.0, -2.0]
    optimiser.step(lambda: NormalEquations(1.0, torch.tensor([1.0, -1.0]).double(), torch.eye(2).double()))
    assert unknown.tolist() == pytest.approx([1.0, -1.0], abs=0.05)


def test_no_step_exceeds_its_limit():
    model = NormalEquations(1.0, torch.tensor([-100.0, 1.0]).double(), torch.eye(2).double())
    limits = torch.tensor([0.5, 0.25]).double()
    step = damped_step(model, 1e-6, -limits, limits)
    assert step.tolist() == pytest.approx([0.5, -0.25])


def test_a_step_at_its_limit_does_not_shorten_the_others():
    """Two unknowns that do nearly the same, one hardly seen: it runs into its limit, and the other takes over."""
    jacobian = torch.tensor([[1.0, 0.1], [0.0, 1e-3]]).double()
    wanted = torch.tensor([0.3, 0.02]).double()
    model = NormalEquations(1.0, -jacobian.T @ wanted, jacobian.T @ jacobian)
    limits = torch.ones(2).double()
    step = damped_step(model, 1e-9, -limits, limits)
    assert step.tolist() == pytest.approx([0.2, 1.0], rel=1e-3)
    assert damped_step(model, 1e-9, -limits, torch.tensor([1.0, 0.0]).double())[1] <= 0.0
    still = torch.tensor([1.0, 0.0]).double()
    assert damped_step(model, 1e-9, -still, still).tolist() == pytest.approx([0.3, 0.0], rel=1e-3)


def test_an_uphill_step_is_taken_back():
    unknown = torch.tensor([1.0]).double()
    optimiser = LevenbergMarquardt([unknown], torch.ones(1).double(), lambda: 2.0)
    optimiser.step(lambda: NormalEquations(1.0, torch.ones(1).double(), torch.ones(1, 1).double()))
    assert unknown.item() == 1.0
    assert optimiser.param_groups[0]["last_step"] == 0.0
    assert optimiser.param_groups[0]["damping"] > 1.0


def test_an_invisible_parameter_stays_where_it_is():
    """A zero column of the Jacobian must neither move nor make the system singular."""
    model = NormalEquations(1.0, torch.tensor([1.0, 0.0]).double(), torch.diag(torch.tensor([4.0, 0.0]).double()))
    step = damped_step(model, 1e-6, -torch.ones(2).double(), torch.ones(2).double())
    assert step[1] == pytest.approx(0.0, abs=1e-12)
    assert step[0] == pytest.approx(-0.25, rel=1e-5)
