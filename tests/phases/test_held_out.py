"""Images held out of the correction."""

from __future__ import annotations

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.manifest import Manifest, PhaseRecord
from pacnerf_lpo.mpm.effects import InitialSpin
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.outer_loop import OuterLoop
from pacnerf_lpo.phases import LPOModule
from pacnerf_lpo.phases.held_out import held_out_error, held_out_images
from pacnerf_lpo.render.camera_faults import TimeOffset
from pacnerf_lpo.render.clocks import cameras_of
from pacnerf_lpo.render.observation import Observer
from tests.phases.conftest import FRAMES, cameras, film, physics


def test_every_second_frame_keeps_one_view_back_in_turn(data):
    assert sorted(held_out_images(data), key=lambda image: image[1]) == [(0, 1), (1, 3), (2, 5)]


def test_a_correction_never_looks_at_them_and_at_every_other_image(data):
    phase = LPOModule(1)
    phase.attach(data, physics())
    phase.held_out = held_out_images(data)
    seen = {
        (view, frame)
        for step in range(60)  # an image of two or three is missed sixty times in a row by chance 1e-10
        for frame, views in enumerate(phase.one_view_per_frame(step, FRAMES))
        for view in views
    }
    assert seen == {(view, frame) for view in range(3) for frame in range(FRAMES)} - phase.held_out


def test_the_error_is_that_of_the_images_held_out(data, state):
    """Zero at the truth but for the time step; a body beside itself by more than a pixel (4 cm) shows."""
    model = physics()
    model.halvings = 1  # the step with which the film was made
    assert held_out_error(data, model, state, held_out_images(data)) < 1e-6
    beside = state.with_(positions=state.positions + torch.tensor([0.1, 0.0, 0.0]))
    assert held_out_error(data, model, beside, held_out_images(data)) > 1e-3


def test_a_camera_sees_a_body_that_spins_before_frame_0(data, state):
    early = TimeOffset(-0.06, view=1)  # by more than a frame: its frame 1 is before frame 0
    model = Physics(NeoHookean(E=3e4, nu=0.3), effects=[InitialSpin(spin_z=5.0), early], substep_rate=960.0)
    observer = Observer(cameras_of(model.effects, data.video), model.values(state))
    *_, seen = observer.seen(model.simulate(state, FRAMES), model.velocity_of(state), data.video.times)
    filmed, images = film(state, seen, cameras()[0]), [(1, frame) for frame in range(1, FRAMES)]
    assert held_out_error(filmed, model, state, images) < 1e-8


def errors(*values: float | None) -> Manifest:
    records = [PhaseRecord(i, i, "correction", "done", "", "", held_out_error=value) for i, value in enumerate(values)]
    return Manifest("", "finished", records)


@pytest.mark.parametrize(
    ("values", "chosen"),
    [((), None), ((None, None), None), ((3.0,), 1), ((3.0, 2.0), 2), ((3.0, 2.0, 2.0, 1.0), 2), ((3.0, 4.0), 1)],
)
def test_the_round_before_the_error_stops_falling_is_chosen(values, chosen):
    assert errors(*values).chosen_round == chosen


def test_it_needs_a_correction_and_two_views(data):
    loop = OuterLoop(stop_when="held_out")
    loop.check(data, correction=True)
    with pytest.raises(UserInputError, match="correction is null"):
        loop.check(data, correction=False)
    data = type(data)(**{**vars(data), "train": [1]})
    with pytest.raises(UserInputError, match="one view only"):
        loop.check(data, correction=True)
