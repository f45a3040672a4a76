"""What a finished phase predicts for the video: particle positions and rendered images, kept on disk for later looks.

``RUN/predictions/<stem>/positions.npy`` [m, (F, N, 3) float32] and ``images.npy`` [(V, F, H, W, 3) uint8]; the static
phase has one frame. They are read memory-mapped and are made anew when the particle state is newer.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.lib.format import open_memmap
from torch import Tensor
from tqdm import tqdm

from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.mpm import runtime
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.clocks import cameras_of
from pacnerf_lpo.render.image import render_view
from pacnerf_lpo.render.observation import AS_BELIEVED, Observer
from pacnerf_lpo.scene.activation import solid_fraction
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import ParticleState, Rays

FOLDER = "predictions"
INSIDE = 0.5
"""Part of a particle that is full, at the surface that is seen."""
CONTACT_CELLS = 1.5


@dataclass(frozen=True)
class Prediction:
    """A motion [m, (F, N, 3), float32] and its images [0..255, (V, F, H, W, 3), uint8], views as in the video."""

    positions: np.ndarray
    images: np.ndarray


def predict(run: Run, stage: Stage) -> Prediction:
    """Simulate and render a phase, or read it where that was done before. Raises SimulationError."""
    if not _is_current(run, stage, "images", "positions"):
        frames, views = len(run.data.video.times) if stage.moves else 1, len(run.data.video.view_ids)
        bar = tqdm(render_stage(run, stage), f"rendering {stage.label}", frames * views, delay=2.0, leave=False)
        for _ in bar:
            pass
    return read_prediction(run, stage)


def motion_of(run: Run, stage: Stage) -> np.ndarray:
    """Positions at every frame [m, (F, N, 3), float32]: as predicted, or simulated now. Raises SimulationError."""
    if _is_current(run, stage, "positions"):
        return np.load(prediction_folder(run, stage) / "positions.npy")
    if stage.moves:
        print(f"{run.run_dir}: simulating {stage.label}", file=sys.stderr)
    return simulate(run, stage).numpy().astype(np.float32)


def read_prediction(run: Run, stage: Stage) -> Prediction:
    """Open what was predicted before, memory-mapped."""
    folder = prediction_folder(run, stage)
    return Prediction(*(np.load(folder / f"{name}.npy", mmap_mode="r") for name in ("positions", "images")))


def prediction_folder(run: Run, stage: Stage) -> Path:
    """Where a phase's prediction is kept."""
    return run.run_dir / FOLDER / stage.stem


def simulate(run: Run, stage: Stage) -> Tensor:
    """Positions at every frame of the video [m, (F, N, 3)]; the static phase has frame 0 only."""
    if not stage.moves:
        return stage.state.positions[None]
    run.physics.halvings = 0
    return run.physics.simulate(stage.state, len(run.data.video.times))


def render_stage(run: Run, stage: Stage) -> Iterator[tuple[int, int, Tensor, Tensor]]:
    """Render every frame into every view, and keep positions and images on disk.

    Yields:
        frame and view index, image [0..1, (H, W, 3)], opacity [0..1, (H, W)].
    """
    positions = simulate(run, stage)
    renderer = StateRenderer(stage.state)
    video, observer = run.data.video, AS_BELIEVED
    if stage.moves:  # as long as nothing has moved, nothing is known to be wrong about the cameras
        observer = Observer(cameras_of(run.physics.effects, video), run.physics.values(stage.state))
    seen = observer.seen(positions, run.physics.velocity_of(stage.state), video.times[: len(positions)])
    views, _, height, width, _ = video.images.shape
    folder = prediction_folder(run, stage)
    folder.mkdir(parents=True, exist_ok=True)
    shape = (views, len(positions), height, width, 3)
    images = open_memmap(folder / "images.npy", mode="w+", dtype=np.uint8, shape=shape)
    for frame in range(len(positions)):
        grids = [renderer.grid(points) for points in seen[:, frame]]
        for view, view_id in enumerate(video.view_ids):
            rays = observer.rays(run.data, view, frame) if stage.moves else run.data.first_rays(view)
            image, opacity = renderer.image(grids[observer.clock(view_id)], rays, (height, width))
            image = observer.colour(image, 1 - opacity, video, view, frame)
            images[view, frame] = to_bytes(image)
            yield frame, view, image, opacity
    images.flush()
    np.save(folder / "positions.npy", positions.numpy().astype(np.float32))


class StateRenderer:
    """Renders the particles of a state at any positions, with the state's appearance and colour network.

    It renders on the device of the process; images are on the CPU.
    """

    def __init__(self, state: ParticleState):
        self.state, self.device = state, runtime.device()
        self.colour = ColourNetwork()
        self.colour.load_state_dict(state.colour_network)
        self.colour.to(self.device)

    @torch.no_grad()
    def grid(self, positions: Tensor):
        """The field of the particles at these positions [m, (N, 3)]."""
        density, features = self.state.density.to(self.device), self.state.features.to(self.device)
        return particles_to_grid(positions.to(self.device), density, features, self.state.spacing)

    def image(self, grid, rays: Rays, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
        """Image [0..1, (H, W, 3)] and opacity [(H, W)] of a field."""
        image, opacity = render_view(grid, self.colour, rays.to(self.device), size, self.state.base_spacing)
        return image.cpu(), opacity.cpu()

    def particle_colours(self, direction: tuple[float, float, float] = (0.0, -0.6, -0.8)) -> Tensor:
        """RGB of every particle seen along one unit direction [0..1, (N, 3)]."""
        return self.colours(self.state.features, torch.tensor(direction).expand(len(self.state.features), 3))

    @torch.no_grad()
    def colours(self, features: Tensor, directions: Tensor) -> Tensor:
        """RGB [0..1, (S, 3)] of features (S, 12) seen along unit ``directions`` (S, 3)."""
        return self.colour(features.to(self.device), directions.to(self.device)).cpu()


def contact_of(run: Run, stage: Stage) -> int | None:
    """First frame in which the visible particles of a phase that was predicted feel the ground; None: in none."""
    positions = np.load(prediction_folder(run, stage) / "positions.npy", mmap_mode="r")
    lowest = positions[:, visible_particles(stage.state), 1].min(axis=1)
    return contact_frame(lowest, stage.state.spacing, stage.state.physics.get(GROUND_HEIGHT.name, 0.0))


def contact_frame(lowest: np.ndarray, spacing: float, ground: float = 0.0) -> int | None:
    """First frame in which the lowest particle, at these heights [m, (F,)], feels a ground at its height [m]: its
    quadratic kernel, 1.5 cells of that spacing [m] wide, reaches it.
    """
    touching = lowest - ground < CONTACT_CELLS * spacing
    return int(touching.argmax()) if touching.any() else None


def visible_particles(state: ParticleState) -> np.ndarray:
    """Indices of the particles inside the visible surface, see :func:`solid_fraction`, all of a body without one: the
    others are a rim of a voxel that hardly anything is seen of.
    """
    inside = solid_fraction(state.density, *state.spacings) >= INSIDE
    return torch.nonzero(inside | ~inside.any()).flatten().numpy()


def to_bytes(image: Tensor) -> np.ndarray:
    """Values in 0..1 to 0..255, rounded."""
    return (image.clamp(0, 1) * 255 + 0.5).to(torch.uint8).numpy()


def _is_current(run: Run, stage: Stage, *names: str) -> bool:
    files = [prediction_folder(run, stage) / f"{name}.npy" for name in names]
    written = stage.state_path.stat().st_mtime
    return all(file.is_file() and file.stat().st_mtime >= written for file in files)
