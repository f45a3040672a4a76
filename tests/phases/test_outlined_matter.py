"""``physics.matter: outlined``: what a body weighs follows from how large it looks, in every phase alike."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases.schedules import Constant, TrainingLength
from pacnerf_lpo.phases.static_grid import StaticGridModule
from tests.phases.conftest import FRAMES, TRUTH

FOG, HALF = 30.0, 48.0


def outlined() -> Physics:
    return Physics(NeoHookean(E=TRUTH["E"], nu=TRUTH["nu"]), substep_rate=960.0, matter="outlined")


def attached(data) -> StaticGridModule:
    phase = StaticGridModule(
        base_spacing=0.16,
        entropy_weight=1e-3,
        surface_weight=1e-3,
        entropy_schedule=Constant(),
        surface_schedule=Constant(),
        length=TrainingLength(10, [5]),
    )
    phase.attach(data, outlined())
    return phase


def test_a_foggy_body_is_thinned_to_the_size_it_shows(data, state):
    """Density that is higher by a constant everywhere is taken off again: the mattes are the same."""
    phase = attached(data)
    foggy = state.with_(density=state.density + FOG)
    assert phase._erosion(foggy) - phase._erosion(state) == pytest.approx(FOG, abs=1.0)


def test_every_phase_moves_the_thinned_body(state):
    """Half of what is solid is taken off: lighter and softer by the same factor as in a state of that density."""
    thin, eroded = state.with_(density=state.density - HALF), state.with_(erosion=HALF)
    paths = [outlined().simulate(s, FRAMES) for s in (state, thin, eroded)]
    torch.testing.assert_close(paths[1], paths[2], rtol=0, atol=0)
    assert (paths[2][-1] - paths[0][-1]).abs().max() > 1e-3


def test_outlines_that_are_cut_off_are_refused_before_training(data):
    video = SimpleNamespace(**{**vars(data.video), "silhouettes": torch.ones_like(data.video.silhouettes)})
    with pytest.raises(UserInputError, match=r"physics.matter = outlined .* touches the border"):
        attached(SimpleNamespace(**{**vars(data), "video": video}))
