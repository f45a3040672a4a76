"""The side force by spin as a candidate: it is left out where nothing turns, and is seen where something does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.screening import probed
from pacnerf_lpo.mpm.effects import InitialSpin, Magnus
from pacnerf_lpo.mpm.effects.base import Effect
from validation.hidden_effects.known_shape import KnownShape
from validation.hidden_effects.setting import Size, draw_setting

pytestmark = pytest.mark.slow

SIZE = Size(particles=200, views=3, held=1, frames=4, image_size=48)


@pytest.fixture(scope="module")
def flight() -> KnownShape:
    """A recording that ends before the contact."""
    setting, _ = draw_setting(np.random.default_rng(3), SIZE, "NeoHookean")
    setting = replace(setting, centre=[0.0, setting.centre[1] + 0.4, 0.0])
    found = KnownShape.simulated("flight", setting, setting.guess)
    model = found.model((), found.first_guess)
    assert model.path(model.start)[..., 1].min() > 2 * setting.spacing, "no node of the ground is in reach"
    return found


@pytest.mark.parametrize(
    ("effects", "candidate", "seen"),
    [
        ((), Magnus(), False),
        ((InitialSpin(),), Magnus(), False),
        ((InitialSpin(0.0, 9.0, 0.0),), Magnus(), True),
        ((), Magnus(spin=(0.0, 100.0, 0.0)), True),
    ],
    ids=["no spin", "no spin yet", "a spin in the model", "a measured spin"],
)
def test_it_is_tried_where_the_body_turns(
    flight: KnownShape, effects: tuple[Effect, ...], candidate: Effect, seen: bool, small_threads: None
):
    known = {**flight.first_guess, **{name: value for effect in effects for name, value in effect.guess.items()}}
    model = flight.model(effects, known)
    found, simulated = probed(flight, effects, model, model.start, [Candidate("Magnus", candidate)], flight.fitted)
    assert [one.name for one in found] == ["Magnus"] * seen and simulated == len(Magnus.probes)
