"""A finished run of a ball that fell through air of which its model knows nothing, small enough for seconds."""

from __future__ import annotations

from pathlib import Path

import torch
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.diagnosis.diagnose import Options
from pacnerf_lpo.diagnosis.settings import Settings
from pacnerf_lpo.diagnosis.store import FOLDER
from pacnerf_lpo.manifest import Manifest, PhaseRecord
from tests.report.example_run import visual_hull

DRAG, SPEED = 3.0, -1.0
"""Hidden in the video [1/s], and the velocity at frame 0 [m/s]."""
STEM = "01_velocity"
FILM = [
    *("--material", "NeoHookean", "--material.E", "1e5", "--shape", "Ball", "--shape.radius", "0.15"),
    *("--effects+=LinearDrag", "--effects.drag", str(DRAG), "--velocity", f"[0.0,{SPEED},0.0]", "--dx", "0.06"),
    *("--substep_rate", "1200", "--frames", "10", "--views", "5", "--image_size", "64"),
]


def write_dropped_ball(folder: Path, name: str = "ball") -> Path:
    """The run's folder; its scene lies beside it."""
    root = folder / f"{name}_video"
    assert main(["synthesize", str(root), *FILM]) == 0
    box = {"box_lower": [-0.3, 0.3, -0.3], "box_upper": [0.3, 1.1, 0.3]}
    section = {"root": str(root), **box, "train_views": [0, 1, 3, 4], "test_views": [2], "frames": 10}
    physics = {
        "material": {"class_path": "pacnerf_lpo.mpm.materials.NeoHookean", "init_args": {"E": 1e5, "nu": 0.3}},
        "substep_rate": 960.0,
        "fit_ground_height": True,
    }
    run = folder / name
    (run / "states").mkdir(parents=True)
    (run / "config.yaml").write_text(yaml.safe_dump({"seed_everything": 0, "data": section, "physics": physics}))
    state = visual_hull(VideoData(**section).prepare())
    velocity = torch.tensor([0.0, SPEED, 0.0]).expand(len(state.positions), 3)
    manifest = Manifest(run, "finished")
    for index, phase in enumerate(("static", "velocity")):
        stem = f"{index:02d}_{phase}"
        state.with_(velocity=velocity, physics={"E": 1e5, "nu": 0.3}).save(run / "states" / f"{stem}.pt")
        record = PhaseRecord(index, 0, phase, "done", f"checkpoints/{stem}/last.ckpt", f"states/{stem}.pt", 1.0, 1)
        manifest.phases.append(record)
    manifest.save()
    (run / FOLDER).mkdir()
    Settings([str(run)], None, Options(particles=400, replicates=8, effects=1)).write(run / FOLDER)
    return run
