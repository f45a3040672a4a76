"""A finished run made without training: a visual hull of the shipped scene, falling along a closed-form motion."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch
import yaml
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from pacnerf_lpo.data.cameras import project
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.manifest import Manifest, PhaseRecord
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import FEATURES, ParticleState

SPACING = 0.06
PHASES = (("static", 0), ("velocity", 0), ("physics", 1), ("correction", 1))


def write_example_run(
    folder: Path,
    root: str = "asset:bird",
    train: tuple[int, ...] = (0, 4, 8),
    test: tuple[int, ...] = (2,),
    frames: int = 5,
    image_scale: float = 0.25,
) -> Path:
    """Write a run directory as ``fit`` would leave it, without evaluation."""
    section = {
        "root": root,
        "box_lower": [-0.6, 0.05, -0.6],
        "box_upper": [0.6, 1.2, 0.6],
        "train_views": list(train),
        "test_views": list(test),
        "frames": frames,
        "image_scale": image_scale,
    }
    material = {"class_path": "pacnerf_lpo.mpm.materials.NeoHookean", "init_args": {"E": 3e4, "nu": 0.2}}
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(
        yaml.safe_dump({"seed_everything": 0, "data": section, "physics": {"material": material}})
    )
    write_phases(folder, visual_hull(VideoData(**section).prepare()))
    return folder


def write_phases(folder: Path, start: ParticleState) -> None:
    """Manifest, states and TensorBoard events of one round."""
    (folder / "states").mkdir()
    manifest = Manifest(folder, "finished")
    writer = SummaryWriter(str(folder / "tensorboard"))
    first = 0
    for index, (phase, number) in enumerate(PHASES):
        stem = f"{index:02d}_{phase}" if number == 0 else f"{index:02d}_r{number}_{phase}"
        steps = 200 if phase == "static" else 12
        state = start.with_(
            physics={} if phase == "static" else {"E": 9.7e4 if number else 3e4, "nu": 0.31 if number else 0.2}
        )
        state = (
            state
            if phase == "static"
            else state.with_(velocity=torch.tensor([0.0, -0.5, 0.0]).expand(len(state.density), 3))
        )
        state.save(folder / "states" / f"{stem}.pt")
        manifest.phases.append(
            PhaseRecord(
                index, number, phase, "done", f"checkpoints/{stem}/last.ckpt", f"states/{stem}.pt", 40.0 + index, steps
            )
        )
        for step in range(steps):
            writer.add_scalar(f"{phase}/loss", 0.2 * 0.7 ** (step / 4) + 0.004, first + step)
            if phase == "physics":
                writer.add_scalar("physics/E [Pa]", 9.7e4 - 6.7e4 * 0.6**step, first + step)
                writer.add_scalar("physics/nu [1]", 0.31 - 0.11 * 0.8**step, first + step)
            if phase in ("velocity", "physics"):
                for axis, value in zip("xyz", (0.0, -0.5, 0.0), strict=True):
                    writer.add_scalar(f"{phase}/v_{axis} [m|s]", value * (1 - 0.6**step), first + step)
        first += steps
    writer.close()
    manifest.save()


def visual_hull(data: VideoData) -> ParticleState:
    """Grid points that every view sees inside the silhouette of frame 0, as particles of one colour."""
    axes = [torch.arange(low, high, SPACING / 2) for low, high in zip(data.box_lower, data.box_upper, strict=True)]
    points = torch.cartesian_prod(*axes)
    inside = torch.ones(len(points), dtype=torch.bool)
    video = data.video
    height, width = video.silhouettes.shape[2:]
    for view in range(len(video.view_ids)):
        pixels, _ = project(points, video.intrinsics[view], video.camera_to_world[view])
        columns, rows = pixels.floor().long().unbind(1)
        seen = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        silhouette = video.silhouettes[view, 0] > 0.5
        inside &= seen & silhouette[rows.clamp(0, height - 1), columns.clamp(0, width - 1)]
    points = points[inside]
    torch.manual_seed(0)
    return ParticleState(
        positions=points,
        velocity=torch.zeros_like(points),
        density=torch.full((len(points),), 80.0),
        features=torch.randn(FEATURES).expand(len(points), FEATURES).clone(),
        physics={},
        spacing=SPACING,
        base_spacing=SPACING,
        colour_network=ColourNetwork().state_dict(),
    )


@contextmanager
def closed_form_motion() -> Iterator[None]:
    """Every simulation follows the closed form."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Physics, "simulate", lambda self, state, frames: falling(state, frames))
        yield


def falling(state: ParticleState, frames: int) -> Tensor:
    """Free fall at 24 frames/s that stops, squashed, when the lowest particle is at the ground [m, (F, N, 3)]."""
    time = (torch.arange(frames) / 24)[:, None, None]
    moved = state.positions + state.velocity * time - torch.tensor([0.0, 4.9, 0.0]) * time**2
    lowest = moved[..., 1].amin(1, keepdim=True)
    squash = 1 + 0.5 * lowest.clamp(max=0) / state.positions[:, 1].amax()
    height = (moved[..., 1] - lowest) * squash + lowest.clamp(min=0.0)
    return torch.stack((moved[..., 0], height, moved[..., 2]), dim=-1)
