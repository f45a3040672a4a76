"""Velocity, identification and LPO on a block whose velocity and stiffness are known."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
import pytorch_lightning as pl
import torch

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.phases import (
    GaussNewton,
    LPOModule,
    PaperAdam,
    PhysicsIDModule,
    VelocityModule,
    identification_methods,
)
from pacnerf_lpo.phases.image_cost import ImageCost
from pacnerf_lpo.scene.activation import optical_depth, sample_length, solid_fraction
from tests.phases.conftest import DX, FRAMES, TRUTH, VELOCITY, physics

HIT = 3


def run(phase, data, model, state):
    """Train a phase as the command line does; returns what it exports."""
    phase.attach(data, model)
    phase.import_state(state)
    loader = torch.utils.data.DataLoader(phase.batches(data), batch_size=None)
    trainer = pl.Trainer(
        max_epochs=1, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(phase, train_dataloaders=loader)
    return phase.export_state()


@pytest.mark.parametrize("silhouette_weight", [0.0, 1.0])
def test_cost_gradient_equals_finite_differences(data, state, silhouette_weight):
    """Central differences of float32 images: truncation (step^2) and rounding (eps / step) meet near 1 %."""
    cost = ImageCost(data, state, silhouette_weight)
    direction = torch.randn(state.positions.shape, generator=torch.Generator().manual_seed(1))
    path = (state.positions + 0.01 * direction).expand(2, -1, -1)

    def loss(shift: torch.Tensor) -> torch.Tensor:
        return cost.loss((path + shift * direction)[None], state.density, state.features, [[0], [1, 2]])

    shift = torch.zeros((), requires_grad=True)
    loss(shift).backward()
    step = 1e-3
    difference = (loss(torch.tensor(step)) - loss(torch.tensor(-step))) / (2 * step)
    assert shift.grad.item() == pytest.approx(difference.item(), rel=0.03)
    assert abs(difference.item()) > 1e-4, "the direction must matter, or the comparison says nothing"


def test_cost_vanishes_at_the_truth_and_ignores_hidden_pixels(data, state):
    cost = ImageCost(data, state, silhouette_weight=1.0)
    residual = cost.residual(state.positions, state.density, state.features, 1, 0)
    assert residual.abs().max() < 1e-5, "the film was drawn by the same renderer"
    hidden = SimpleNamespace(**{**vars(data), "video": data.video})
    hidden.video = type(data.video)(**{**vars(data.video), "valid": torch.zeros_like(data.video.valid)})
    elsewhere = ImageCost(hidden, state).residual(state.positions + 0.1, state.density, state.features, 1, 0)
    assert (elsewhere == 0).all()


def test_pooling_averages_blocks(data, state):
    fine, coarse = ImageCost(data, state), ImageCost(data, state)
    coarse.pool = 4
    moved = state.positions + 0.02
    whole, blocks = (m.residual(moved, state.density, state.features, 0, 0) for m in (fine, coarse))
    torch.testing.assert_close(blocks[2, 3], whole[8:12, 12:16].mean((0, 1)))


@pytest.mark.slow
def test_velocity_is_found_before_contact(data, state):
    start = state.with_(velocity=torch.zeros_like(state.velocity), physics={})
    found = run(VelocityModule(HIT, max_iterations=24, silhouette_weight=1.0), data, physics(), start).velocity[0]
    # one pixel is 1.6 m / 40 = 4 cm; a tenth of it over two frames is 5 cm/s
    torch.testing.assert_close(found, torch.tensor(VELOCITY), rtol=0, atol=0.05)


@pytest.mark.slow
def test_velocity_search_turns_back_from_unstable_motions(data, state, monkeypatch):
    phase = VelocityModule(HIT, max_iterations=24, guess=(0.0, -0.8, 0.0), silhouette_weight=1.0)
    rollout, refused = phase.rollout, []

    def fragile(velocity, *rest):
        if velocity.norm() > 1.1 * math.hypot(*VELOCITY):
            refused.append(velocity.tolist())
            raise SimulationError(1, 3, "NaN in the velocity of a particle")
        return rollout(velocity, *rest)

    monkeypatch.setattr(phase, "rollout", fragile)
    start = state.with_(velocity=torch.zeros_like(state.velocity), physics={})
    found = run(phase, data, physics(), start).velocity[0]
    assert refused, "the first step of 0.5 m/s leaves what is stable"
    torch.testing.assert_close(found, torch.tensor(VELOCITY), rtol=0, atol=0.05)
    with pytest.raises(SimulationError):
        wild = VelocityModule(HIT, guess=(0.0, -9.0, 0.0))
        monkeypatch.setattr(wild, "rollout", fragile)
        run(wild, data, physics(), start)


@pytest.mark.slow
def test_velocity_search_goes_on_where_a_line_search_ends_at_no_number(data, state, monkeypatch):
    phase = VelocityModule(HIT, max_iterations=24, guess=(0.0, -0.8, 0.0), silhouette_weight=1.0)
    step, spoilt = phase.training_step, []

    def training_step(*arguments):
        loss = step(*arguments)
        if len(spoilt) < 2 and arguments[0] == 1:
            spoilt.append(loss.isfinite().item())
            return loss * torch.nan
        return loss

    monkeypatch.setattr(phase, "training_step", training_step)
    found = run(phase, data, physics(), state.with_(velocity=torch.zeros_like(state.velocity), physics={}))
    assert spoilt == [True, True]
    torch.testing.assert_close(found.velocity[0], torch.tensor(VELOCITY), rtol=0, atol=0.05)


@pytest.mark.slow
def test_gauss_newton_recovers_the_stiffness_from_a_hundredth(data, state):
    method = GaussNewton(coarse_iterations=2, iterations=6, scan_decades=2.0, coarse_pool=2, pool=1)
    phase = PhysicsIDModule(HIT, method, silhouette_weight=1.0)
    found = run(phase, data, physics(E=TRUTH["E"] / 100), state.with_(physics={}))
    assert abs(math.log10(found.physics["E"] / TRUTH["E"])) < 0.05
    torch.testing.assert_close(found.velocity[0], torch.tensor(VELOCITY), rtol=0, atol=0.05)


@pytest.mark.parametrize(
    "method",
    [
        GaussNewton(0, 2, scan_decades=0.0, pool=2),
        PaperAdam({"E": 0.1, "nu": 0.0}, warm_up_iterations=0, main_iterations=2),
    ],
)
def test_an_identification_stays_inside_the_intervals_that_it_is_given(data, state, method):
    low, high = 0.8 * TRUTH["E"], 0.85 * TRUTH["E"]
    phase = PhysicsIDModule(HIT, method, silhouette_weight=1.0)
    phase.within = {"E": (low, high)}
    found = run(phase, data, physics(), state.with_(physics={**state.physics, "E": low}))
    assert found.physics["E"] == pytest.approx(high, rel=1e-4)


def test_steps_that_failed_on_early_frames_do_not_shorten_those_on_all(monkeypatch):
    """The damping that no coarse step could pass is not carried into the main stage."""
    method, seen = GaussNewton(scan_decades=0.0), []
    module = SimpleNamespace(
        image_cost=SimpleNamespace(pool=0), warm_up_end=2, frames_at=lambda step: FRAMES, fixed_views=lambda *_: []
    )
    optimiser = torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=1.0)
    optimiser.defaults["damping"] = 0.01
    optimiser.param_groups[0]["damping"] = 150.0
    monkeypatch.setattr(
        optimiser, "step", lambda _: seen.append(optimiser.param_groups[0]["damping"]) or SimpleNamespace(loss=1.0)
    )
    for step in range(4):
        method.iterate(module, optimiser, step)
    assert seen == [150.0, 150.0, 0.01, 0.01]


def test_the_fall_is_not_rendered_again_for_another_stiffness(data, state, monkeypatch):
    """The normal equations are the same where it is; only velocity probes need the frames before contact again."""
    method = GaussNewton(scan_decades=0.0, pool=1)
    phase = PhysicsIDModule(HIT, method)
    phase.attach(data, physics(E=TRUTH["E"] / 2))
    phase.import_state(state.with_(physics={}))
    method._frames, method._views = FRAMES, phase.fixed_views(FRAMES, 1)
    rendered: list[int] = []
    residual = phase.residual

    def counted(motion, view, frame):
        rendered.append(frame)
        return residual(motion, view, frame)

    monkeypatch.setattr(phase, "residual", counted)
    quick = method.normal_equations(phase)
    assert rendered.count(0) == 1 and rendered.count(1) == 4, "velocity moves frame 1, nothing moves frame 0"
    assert rendered.count(FRAMES - 1) == 1 + len(phase.scales), "after contact every probe counts"
    monkeypatch.setattr(identification_methods, "UNSEEN", -1.0)
    whole = method.normal_equations(phase)
    assert quick.loss == whole.loss
    for found, expected in ((quick.gradient, whole.gradient), (quick.hessian, whole.hessian)):
        torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-3 * expected.abs().max().item())


def test_adam_moves_the_stiffness_towards_the_truth(data, state):
    guess = TRUTH["E"] / 5
    phase = PhysicsIDModule(HIT, PaperAdam({"nu": 0.0}, warm_up_iterations=2, main_iterations=4))
    found = run(phase, data, physics(E=guess), state.with_(physics={}))
    assert guess * 1.5 < found.physics["E"] < TRUTH["E"] * 1.5
    assert found.physics["nu"] == pytest.approx(TRUTH["nu"], rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("positions", "features"), [(True, True), (True, False), (False, True)])
def test_lpo_changes_what_it_may_and_lowers_the_cost(data, state, positions, features):
    noise = torch.randn(state.positions.shape, generator=torch.Generator().manual_seed(2))
    wrong = state.with_(positions=state.positions + 0.015 * noise, features=state.features + 0.5)
    model = physics()
    corrected = run(LPOModule(12, positions, features), data, model, wrong)
    assert corrected.corrected and not wrong.corrected
    assert (corrected.positions != wrong.positions).any() == positions
    assert (corrected.features != wrong.features).any() == features
    before, after = (
        ImageCost(data, s).loss(model.simulate(s, FRAMES)[None], s.density, s.features, [[0, 1, 2]] * FRAMES).item()
        for s in (wrong, corrected)
    )
    assert after < 0.9 * before


def test_lpo_tells_how_well_the_test_views_are_shown(data, state, monkeypatch):
    """Of images that it does not learn from: as good as the wrong place allows, and better later."""
    split = SimpleNamespace(**{**vars(data), "train": [0, 1], "test": [2]})
    wrong = state.with_(positions=state.positions + torch.tensor([0.03, 0.0, 0.0]))
    phase, told = LPOModule(11, features=False), {}
    monkeypatch.setattr(
        phase, "log", lambda name, value: told.setdefault(name, []).append(float(torch.as_tensor(value).detach()))
    )
    run(phase, split, physics(), wrong)
    found = told["correction/PSNR of test views [dB]"]
    assert len(found) == 3 and found[-1] > found[0] + 1.0
    cost, path = ImageCost(split, wrong), physics().simulate(wrong, FRAMES)
    squares = [
        cost.residual(path[frame], wrong.density, wrong.features, 2, frame).square().mean() for frame in range(FRAMES)
    ]
    assert found[0] == pytest.approx(-10 * math.log10(sum(squares) / FRAMES), abs=1e-3)


def test_lpo_exports_what_fits_better_than_the_last_particles(data, state):
    """A step of 40 cm throws the particles apart; what was there before it is kept."""
    corrected = run(LPOModule(1, features=False, position_rate=0.4 / DX), data, physics(), state)
    torch.testing.assert_close(corrected.positions, state.positions, rtol=0, atol=0)


def test_views_rotate_and_cover_all(data, state):
    phase = VelocityModule(HIT)
    phase.attach(data, physics())
    assert phase.fixed_views(3, None) == [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
    assert phase.fixed_views(4, 1) == [[0], [1], [2], [0]]
    assert phase.one_view_per_frame(5, 40) == phase.one_view_per_frame(5, 40) != phase.one_view_per_frame(6, 40)


def test_wrong_settings_are_found_when_the_phase_is_attached(data, state):
    with pytest.raises(UserInputError, match="hit_frame = 9"):
        VelocityModule(9).attach(data, physics())
    slow = physics()
    slow.frame_rate = 30.0
    with pytest.raises(UserInputError, match="frame_rate"):
        VelocityModule(HIT).attach(data, slow)
    with pytest.raises(UserInputError, match="both false"):
        LPOModule(positions=False, features=False)


def test_solid_fraction_is_half_where_two_and_a_half_voxels_stop_half_the_light():
    density = torch.linspace(-20, 80, 100_001, dtype=torch.float64)
    fraction = solid_fraction(density, DX, 2 * DX)
    edge = density[(fraction - 0.5).abs().argmin()]
    light = torch.exp(-5 * optical_depth(edge, sample_length(DX, 2 * DX)))
    assert light.item() == pytest.approx(0.5, abs=1e-3)  # the lattice is 1e-3 wide


def test_an_identification_that_is_resumed_when_it_was_done_still_says_so(data, state, monkeypatch):
    monkeypatch.setattr(GaussNewton, "converged", lambda *_: True)
    monkeypatch.setattr(PhysicsIDModule, "global_step", 1000)  # after the warm-up
    monkeypatch.setattr(PhysicsIDModule, "optimizers", lambda _: None)
    monkeypatch.setattr(PhysicsIDModule, "trainer", SimpleNamespace(should_stop=False))
    phase = PhysicsIDModule(HIT, GaussNewton())
    phase.attach(data, physics())
    phase.import_state(state)
    phase.on_train_start()
    assert phase.trainer.should_stop
    assert phase.course()["converged"]
