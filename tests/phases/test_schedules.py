"""Schedules of the static phase, and of the rate of corrections."""

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.phases import GridOptimizationModule, LPOModule
from pacnerf_lpo.phases.schedules import Constant, Doubling, DoublingThenHalving, TrainingLength, rising_adam

DAGGER = TrainingLength(2000, [333, 667, 1333])


def test_surface_weight_of_the_dagger_baseline():
    """Doubled every 100 steps to 8 times, halved at each of three scalings, back at the default after the third."""
    schedule = DoublingThenHalving()
    factors = {
        step: schedule.factor(step, DAGGER.scalings(step)) for step in (0, 99, 100, 200, 300, 332, 333, 667, 1333, 1999)
    }
    assert factors == {0: 1, 99: 1, 100: 2, 200: 4, 300: 8, 332: 8, 333: 4, 667: 2, 1333: 1, 1999: 1}


def test_constant_and_doubling():
    assert {Constant().factor(step, 2) for step in (0, 500, 5999)} == {1.0}
    assert [Doubling(1000).factor(step, 0) for step in (0, 999, 1000, 5999)] == [1, 1, 2, 32]
    assert Doubling(10, limit=4).factor(1000, 0) == 4


def test_fewer_halvings_leave_the_weight_schedule_alone():
    coarse = TrainingLength(2000, [333, 667, 1333], halvings=2)
    assert [step for step in range(2000) if coarse.refines_before(step)] == [333, 667]
    assert [step for step in range(2000) if DAGGER.refines_before(step)] == [333, 667, 1333]
    assert coarse.scalings(1333) == 3


@pytest.mark.parametrize(
    "arguments", [(100, [50, 20]), (100, [100]), (100, [0, 50]), (100, [20, 20]), (100, [50], 2), (100, [50], -1)]
)
def test_impossible_lengths(arguments):
    with pytest.raises(UserInputError, match=r"phases\.static\.length"):
        TrainingLength(*arguments)


@pytest.mark.parametrize("schedule", [Doubling, DoublingThenHalving])
def test_impossible_period(schedule):
    with pytest.raises(UserInputError, match="every"):
        schedule(every=0)


def test_a_shortened_training_keeps_its_proportions():
    short = TrainingLength(2000, [333, 667, 1333], shorten=2)
    assert (short.steps, short.scaling_steps) == (1000, [166, 333, 666])


def test_rates_rise_linearly_over_their_part_of_the_steps_and_stay():
    unknown = torch.nn.Parameter(torch.zeros(1))
    configured = rising_adam([{"params": [unknown], "lr": 0.4}], steps=10, warm_up=0.3)
    adam, schedule = configured["optimizer"], configured["lr_scheduler"]["scheduler"]
    rates = []
    for _ in range(6):
        rates.append(adam.param_groups[0]["lr"])
        adam.step()
        schedule.step()
    assert rates == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.4, 0.4])
    assert isinstance(rising_adam([{"params": [unknown], "lr": 0.4}], steps=10, warm_up=0.0), torch.optim.Adam)


@pytest.mark.parametrize("correction", [LPOModule, GridOptimizationModule])
@pytest.mark.parametrize("warm_up", [-0.1, 1.0, 8])
def test_a_warm_up_is_a_part_of_the_iterations(correction, warm_up):
    with pytest.raises(UserInputError, match=r"warm_up = .* part of the iterations"):
        correction(warm_up=warm_up)
