"""The page of reconstructions from path-traced videos at 128 x 128 pixels, which ``pacnerf-lpo fit`` makes."""

from __future__ import annotations

from math import log10, sqrt
from typing import Any

from validation.record import Record, origin, table

UNITS = {"E": "Pa", "nu": "", "mu": "Pa s", "kappa": "Pa"}
SYMBOLS = {
    "E": "E",
    "nu": "\u03bd",
    "mu": "μ",
    "kappa": "κ",
    "tau_y": "τ_Y",
    "eta": "η",
    "theta": "θ",
}
COMMANDS = """
```sh
pacnerf-lpo fit --config fit --config scenes/torus --config shared/torus --config baselines/3v_dagger --config cpu \\
  --data.root TORUS --phases.physics.init_args.method.init_args.scan_decades=1.5 --outer_loop.run_dir runs/torus
pacnerf-lpo evaluate runs/torus --truth TORUS/truth.json
```
"""
LIMITS = """
Errors are |Δlog10| of E, μ and κ, and plain differences of Poisson's ratio. Seconds are upper bounds, for other
programs were running. **These are development figures**: the CPU settings (outline weight, visible mass, ground
height, frames of the warm-up, spacing of the search, size of the probe) were chosen over several runs on these scenes
with their true values in view. No run reads the true values. `hit_frame` was set by hand. κ of the droplet is hardly
visible in a video. Moduli of partly filled particles count by their volume since commit ac66315; these runs are
older, and that change lowers E by some 0.05 in log10.
"""


def error(name: str, found: float, true: float) -> float:
    """Of a parameter as the paper has it: on a logarithmic scale but for Poisson's ratio."""
    return abs(found - true) if name == "nu" else abs(log10(found / true))


def page(record: Record) -> str:
    """The record as Markdown."""
    runs, mattes, rendering = record["runs"], record["mattes"], dict(record["rendering_ms"])
    commit = rendering.pop("commit")
    times = "; ".join(f"{what} {', '.join(map(str, seconds))} ms" for what, seconds in rendering.items())
    parts = [
        "# From video to material on a CPU",
        origin(record, "identification", "the commands below (each row names its commit)"),
        LIMITS.strip(),
        "## Parameters",
        table(
            ["scene", "views", "parameter", "guess", "identified", "true", "error"],
            [row for run in runs for row in _parameters(run)],
        ),
        "## Images",
        "Mean PSNR [dB] over all frames, after identification and after the correction by LPO. With all views in "
        "training there is no test view.",
        table(
            ["scene", "training views", "+LPO", "test views", "+LPO"],
            [
                [run["scene"], *(f"{x:.2f}" for x in run["psnr"]["training"]), *_test(run["psnr"].get("test"))]
                for run in runs
            ],
        ),
        "## Time",
        table(
            ["scene", "commit", "static [s]", "velocity [s]", "physics [s]", "correction [s]", "whole command [min]"],
            [[run["scene"], run["commit"], *run["seconds"].values(), f"{run['minutes']:g}"] for run in runs],
        ),
        "## Commands",
        "The torus with 3v†; the others by their scene and baseline, with all views by `baselines/pac_nerf`, and the "
        "bird by `make bird`:",
        COMMANDS.strip(),
        "## Mattes and rendering",
        f"Mattes of the torus against its true silhouettes, 11 views and 14 frames: intersection over union "
        f"{mattes['mean_iou']:.3f} on average, {mattes['least_iou']:.3f} at least (tested by "
        "`tests/data/test_matting.py`).",
        f"Rendering, commit {commit}, `python validation/render.py --threads 1` three times: {times}.",
    ]
    return "\n\n".join(parts) + "\n"


def _parameters(run: dict[str, Any]) -> list[list[str]]:
    rows = []
    for name, found in run["found"].items():
        guess, true, unit = run["guess"][name], run["true"][name], UNITS[name]
        values = [f"{value:.4g} {unit}".strip() for value in (guess, found, true)]
        rows.append([run["scene"], run["views"], SYMBOLS[name], *values, f"{error(name, found, true):.3f}"])
    if "velocity" in run:
        found, true = run["velocity"]["found"], run["velocity"]["true"]
        apart = sqrt(sum((a - b) ** 2 for a, b in zip(found, true, strict=True)))
        shown = [f"({', '.join(f'{x:g}' for x in vector)}) m/s" for vector in ([0.0, 0.0, 0.0], found, true)]
        rows.append([run["scene"], run["views"], "v0", *shown, f"{apart:.3f} m/s"])
    return rows


def _test(values: list[float] | None) -> list[str]:
    return [f"{x:.2f}" for x in values] if values else ["-", "-"]
