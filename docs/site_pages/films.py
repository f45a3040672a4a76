"""Films of the gallery: ``python docs/site_pages/films.py [NAME ...]`` simulates and writes ``docs/gallery/NAME.webp``.

On the left the body without the effect, on the right with it; what the left one does is a grey shadow there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw

sys.path.insert(0, str(Path(__file__).parents[1]))
from pacnerf_lpo.data.shapes import fill
from pacnerf_lpo.mpm.simulator import Simulator
from pacnerf_lpo.render.camera_faults.base import Observation, faults_of
from site_pages.scenes import COMPARISONS, Scene

FOLDER = Path(__file__).parents[1] / "gallery"
DX, RATE, FRAMES, MILLISECONDS = 0.05, 3600, 25, 70
PIXELS, FINER = 200, 2
CAMERA = torch.tensor([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.44], [0.0, 0.0, 1.0, 3.0]])
"""Pose [m, OpenGL axes]: in front of the body, which it sees from the side."""
FOCAL = 5.2
PAPER, SHADOW, GROUND = (246, 246, 244), (203, 203, 201), (228, 222, 212)
ALONG = [-1.5 + 0.125 * k for k in range(25)]
GROUND_CORNERS = [[x, 0.0, -1.5] for x in ALONG] + [[x, 0.0, 2.0] for x in reversed(ALONG)]
DARK, BRIGHT = np.array([176.0, 74.0, 36.0]), np.array([240.0, 176.0, 84.0])


def motion(scene: Scene) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions at every frame [m, (frames, N, 3)] and colours at frame 0 [0..1, (N, 3)]."""
    generator = torch.Generator().manual_seed(0)
    inside = fill(scene.body, DX / 2, generator)
    count, dt = len(inside), scene.seconds / (FRAMES - 1)
    simulator = Simulator(
        scene.material, scene.ground, dx=DX, substeps=round(RATE * dt), frame_dt=dt,
        effects=[effect for effect in scene.effects if effect.acts_on_motion],
    )  # fmt: skip
    with torch.no_grad():
        path = simulator(
            inside + torch.tensor(scene.place),
            torch.tensor(scene.velocity).expand(count, 3).contiguous(),
            torch.full((count,), 1000.0 * (DX / 2) ** 3),
            torch.ones(count),
            {name: torch.tensor(value) for name, value in scene.material.guess.items()},
            FRAMES,
        )
    x, y, _ = inside.numpy().T
    stripes = (np.floor(x / 0.065) + np.floor(y / 0.065)) % 2
    return path, torch.from_numpy((DARK + stripes[:, None] * (BRIGHT - DARK)) / 255).float()


def seen(points: torch.Tensor, t: float, faults: tuple[Observation, ...]) -> torch.Tensor:
    """Pixels across and down, and distance, of points [m, (N, 3)] at time ``t`` [s]."""
    pose, coefficients = CAMERA, [fault.coefficients(_values(fault)) for fault in faults]
    for fault, c in zip(faults, coefficients, strict=True):
        pose = fault.camera(0, pose, t, c)
    local = (points - pose[:, 3]) @ pose[:, :3]
    uv = local[:, :2] / -local[:, 2:]
    for fault, c in zip(faults, coefficients, strict=True):
        uv = fault.image_plane(0, uv, c)
    pixels = PIXELS * FINER * (0.5 + FOCAL / 2 * uv * torch.tensor([1.0, -1.0]))
    return torch.cat((pixels, -local[:, 2:]), dim=1)


def drawn(
    path: torch.Tensor, colours: torch.Tensor, frame: int, scene: Scene, shadow: torch.Tensor | None
) -> Image.Image:
    """One panel: ground, shadow and body."""
    faults, dt = faults_of(scene.effects), scene.seconds / (FRAMES - 1)
    t = torch.tensor(frame * dt)
    for fault in faults:
        t = fault.time(t, fault.coefficients(_values(fault)))
        colours = fault.colour(0, colours, float(t), fault.coefficients(_values(fault)))
    at = float(t / dt)
    low = min(max(int(at), 0), FRAMES - 2)
    points = path[low] + (at - low) * (path[low + 1] - path[low])
    panel = Image.new("RGB", (PIXELS * FINER, PIXELS * FINER), PAPER)
    pen = ImageDraw.Draw(panel)
    plane = seen(torch.tensor(GROUND_CORNERS), float(t), faults)
    pen.polygon([(float(x), float(y)) for x, y, _ in plane], fill=GROUND)
    if shadow is not None:
        _dots(pen, seen(shadow, frame * dt, ()), [SHADOW] * len(shadow))
    shade = torch.clamp(colours, 0, 1).numpy() * 255
    _dots(pen, seen(points, float(t), faults), [tuple(map(int, colour)) for colour in shade])
    return panel.resize((PIXELS, PIXELS), Image.Resampling.LANCZOS)


def _dots(pen: ImageDraw.ImageDraw, pixels: torch.Tensor, colours: list[tuple[int, ...]]) -> None:
    radius = 0.6 * DX / 2 * FOCAL / 2 * PIXELS * FINER / float(CAMERA[2, 3])
    for index in torch.argsort(pixels[:, 2], descending=True).tolist():
        x, y = pixels[index, :2].tolist()
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colours[index])


def _values(fault: Observation) -> dict[str, torch.Tensor]:
    return {name: torch.tensor(value) for name, value in fault.guess.items()}


def film(name: str) -> list[Image.Image]:
    """The frames of a comparison."""
    compared = COMPARISONS[name]
    left, colours = motion(compared.left)
    right, _ = motion(compared.right)
    frames = []
    for k in range(FRAMES):
        frame = Image.new("RGB", (2 * PIXELS + 4, PIXELS), (255, 255, 255))
        frame.paste(drawn(left, colours, k, compared.left, None), (0, 0))
        frame.paste(drawn(right, colours, k, compared.right, left[k]), (PIXELS + 4, 0))
        frames.append(frame)
    return frames


def main(names: list[str]) -> None:
    """Write the films of these names; of all of them where none is given."""
    FOLDER.mkdir(exist_ok=True)
    for name in names or COMPARISONS:
        first, *more = film(name)
        path = FOLDER / f"{name}.webp"
        pauses = [*[MILLISECONDS] * (FRAMES - 1), 900]
        first.save(path, save_all=True, append_images=more, duration=pauses, loop=0, quality=55, method=6)
        print(f"{path} {path.stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
