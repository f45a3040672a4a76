"""The layouts that can be read, and which of them a folder has."""

from pathlib import Path
from typing import Literal

from pacnerf_lpo.data.recordings.readers import calibrated, colmap, dynerf, nerfstudio, pac_nerf, phystwin, spring_gaus
from pacnerf_lpo.data.recordings.recording import Recording
from pacnerf_lpo.errors import UserInputError

LAYOUTS = (
    *(pac_nerf.LAYOUT, pac_nerf.GIC, spring_gaus.SYNTHETIC, spring_gaus.REAL, nerfstudio.LAYOUT, nerfstudio.D_NERF),
    *(colmap.LAYOUT, dynerf.LAYOUT, phystwin.LAYOUT, calibrated.OPENCV, calibrated.TOML),
)
Format = Literal[
    "pac-nerf", "gic", "spring-gaus-synthetic", "spring-gaus-real", "nerfstudio", "d-nerf", "colmap", "dynerf",
    "phystwin", "opencv", "toml",
]  # fmt: skip
SHOWN = 8
"""Entries of a folder that a message names."""


def read_recording(folder: Path, name: Format | None = None) -> Recording:
    """The recording in a folder, in the layout of this name, or in the one that is recognised. Raises UserInputError
    where there is no such folder, no layout or several fit it, or something in the files is wrong.
    """
    if not folder.is_dir():
        wrong = "is a file, unpack it if it is an archive" if folder.is_file() else "there is no such folder"
        raise UserInputError(f"{folder}: {wrong}; give the folder that holds videos and calibration")
    fitting = [layout for layout in LAYOUTS if (layout.fits(folder) if name is None else layout.name == name)]
    if len(fitting) > 1:
        found = "; ".join(f"{layout.name} ({layout.looks_for})" for layout in fitting)
        raise UserInputError(f"{folder}: fits several layouts: {found}; choose one by --format")
    if not fitting:
        looked_for = "; ".join(layout.looks_for for layout in LAYOUTS)
        names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir()) or ["nothing"]
        there = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
        raise UserInputError(f"{folder}: no known layout. Looked for: {looked_for}. There lies: {there}")
    return fitting[0].read(folder)
