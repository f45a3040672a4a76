"""The shared path-traced scenes as a new user takes them: ``init``, then ``fit --preset quick``, without a config.

    python -m validation.init_alone --videos ../shared/data --work runs/init

fits every scene once more with its hand-written configurations under the same preset, compares the two, and writes
``results/init_alone.json`` and the page made of it. What is finished in the work folder is not done again. The answer
sheets are opened when both runs of a scene are done.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pacnerf_lpo.data.images import image_size
from pacnerf_lpo.evaluation.parameter_errors import Truth, parameter_errors, read_truth
from validation.five_scenes import shown
from validation.identification import SYMBOLS
from validation.record import Record, keep, made, origin, table

SCENES = {
    "torus": ("torus", "elastic"),
    "droplet": ("droplet", "viscous"),
    "playdoh": ("playdoh", "plastic"),
    "cream": ("cream", "viscoplastic"),
    "trophy": ("trophy", "granular"),
    "drag_torus": ("torus", "elastic"),
    "slip_cat": ("cat", "elastic"),
    "null_bird": ("bird", "elastic"),
}
"""Scenes with the shipped configuration that the hand-written one builds on, and the family that is right."""
QUICK = ("cpu", "cpu_outlines", "presets/quick")
"""What ``--preset quick`` stacks."""
IGNORED = ("truth.json", "particles.npz")
WORDS = """
Path-traced scenes from other simulators than this one, all eleven views. `init` measures box, ground, contact and
scale of time; the law is decided by the fit (`material: auto`), and starts from no guess. The hand-written
configurations say box, frame of the first contact, law and a guess. **Development figures**. Asked for: the family
right in all eight, parameters within 0.05 in log10 (0.05 in nu, 1° in theta) of what the hand-written ones give. Other
work shared the machine, so that the times are several times too long.
"""


@dataclass(frozen=True)
class Row:
    """One scene; errors by parameter: |log10| of the ratio, differences of ν, degrees of θ.

    family, law: chosen without a configuration;  separated: whether the recording separates it from the others
    found, by_hand: values [SI, degrees];  apart: of the two;  off, off_by_hand: of either from the truth
    init_s, fit_s, by_hand_s: seconds;  doubts: names of those that ``fit`` had
    """

    scene: str
    true: str
    family: str
    law: str
    separated: bool
    found: dict[str, float]
    by_hand: dict[str, float]
    apart: dict[str, float]
    off: dict[str, float]
    off_by_hand: dict[str, float]
    init_s: float
    fit_s: float
    by_hand_s: float
    doubts: list[str]


def row(videos: Path, work: Path, scene: str) -> Row:
    """Run a scene both ways, where that has not been done."""
    base, family = SCENES[scene]
    recording, folder, by_hand = work / f"{scene}_recording", work / scene, work / f"{scene}_by_hand"
    if not recording.is_dir():
        shutil.copytree(videos / scene, recording, ignore=shutil.ignore_patterns(*IGNORED))
    times = {
        "init_s": _timed(folder / "init.seconds", "init", str(recording), str(folder)),
        "fit_s": _timed(folder / "fit.seconds", "fit", str(folder), "--preset", "quick"),
        "by_hand_s": _timed(work / f"{scene}_by_hand.seconds", *_hand_written(recording, scene, base, by_hand)),
    }
    ours, theirs = _results(folder / "run"), _results(by_hand)
    (found, fluid), (expected, other) = _values(ours), _values(theirs)
    truth = read_truth(videos / scene / "truth.json")
    trials = {trial["law"]: trial for trial in ours["laws"]["laws"]}
    return Row(
        scene,
        family,
        trials[ours["laws"]["chosen"]]["family"],
        ours["laws"]["chosen"],
        not any("does not separate" in sentence for sentence in ours["laws"]["sentences"]),
        found,
        expected,
        _errors(found, Truth(expected, other, None, {}), fluid),
        _errors(found, truth, fluid),
        _errors(expected, truth, other),
        **times,
        doubts=[doubt["name"] for doubt in ours["doubts"]],
    )


def _hand_written(recording: Path, scene: str, base: str, run: Path) -> list[str]:
    overlays = ("fit", f"scenes/{base}", "cpu", "cpu_outlines", f"shared/{scene}", "presets/quick")
    size = min(1.0, 128 / _pixels(recording))
    words = [word for overlay in overlays for word in ("--config", overlay)]
    places = ("--data.root", str(recording), "--outer_loop.run_dir", str(run))
    return ["fit", *words, f"--data.image_scale={size:g}", *places]


def _pixels(recording: Path) -> int:
    return max(image_size(next((recording / "data").glob("m_*_0.png"))))


def _timed(record: Path, *words: str) -> float:
    """Seconds that a command takes, or took when it was run before."""
    if record.is_file():
        return float(record.read_text())
    began = time.monotonic()
    subprocess.run([sys.executable, "-m", "pacnerf_lpo", *words], check=True, stdin=subprocess.DEVNULL)
    record.write_text(f"{time.monotonic() - began:.1f}")
    return float(record.read_text())


def _results(run: Path) -> dict[str, Any]:
    return json.loads((run / "results.json").read_text())


def _values(results: dict[str, Any]) -> tuple[dict[str, float], bool]:
    """The identified values [SI, degrees], and whether they are a fluid's."""
    phase = next(phase for phase in results["phases"] if phase["stem"] == results["result"])
    values = {name: one["value"] for name, one in phase["parameters"].items() if name in SYMBOLS}
    return values, results["material"] == "Newtonian"


def _errors(found: dict[str, float], truth: Truth, fluid: bool) -> dict[str, float]:
    errors = parameter_errors(found, truth, fluid)
    return {n: abs(e.found - e.true) if e.measure == "radians" else e.error for n, e in errors.items()}


def page(found: Record) -> str:
    """The record as Markdown."""
    head = ["scene", "family", "law", "separated", "parameter", "found", "by hand", "apart", "off", "by hand", "time"]
    rows = []
    for one in found["rows"]:
        family = one["family"] if one["family"] == one["true"] else f"**{one['family']}** ({one['true']})"
        times = f"{one['init_s']:.0f} + {one['fit_s']:.0f} s, by hand {one['by_hand_s']:.0f} s"
        first = [one["scene"], family, one["law"], "yes" if one["separated"] else "no"]
        for name in one["found"]:
            errors = (one[key].get(name) for key in ("apart", "off", "off_by_hand"))
            said = ["-" if error is None else shown(name, error) for error in errors]
            values = [f"{one[key][name]:.4g}" if name in one[key] else "-" for key in ("found", "by_hand")]
            rows.append([*first, SYMBOLS[name], *values, *said, times])
            first, times = [""] * 4, ""
    parts = [
        "# Eight scenes without a configuration",
        origin(found, "init_alone", "`python -m validation.init_alone --videos ../shared/data --work runs/init`"),
        WORDS.strip(),
        table(head, rows),
    ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--videos", type=Path, required=True, help="folder of the scenes")
    parser.add_argument("--work", type=Path, required=True, help="folder for scenes and runs")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    begun = made()
    rows = [asdict(row(options.videos, options.work, scene)) for scene in options.scenes]
    keep("init_alone", {**begun, "rows": rows}, page)


if __name__ == "__main__":
    main()
