"""Damped Gauss-Newton (Levenberg-Marquardt) for a handful of parameters, as a torch optimiser."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from scipy.optimize import lsq_linear
from torch import Tensor

MAX_ATTEMPTS = 6
DAMPING_RANGE = (1e-7, 1e6)


@dataclass(frozen=True)
class NormalEquations:
    """Cost f(p) = mean r(p)^2 and its Gauss-Newton model around the current parameters, in float64.

    loss: mean squared residual
    gradient: mean J^T r, one entry per parameter [(K,)]
    hessian: mean J^T J [(K, K)]
    """

    loss: float
    gradient: Tensor
    hessian: Tensor


class LevenbergMarquardt(torch.optim.Optimizer):
    """Minimises a mean squared residual: (H + damping diag H) step = -gradient (Marquardt 1963).

    A step that does not lower the cost is taken back and tried again with more damping.

    Args:
        parameters: tensors to optimise, read as one vector of K entries.
        limits: largest change of each entry in one step [(K,)].
        trial_loss: the cost at the parameters' current values.
        bounds: between what each entry stays [(K,)]; one that begins outside moves back only.
        damping: relative damping to start with.
    """

    def __init__(
        self,
        parameters: list[Tensor],
        limits: Tensor,
        trial_loss: Callable[[], float],
        bounds: tuple[Tensor | float, Tensor | float] = (-torch.inf, torch.inf),
        damping: float = 1e-2,
    ):
        super().__init__(parameters, {"damping": damping, "last_step": 0.0, "last_gain": 0.0})
        self.limits, self.trial_loss, self.bounds = limits, trial_loss, bounds

    @torch.no_grad()
    def step(self, closure: Callable[[], NormalEquations]) -> NormalEquations:  # type: ignore[override]
        """One accepted step, or none when no damping helps; ``last_step`` is its largest part of a limit, ``last_gain``
        the part of the cost that it took away.
        """
        group = self.param_groups[0]
        model = closure()
        start = torch.cat([parameter.detach().reshape(-1).double() for parameter in group["params"]])
        low, high = ((bound - start).clamp(-self.limits, self.limits) for bound in self.bounds)
        low, high = low.clamp_max(0.0), high.clamp_min(0.0)
        for _ in range(MAX_ATTEMPTS):
            step = damped_step(model, group["damping"], low, high)
            self._assign(start + step)
            trial = self.trial_loss()
            if trial < model.loss:
                group["last_gain"] = 1 - trial / model.loss
                group["damping"] = max(group["damping"] / 5, DAMPING_RANGE[0])
                group["last_step"] = float((step.abs() / self.limits).max())
                return model
            group["damping"] = min(group["damping"] * 5, DAMPING_RANGE[1])
        self._assign(start)
        group["last_step"] = group["last_gain"] = 0.0
        return model

    def _assign(self, values: Tensor) -> None:
        parameters = self.param_groups[0]["params"]
        parts = values.split([parameter.numel() for parameter in parameters])
        for parameter, part in zip(parameters, parts, strict=True):
            parameter.copy_(part.view_as(parameter))


def damped_step(model: NormalEquations, damping: float, low: Tensor, high: Tensor) -> Tensor:
    """The Levenberg-Marquardt step that is best within a box: an entry that the data hardly determine runs into its own
    end and does not shorten the step of the others.

    Args:
        model: around the current parameters.
        damping: relative to the diagonal.
        low, high: ends of the box around 0 [(K,)]; an entry whose ends meet stays.
    """
    moving, step = high > low, torch.zeros_like(model.gradient)
    if not moving.any():
        return step
    hessian, gradient = model.hessian[moving][:, moving], model.gradient[moving]
    diagonal, reach = hessian.diagonal(), torch.maximum(-low, high)[moving]
    floor = 1e-9 * (diagonal * reach**2).max().clamp(min=1e-300) / reach**2
    damped = hessian + torch.diag(damping * torch.maximum(diagonal, floor) + floor)
    lower = torch.linalg.cholesky(damped)
    target = -torch.linalg.solve_triangular(lower, gradient[:, None], upper=False)[:, 0]
    found = lsq_linear(lower.T.numpy(), target.numpy(), (low[moving].numpy(), high[moving].numpy()), "bvls")
    step[moving] = torch.as_tensor(found.x)
    return step
