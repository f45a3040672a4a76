"""Two commands from six videos to a stiffness, as a new user would type them: ``init``, then ``fit --preset quick``.

    python -m validation.own_recording --work runs/own

films thrown elastic bodies (128 x 128 pixels, a calibration of OpenCV's kind in millimetres with z up, camera noise,
H.264, images of the empty backgrounds), runs both commands, and writes ``results/own_recording.json`` and the page made
of it. The bodies are simulated on a finer grid, with a smaller time step and other particles than ``quick`` has.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import torch
from scipy import ndimage

from pacnerf_lpo.commands.synthesize import dropped, patches, placed
from pacnerf_lpo.data import skin
from pacnerf_lpo.data.shapes import Block, Shape, Torus
from pacnerf_lpo.data.synthetic import draw_discs, hemisphere_rig, shade
from pacnerf_lpo.diagnosis.run_problem import RunProblem
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.quantities import published
from validation.record import Record, keep, made, origin

VIEWS, FRAMES, PIXELS, FPS, DX = 6, 20, 128, 30.0, 0.02
HEIGHT, VELOCITY, POISSON = 0.62, (0.9, 0.3, -0.5), 0.35
NOISE = 0.01
SHAPES: dict[str, Shape] = {"torus": Torus(0.17, 0.075), "block": Block((0.36, 0.22, 0.28))}
VOLUMES = {"torus": 2 * np.pi**2 * 0.17 * 0.075**2, "block": 0.36 * 0.22 * 0.28}
"""Of the bodies [m^3]."""
Z_UP = np.array([[1, 0, 0], [0, 0, -1.0], [0, 1, 0]])
ORIGIN = np.array([0.4, -0.3, 0.8])
"""Of the world of the calibration, in metres: its axes and its origin are not those of the simulation."""
RECORDINGS = (
    ("torus", 1e5, 3),
    ("block", 1e5, 4),
    ("torus", 6e4, 5),
    ("block", 2e5, 6),
    ("torus", 2.5e5, 7),
    ("block", 5e4, 8),
)
"""Body, Young's modulus [Pa] and seed: all were looked at while the method was built. Fresh ones have other seeds."""


@dataclass(frozen=True)
class Row:
    """One recording: seconds of both commands, and what came out [Pa].

    law: that ``fit`` has chosen
    best: Young's modulus that it identified;  low, high: ends of its 90 % interval, with errors of the solver;  nu: all
        None where the law has other parameters
    particles: of the run
    volume: of the reconstructed body relative to that of the true one
    """

    body: str
    true: float
    seed: int
    init_s: float
    fit_s: float
    law: str
    best: float | None
    low: float | None
    high: float | None
    nu: float | None
    particles: int
    volume: float
    doubts: list[str]


def film(folder: Path, body: str, young: float, seed: int) -> None:
    """Write videos, backgrounds and calibration of one throw, unless they are there."""
    if (folder / "calibration.json").is_file():
        return
    (folder / "backgrounds").mkdir(parents=True, exist_ok=True)
    generator, random = torch.Generator().manual_seed(seed), np.random.default_rng(seed)
    physics = Physics(NeoHookean(E=young, nu=POISSON), substep_rate=9000.0, frame_rate=FPS)
    path = physics.simulate(dropped(SHAPES[body], HEIGHT, VELOCITY, DX, generator), FRAMES)
    apart = DX / 2 / skin.FINER
    points = placed(SHAPES[body], HEIGHT, apart, generator)
    moved = skin.carried(points.double().numpy(), path.double().numpy()) - [0.25, 0.0, -0.15]
    colours, rig, cameras = patches(points), hemisphere_rig(VIEWS, PIXELS, distance=2.9), {}
    for view in range(VIEWS):
        pose, intrinsic = rig.camera_to_world[view], rig.intrinsics[view]
        cloth = ndimage.gaussian_filter(random.random((PIXELS, PIXELS, 3)), (5, 5, 0), mode="wrap")
        back = np.array([0.1, 0.35, 0.45]) + np.array([0.15, 0.35, 0.35]) * (cloth - cloth.min()) / np.ptp(cloth)
        frames = []
        for positions in moved:
            drawn, black = (
                draw_discs(positions, c, pose, intrinsic, PIXELS, skin.COVER * apart, skin.OUTLINE * apart)
                for c in (shade(positions, colours), np.zeros_like(colours))
            )
            empty = black[..., :1]
            frames.append(drawn - empty + empty * back + NOISE * random.standard_normal(drawn.shape))
        film = np.round(255 * np.stack(frames).clip(0, 1)).astype(np.uint8)
        options = {"plugin": "FFMPEG", "output_params": ["-crf", "12"], "macro_block_size": 2}
        imageio.imwrite(folder / f"cam{view}.mp4", film, fps=FPS, **options)
        imageio.imwrite(folder / "backgrounds" / f"cam{view}.png", np.round(255 * back).astype(np.uint8))
        cameras[f"cam{view}"] = calibrated(pose, intrinsic)
    (folder / "calibration.json").write_text(json.dumps(cameras))


def calibrated(pose: np.ndarray, intrinsic: np.ndarray) -> dict[str, Any]:
    """A camera as OpenCV has it: world to camera, millimetres, z up, centres of pixels at whole numbers."""
    rotation = (Z_UP @ pose[:, :3] * [1, -1, -1]).T
    centre = (Z_UP @ pose[:, 3] + ORIGIN) * 1000
    return {
        "K": (intrinsic - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]).tolist(),
        "dist": [0.0] * 5,
        "R": rotation.tolist(),
        "t": (-rotation @ centre).tolist(),
        "image_width": PIXELS,
        "image_height": PIXELS,
    }


def identified(work: Path, body: str, young: float, seed: int) -> Row:
    """Film one throw, and run both commands on it."""
    recording, scene = work / f"{body}_{seed}", work / f"{body}_{seed}_scene"
    film(recording, body, young, seed)
    init_s = timed("init", str(recording), str(scene), "--unit", "mm")
    fit_s = timed("fit", str(scene), "--preset", "quick")
    results = json.loads((scene / "run" / "results.json").read_text())
    phase = next(phase for phase in results["phases"] if phase["stem"] == results["result"])
    found, intervals = phase["parameters"], results["intervals"]["parameters"]
    low, high = published(intervals["E"]) if "E" in found else (None, None)
    return Row(
        body,
        young,
        seed,
        init_s,
        fit_s,
        results["material"],
        found["E"]["value"] if "E" in found else None,
        low,
        high,
        found["nu"]["value"] if "nu" in found else None,
        phase["particles"],
        RunProblem(Run(scene / "run")).body.volume / VOLUMES[body],
        [doubt["name"] for doubt in results["doubts"]],
    )


def timed(*words: str) -> float:
    """Seconds that a command takes."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-m", "pacnerf_lpo", *words], check=True, stdin=subprocess.DEVNULL)
    return time.monotonic() - began


def page(found: Record) -> str:
    """The record as Markdown."""
    lines = [
        "# Six videos to a stiffness, by two commands",
        "",
        origin(found, "own_recording", "`python -m validation.own_recording --work runs/own`"),
        "",
        "Thrown elastic bodies of nu = 0.35, 128 x 128 pixels, six views, a calibration in millimetres with z up,",
        "simulated at dx 2 cm; then `init RECORDING SCENE --unit mm` and `fit SCENE --preset quick`. **Development",
        "figures**: all of them were looked at while the method was built. Asked: ten minutes in all, E within 0.1 in",
        "log10 and inside its interval. *Volume*: of the reconstructed body, relative to that of the true one. Load",
        f"before the first one: {found['load']:.1f}. {found.get('note', '')}".rstrip(),
        "",
        "| body | true E [kPa] | law | E [kPa] | log10 off | 90 % interval [kPa] | inside | nu | volume | init | fit "
        "| doubts |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in found["rows"]:
        law = row["law"]
        told = ["-", "-", "-", "**no**", "-"]
        if row["best"] is not None:
            told = [
                f"{row['best'] / 1e3:.1f}",
                f"{np.log10(row['best'] / row['true']):+.3f}",
                f"{row['low'] / 1e3:.1f} to {row['high'] / 1e3:.1f}",
                "yes" if row["low"] <= row["true"] <= row["high"] else "**no**",
                f"{row['nu']:.2f}",
            ]
        cells = [
            row["body"],
            f"{row['true'] / 1e3:g}",
            law if law == NeoHookean.__name__ else f"**{law}**",
            *told,
            f"{row['volume']:.2f}",
            f"{row['init_s']:.0f} s",
            f"{row['fit_s']:.0f} s",
            ", ".join(row["doubts"]) or "-",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="folder for recordings, scenes and runs")
    options = parser.parse_args()
    begun, rows = {**made(), "load": os.getloadavg()[0]}, []
    for body, young, seed in RECORDINGS:
        rows.append(asdict(identified(options.work, body, young, seed)))
        keep("own_recording", {**begun, "rows": rows}, page)


if __name__ == "__main__":
    main()
