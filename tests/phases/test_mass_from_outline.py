"""``physics.mass_from: outline``: what a body weighs follows from how large it looks, in every phase."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases.schedules import Constant, TrainingLength
from pacnerf_lpo.phases.static_grid import StaticGridModule
from tests.phases.conftest import DX, FRAMES, TRUTH

FOG, HALF = 30.0, 48.0


def outlined() -> Physics:
    return Physics(NeoHookean(E=TRUTH["E"], nu=TRUTH["nu"]), substep_rate=960.0, mass_from="outline")


def share(model: Physics, density: float) -> float:
    """How much of a particle of this raw density is full."""
    return float(model.fraction(torch.tensor([density]), (DX, 2 * DX)))


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
    assert phase._surface_offset(foggy) - phase._surface_offset(state) == pytest.approx(FOG, abs=1.0)


def test_every_phase_moves_the_thinned_body(state):
    """Half of what is solid is taken off: lighter and softer by the same factor as in a state of that density. One side
    is denser, for a body that is thinned everywhere alike would move as before.
    """
    state = state.with_(density=state.density + 100 * (state.positions[:, 0] - state.positions[:, 0].mean()))
    thin, thinned = state.with_(density=state.density - HALF), state.with_(surface_offset=HALF)
    paths = [outlined().simulate(s, FRAMES) for s in (state, thin, thinned)]
    torch.testing.assert_close(paths[1], paths[2], rtol=0, atol=0)
    assert (paths[2][-1] - paths[0][-1]).abs().max() > 1e-3


@pytest.mark.parametrize(("mass_from", "lag"), [("opacity", 0.0), ("alpha", 1e-3)])
def test_a_body_of_half_full_particles_moves_like_a_full_one(state, mass_from, lag):
    """Half the volume is half the mass and half the force. The faint rim of PAC-NeRF resists less than that."""
    model = Physics(NeoHookean(E=TRUTH["E"], nu=TRUTH["nu"]), substep_rate=960.0, mass_from=mass_from)
    full, half = (
        torch.full_like(state.density, next(d for d in torch.linspace(-20, 200, 2201).tolist() if share(model, d) >= f))
        for f in (0.999, 0.5)
    )
    paths = [model.simulate(state.with_(density=density), FRAMES) for density in (full, half)]
    apart = float((paths[1] - paths[0]).abs().max())
    assert apart > lag if lag else apart < 1e-4


def test_outlines_that_are_cut_off_are_refused_before_training(data):
    video = SimpleNamespace(**{**vars(data.video), "silhouettes": torch.ones_like(data.video.silhouettes)})
    with pytest.raises(UserInputError, match=r"physics.mass_from = outline .* touches the border"):
        attached(SimpleNamespace(**{**vars(data), "video": video}))
