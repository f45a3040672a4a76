"""The static phase on a ball with two colours, seen by six small cameras."""

import logging
from pathlib import Path

import pytest
import pytorch_lightning as pl
import torch
from torch.nn.functional import normalize

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.phases import static_grid
from pacnerf_lpo.phases.schedules import Constant, Doubling, DoublingThenHalving, TrainingLength
from pacnerf_lpo.phases.static_grid import StaticGridModule
from pacnerf_lpo.render.image import render_view
from pacnerf_lpo.scene.activation import alpha
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import Box, ParticleState, Rays, Video

CENTRE, RADIUS, SIZE = torch.tensor([0.05, 0.5, 0.0]), 0.22, 24
BOX = Box((-0.4, 0.1, -0.4), (0.4, 0.9, 0.4))


class BallData(pl.LightningDataModule):
    """Analytic images of an opaque ball, red above and blue below, on white. The last view is for testing."""

    def __init__(self) -> None:
        super().__init__()
        eyes = normalize(torch.tensor([[2, 1, 0], [-2, 1, 0], [0, 1, 2], [0, 1, -2.0], [0.3, 3, 0], [2, 1, 2]]), dim=1)
        self.cached = [camera_rays(CENTRE + 2 * eye) for eye in eyes]
        images = torch.stack([ball_image(rays) for rays in self.cached])[:, None]
        valid = torch.ones(6, SIZE, SIZE, dtype=torch.bool)
        opacity = (images < 1).any(-1).float()
        poses, intrinsics = torch.zeros(6, 3, 4), torch.zeros(6, 3, 3)
        self.video = Video(images, opacity, valid, poses, intrinsics, torch.zeros(1), tuple(range(6)), (0,))
        self.train, self.test, self.box = [0, 1, 2, 3, 4], [5], BOX

    def rays(self, view: int) -> Rays:
        return self.cached[view]

    first_rays = rays

    def train_dataloader(self):
        return torch.utils.data.DataLoader(self.trainer.lightning_module.batches(self), batch_size=None)


def camera_rays(eye: torch.Tensor) -> Rays:
    """SIZE x SIZE rays of a camera at ``eye`` that looks at the ball."""
    forward = normalize(CENTRE - eye, dim=0)
    right = normalize(torch.linalg.cross(forward, torch.tensor([0.0, 1.0, 0.01])), dim=0)
    up = torch.linalg.cross(right, forward)
    across = ((torch.arange(SIZE) + 0.5) / SIZE - 0.5) * 0.45
    directions = forward + across[None, :, None] * right - across[:, None, None] * up
    return Rays(eye.expand(SIZE * SIZE, 3).contiguous(), normalize(directions.flatten(0, 1), dim=1))


def ball_image(rays: Rays) -> torch.Tensor:
    """Ray-sphere intersection, coloured by height."""
    towards = CENTRE - rays.origins
    along = (towards * rays.directions).sum(1)
    half_chord = RADIUS**2 - (towards.square().sum(1) - along**2)
    height = (rays.origins + (along - half_chord.clamp_min(0).sqrt())[:, None] * rays.directions)[:, 1]
    colours = torch.where(height[:, None] > CENTRE[1], torch.tensor([0.8, 0.2, 0.2]), torch.tensor([0.2, 0.2, 0.8]))
    return torch.where(half_chord[:, None] > 0, colours, torch.ones(3)).view(SIZE, SIZE, 3)


def static_phase(data: BallData, steps: int, scaling_steps: list[int], **options) -> StaticGridModule:
    phase = StaticGridModule(
        base_spacing=0.16,
        entropy_weight=1e-3,
        entropy_schedule=Doubling(1000),
        length=TrainingLength(steps, scaling_steps),
        rays_per_step=256,
        **{"surface_weight": 1e-3, "surface_schedule": Constant(), **options},
    )
    phase.attach(data, Physics(NeoHookean(E=1e5, nu=0.3)))
    phase.import_state(None)
    return phase


def trainer(**options) -> pl.Trainer:
    logging.getLogger("pytorch_lightning").setLevel(logging.ERROR)
    quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False, "accelerator": "cpu"}
    return pl.Trainer(max_epochs=1, **{**quiet, "enable_checkpointing": False, **options})


def view_error(phase: StaticGridModule, state: ParticleState, data: BallData, view: int) -> tuple[float, float]:
    """PSNR [dB] of the particles' image of a view, and the intersection over union of its silhouette."""
    grid = particles_to_grid(state.positions, state.density, state.features, state.spacing)
    colour = ColourNetwork()
    colour.load_state_dict(state.colour_network)
    image, opacity = render_view(grid, colour, data.rays(view), (SIZE, SIZE), state.base_spacing)
    seen, true = opacity > 0.5, data.video.silhouettes[view, 0] > 0.5
    error = (image - data.video.images[view, 0]).square().mean()
    return float(-10 * error.log10()), float((seen & true).sum() / (seen | true).sum())


@pytest.mark.slow
@pytest.mark.usefixtures("small_threads")
def test_fits_a_ball_from_five_views():
    data = BallData()
    phase = static_phase(data, 400, [150, 300])
    trainer().fit(phase, datamodule=data)
    state = phase.export_state()
    quality, overlap = view_error(phase, state, data, 5)
    assert quality > 20
    assert overlap > 0.85
    assert state.spacing == pytest.approx(0.04)
    assert state.velocity.abs().max() == 0
    assert state.physics == {}
    weight = alpha(state.density, 1.0)
    radius = float(weight.sum() * (state.spacing / 2) ** 3 / (4 / 3 * torch.pi)) ** (1 / 3)
    centre = (weight[:, None] * state.positions).sum(0) / weight.sum()
    # Alpha-weighted volume and centre are the ball's, give or take a cell of the final grid.
    assert abs(radius - RADIUS) < state.spacing
    assert (centre - CENTRE).abs().max() < state.spacing
    again = phase.export_state()
    assert torch.equal(again.positions, state.positions)


class Interrupt(pl.Callback):
    """Writes a checkpoint after a number of steps and stops."""

    def __init__(self, step: int, path: Path):
        self.step, self.path = step, path

    def on_train_batch_end(self, trainer, *_):
        if trainer.global_step == self.step:
            trainer.save_checkpoint(self.path)
            trainer.should_stop = True


@pytest.mark.slow
@pytest.mark.usefixtures("small_threads")
@pytest.mark.parametrize("stop", [16, 21], ids=["just before a scaling", "after a scaling"])
def test_resumed_run_gives_the_same_particles(tmp_path, stop):
    data, options = (
        BallData(),
        {"view_invariant_weight": 0.1, "surface_schedule": DoublingThenHalving(5), "grid_rate": 1.0},
    )
    whole = static_phase(data, 30, [10, 16], **options)
    trainer().fit(whole, datamodule=data)
    first = static_phase(data, 30, [10, 16], **options)
    trainer(callbacks=[Interrupt(stop, tmp_path / "last.ckpt")], min_steps=1).fit(first, datamodule=data)
    second = static_phase(data, 30, [10, 16], **options)
    resumed = trainer()
    resumed.fit(second, datamodule=data, ckpt_path=tmp_path / "last.ckpt", weights_only=True)
    assert resumed.global_step == 30
    # The same operations on the same numbers in the same order, on one thread: equal to the last bit.
    assert torch.equal(second.field.density, whole.field.density)
    assert all(torch.equal(a, b) for a, b in zip(second.colour.parameters(), whole.colour.parameters(), strict=True))


def test_logged_values(tmp_path, monkeypatch):
    """Every loss and schedule value is logged under static/, every so many steps."""
    monkeypatch.setattr(static_grid, "LOGGED_EVERY", 3)
    data, logged = BallData(), {}
    options = {"view_invariant_weight": 0.1, "silhouette_weight": 0.2, "surface_schedule": DoublingThenHalving(3)}
    phase = static_phase(data, 12, [6], **options, grid_rate=1.0)

    class Record(pl.Callback):
        def on_train_batch_end(self, trainer, *_):
            logged[trainer.global_step] = {name: float(value) for name, value in trainer.logged_metrics.items()}

    logger = pl.loggers.CSVLogger(tmp_path)
    trainer(callbacks=[Record()], logger=logger, log_every_n_steps=1).fit(phase, datamodule=data)
    terms = ("pixel", "entropy", "surface", "view_invariant", "silhouette")
    names = {"loss", "psnr", "spacing", *terms, *(f"{term}_weight" for term in terms)}
    assert {f"static/{name}" for name in names} <= set(logged[1])
    assert [logged[step]["static/surface_weight"] for step in (1, 4, 7)] == pytest.approx([1e-3, 2e-3, 2e-3])
    assert [logged[step]["static/spacing"] for step in (4, 7)] == pytest.approx([0.16, 0.08])
    assert logged[4] == logged[6] != logged[7]
    last = logged[10]
    total = sum(last[f"static/{term}_weight"] * last[f"static/{term}"] for term in terms)
    assert last["static/loss"] == pytest.approx(total, rel=1e-5)


def test_entropy_weight_is_limited():
    phase = static_phase(BallData(), 9000, [1000])
    weights = [phase.weights_at(step)["entropy"] for step in (0, 1000, 6999, 8999)]
    assert weights == pytest.approx([1e-3, 2e-3, 64e-3, 0.1])


def test_occluded_pixels_are_not_trained_on():
    data = BallData()
    data.video.valid[:, :, :12] = False
    phase = static_phase(data, 10, [])
    pixels = phase.pixels_through_box(0)
    assert len(pixels) > 0
    assert int((pixels % SIZE).min()) >= 12


def test_too_strong_a_surface_regulariser_is_explained():
    data = BallData()
    phase = static_phase(data, 60, [50], surface_weight=1e3)
    with pytest.raises(UserInputError, match="vanished"):
        trainer().fit(phase, datamodule=data)


def test_impossible_spacing():
    with pytest.raises(UserInputError, match="base_spacing"):
        StaticGridModule(0.0, 1e-3, 1e-3, Constant(), Constant(), TrainingLength(10, []))
