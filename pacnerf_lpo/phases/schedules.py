"""How weights and resolution of the static phase change over its steps, and the rates of corrections; set in YAML."""

import math
from abc import ABC, abstractmethod
from typing import Any

import torch
from torch.optim.lr_scheduler import LinearLR

from pacnerf_lpo.errors import UserInputError


class WeightSchedule(ABC):
    """A factor on a loss weight."""

    @abstractmethod
    def factor(self, step: int, scalings: int) -> float:
        """The factor at a step (counted from 0) after so many voxel scalings."""


class Constant(WeightSchedule):
    """The default weight throughout (PAC-NeRF's surface regulariser)."""

    def factor(self, step: int, scalings: int) -> float:
        return 1.0


class Doubling(WeightSchedule):
    """The weight doubles again and again (PAC-NeRF's transmittance entropy).

    Args:
        every: steps between doublings.
        limit: largest factor.
    """

    def __init__(self, every: int = 1000, limit: float = math.inf):
        if every <= 0:
            raise UserInputError(f"phases.static: schedule with every = {every:g} must be positive")
        self.every, self.limit = every, limit

    def factor(self, step: int, scalings: int) -> float:
        return min(self.limit, 2.0 ** (step // self.every))


class DoublingThenHalving(Doubling):
    """The weight doubles up to a limit, then halves at every voxel scaling, never below the default.

    With limit 8 and three scalings it ends at the default (LPO supplement, appendix A: PAC-NeRF-3v-dagger).

    Args:
        every: steps between doublings.
        limit: largest factor.
    """

    def __init__(self, every: int = 100, limit: float = 8.0):
        super().__init__(every, limit)

    def factor(self, step: int, scalings: int) -> float:
        return max(1.0, super().factor(step, scalings) / 2.0**scalings)


class TrainingLength:
    """How long the static phase trains, and when its voxels are scaled. Raises UserInputError where the numbers do not
    form a schedule.

    PAC-NeRF: 6000 steps, scaling after 1000, 2000 and 4000. The dagger baseline divides all by three.

    Args:
        steps: optimiser steps.
        scaling_steps: numbers of steps after which the voxel size halves.
        halvings: how many of the scalings halve the voxels; fewer than all give a coarser, cheaper grid, while the
            weight schedules still see all of them. None: all.
        shorten: divides steps and scaling_steps, whatever the baseline says they are.
    """

    def __init__(self, steps: int, scaling_steps: list[int], halvings: int | None = None, shorten: int = 1):
        if shorten < 1:
            raise UserInputError(f"phases.static.length: shorten = {shorten}; give 1 or more")
        if sorted(set(scaling_steps)) != scaling_steps or not all(0 < step < steps for step in scaling_steps):
            raise UserInputError(
                f"phases.static.length: scaling_steps {scaling_steps} must increase and lie between 0 and "
                f"steps = {steps}"
            )
        self.steps = steps // shorten
        self.scaling_steps = [step // shorten for step in scaling_steps]
        self.halvings = len(scaling_steps) if halvings is None else halvings
        if not 0 <= self.halvings <= len(scaling_steps):
            raise UserInputError(
                f"phases.static.length: halvings = {self.halvings} must lie between 0 and the "
                f"{len(scaling_steps)} scaling_steps"
            )

    def scalings(self, step: int) -> int:
        """Scalings that have happened when a step (counted from 0) begins."""
        return sum(step >= scaling for scaling in self.scaling_steps)

    def refines_before(self, step: int) -> bool:
        """Whether the voxels are halved just before a step (counted from 0)."""
        return step in self.scaling_steps[: self.halvings]


def rising_adam(groups: list[dict[str, Any]], steps: int, warm_up: float) -> Any:
    """Adam whose rates rise linearly over a part ``warm_up`` of the steps, as Lightning wants it configured.

    Adam's first steps are as long for a vanishing gradient as for a large one, so a correction that starts near its
    goal, as that of a later round does, is thrown back by them.
    """
    adam, rise = torch.optim.Adam(groups, betas=(0.9, 0.999)), round(warm_up * steps)
    if rise == 0:
        return adam
    rising = LinearLR(adam, 1 / (rise + 1), total_iters=rise)
    return {"optimizer": adam, "lr_scheduler": {"scheduler": rising, "interval": "step"}}


def check_warm_up(warm_up: float) -> float:
    """The part itself; raises UserInputError unless it is at least 0 and below 1."""
    if not 0 <= warm_up < 1:
        raise UserInputError(f"phases.correction: warm_up = {warm_up:g} is a part of the iterations; give 0 to 0.9")
    return warm_up
