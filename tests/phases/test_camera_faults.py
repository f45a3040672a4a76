"""Cameras that are not as the video says, identified together with the motion."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.effects import InitialSpin
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases import GaussNewton, LPOModule, PaperAdam, PhysicsIDModule, VelocityModule
from pacnerf_lpo.phases.image_cost import ImageCost
from pacnerf_lpo.render.camera_faults import (
    CameraRotation,
    CameraShift,
    Exposure,
    RadialDistortion,
    TimeOffset,
)
from pacnerf_lpo.render.observation import Observer
from tests.phases.conftest import FRAMES, TRUTH, VELOCITY, cameras, film
from tests.phases.test_dynamic_phases import HIT, run

SHIFT, GAIN, LATE = 0.03, 0.8, 1 / 96


def model(*effects, frame_rate: float = 24.0) -> Physics:
    """The material is known, so that only velocity and cameras are left to find."""
    material = NeoHookean(E=TRUTH["E"], nu=TRUTH["nu"], known=["E", "nu"])
    return Physics(material, effects=effects, substep_rate=960.0, frame_rate=frame_rate)


@pytest.fixture(scope="module")
def faulty(state) -> SimpleNamespace:
    """Camera 1 stood further right and higher than the video says, and camera 2 was set darker."""
    poses, _ = cameras()
    poses[1, :, 3] += SHIFT * poses[1, :, 0] + 0.5 * SHIFT * poses[1, :, 1]
    data = film(state, model().simulate(state, FRAMES), poses)
    white = 1 - data.video.silhouettes[2, ..., None]
    data.video.images[2] = GAIN * (data.video.images[2] - white) + white
    return data


@pytest.mark.parametrize(
    "effect",
    [
        CameraShift(0.02, -0.01, view=1), CameraRotation(0.3, 0.4, 2.0), RadialDistortion(1.5),
        TimeOffset(0.01, view=1), Exposure(0.7, view=1),
    ],
    ids=lambda effect: type(effect).__name__,
)  # fmt: skip
def test_cost_gradient_equals_finite_differences(data, state, effect):
    """As for the particles: central differences of float32 images agree with the gradient within some per cent."""
    cost, names = ImageCost(data, state, silhouette_weight=1.0), list(effect.parameters)
    start = torch.tensor([effect.guess[name] for name in names])
    along = torch.tensor([effect.parameters[name].scale for name in names]) * start.sign()
    path = model().simulate(state, 3)

    def loss(step: torch.Tensor) -> torch.Tensor:
        observer = Observer([effect], dict(zip(names, start + step * along, strict=True)))
        seen = observer.seen(path, state.velocity, data.video.times[:3])
        return cost.loss(seen, state.density, state.features, [[0], [1], [2, 1]], observer=observer)

    step = torch.zeros((), requires_grad=True)
    loss(step).backward()
    difference = (loss(torch.tensor(0.1)) - loss(torch.tensor(-0.1))) / 0.2
    assert step.grad.item() == pytest.approx(difference.item(), rel=0.05)
    assert abs(difference.item()) > 1e-6, "the fault must matter, or the comparison says nothing"


@pytest.mark.slow
def test_gauss_newton_finds_shift_and_gain_with_the_velocity(faulty, state):
    """Filmed by the model that is fitted, so what stays is the tolerance of the last step."""
    method = GaussNewton(coarse_iterations=0, iterations=6, scan_decades=0, pool=1)
    start = state.with_(physics={}, velocity=state.velocity + torch.tensor([0.1, 0.1, -0.1]))
    phase = PhysicsIDModule(HIT, method, silhouette_weight=1.0)
    found = run(phase, faulty, model(CameraShift(view=1), Exposure(view=2)), start)
    torch.testing.assert_close(found.velocity[0], torch.tensor(VELOCITY), rtol=0, atol=0.01)
    # a pixel is 4 cm at the block; a fiftieth of it
    assert found.physics["shift_x_view1"] == pytest.approx(SHIFT, abs=8e-4)
    assert found.physics["shift_y_view1"] == pytest.approx(0.5 * SHIFT, abs=8e-4)
    assert found.physics["gain_view2"] == pytest.approx(GAIN, abs=0.005)
    assert set(phase.progress_metrics()) == {"shift_x_view1", "shift_y_view1", "gain_view2"}


def test_gauss_newton_finds_a_late_clock(state):
    """The late view is a simulation at four times the frame rate, so nothing of it was interpolated."""
    four_times = model(frame_rate=96.0).simulate(state, 4 * FRAMES)
    data = film(state, four_times[::4])
    late = film(state, four_times[1::4])
    data.video.images[0], data.video.silhouettes[0] = late.video.images[0], late.video.silhouettes[0]
    method = GaussNewton(coarse_iterations=0, iterations=5, scan_decades=0, pool=1, fits_velocity=False)
    found = run(PhysicsIDModule(HIT, method, silhouette_weight=1.0), data, model(TimeOffset(view=0)), state)
    # the body stops within two frames: the cubic is off by about a millimetre there, a millisecond at 1.5 m/s
    assert found.physics["time_offset_view0"] == pytest.approx(LATE, abs=0.001)


def test_adam_moves_the_gain_towards_the_truth(faulty, state):
    phase = PhysicsIDModule(HIT, PaperAdam({"gain_view2": 0.05}, warm_up_iterations=0, main_iterations=4))
    found = run(phase, faulty, model(Exposure(view=2)), state.with_(physics={}))
    assert GAIN - 0.02 < found.physics["gain_view2"] < 0.9


@pytest.mark.parametrize("phase", [LPOModule(1), VelocityModule(HIT, max_iterations=1)], ids=["lpo", "velocity"])
def test_other_phases_see_through_the_corrected_cameras(faulty, state, phase):
    """At the truth the cost vanishes, but only with the faults that were found before."""
    truth = {"shift_x_view1": SHIFT, "shift_y_view1": 0.5 * SHIFT, "gain_view2": GAIN}
    losses = []
    for values in ({}, truth):
        phase.attach(faulty, model(CameraShift(view=1), Exposure(view=2)))
        phase.import_state(state.with_(physics=values))
        phase.seed = 3  # a step whose random views are not all view 0
        if isinstance(phase, VelocityModule):
            phase.velocity.data.copy_(torch.tensor(VELOCITY))
        losses.append(phase.training_step(0, 0).item())
    assert losses[1] < 1e-4 * losses[0]


def test_a_clock_that_is_early_knows_the_spin(state):
    """v = v0 + omega x (x - centre of mass); the block and its density are symmetric."""
    turning = model(InitialSpin(spin_y=2.0), TimeOffset(view=0))
    values = {name: torch.tensor(value) for name, value in turning.guess.items()}
    spacings = state.spacing, state.base_spacing
    found = turning.initial_velocity(state.positions, state.velocity, state.density, values, spacings)
    arm = state.positions - state.positions.mean(0)
    turned = torch.linalg.cross(torch.tensor([0.0, 2.0, 0.0]).expand_as(arm), arm)
    torch.testing.assert_close(found, state.velocity + turned, rtol=0, atol=1e-5)


def test_a_camera_that_is_not_there_is_named(data):
    with pytest.raises(UserInputError, match=r"Exposure concerns view 9.*\[0, 1, 2\]"):
        LPOModule(1).attach(data, model(Exposure(view=9)))
    held_out = SimpleNamespace(video=replace(data.video), train=[0, 1], test=[2], rays=data.rays)
    with pytest.raises(UserInputError, match="view 2, which is no training view"):
        LPOModule(1).attach(held_out, model(Exposure(view=2)))
