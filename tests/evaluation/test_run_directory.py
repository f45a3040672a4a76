"""Which phase of a run directory is looked at."""

from __future__ import annotations

from pathlib import Path

import torch

from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.manifest import Manifest, PhaseRecord
from pacnerf_lpo.types import ParticleState

STEMS = ("00_static", "01_velocity", "02_r1_physics", "03_r1_correction", "04_r2_physics")


def write_run(folder: Path, corrected_from: str | None) -> Run:
    """A run of these phases; the states from one on say that a correction changed them."""
    (folder / "states").mkdir(parents=True)
    manifest = Manifest(folder)
    blank = torch.zeros(1, 3)
    for index, stem in enumerate(STEMS):
        role = stem.rpartition("_")[2]
        manifest.phases.append(PhaseRecord(index, index // 2, role, "done", "-", f"states/{stem}.pt"))
        later = corrected_from is not None and stem >= corrected_from
        state = ParticleState(blank, blank, blank[:, 0], torch.zeros(1, 12), {}, 0.1, 0.1, corrected=later)
        state.save(folder / "states" / f"{stem}.pt")
    manifest.save()
    return Run(folder)


def test_the_body_before_any_correction(tmp_path):
    assert write_run(tmp_path / "corrected", "03_r1_correction").uncorrected.stem == "02_r1_physics"
    assert write_run(tmp_path / "never", None).uncorrected.stem == "04_r2_physics"
