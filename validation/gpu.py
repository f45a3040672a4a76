"""The engine and the phases of a fit on one NVIDIA GPU.

    python -m validation.gpu SCENE=FOLDER [...] --whole SCENE --keep [--before CHECKOUT]

Each FOLDER holds a video in PAC-NeRF's layout of a scene of configs/scenes (with its overlay of configs/shared, if
there is one). Its phases take the settings of the paper, except that identification and correction end after a few
iterations where the scene is not to be fitted whole: an iteration is timed from its beginning to that of the next, with
its way back and the optimiser's step, and multiplied by the paper's number of them.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from itertools import pairwise
from pathlib import Path
from statistics import median
from unittest.mock import patch

import torch

from validation import engine
from validation.record import Record, keep, made, origin, table

SIZES = (8000, 64000, 1000000)
SUBSTEPS, REPEATS = 40, 3
PHASES = {"static": 2000, "warm-up": 50, "main": 100, "correction": 100}
"""Iterations of PAC-NeRF-3v-dagger and LPO."""
A100 = {"static": 284.6, "velocity": 101.9, "warm-up": 765.2, "main": 3153.3, "correction": 3225.4}
"""Seconds of each phase on the droplet, of the LPO supplement, table 9."""
COMMAND = "python -m validation.gpu torus=FOLDER playdoh=FOLDER droplet=FOLDER --whole droplet --keep"
FEW = 8
"""Iterations of identification and correction where a scene is not fitted whole."""


def clock() -> float:
    """Now, when the GPU has done what it was given [s]."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter()


def fastest(action: Callable[[], object]) -> float:
    """Seconds of the fastest of a few calls."""
    found = []
    for _ in range(REPEATS):
        began = clock()
        action()
        found.append(clock() - began)
    return min(found)


def rates(name: str, particles: int, device: str) -> dict[str, float]:
    """Million particle-substeps per second: forward, recording for the adjoint, and backward; seconds to compile."""
    rollout = engine.scene(name, particles, SUBSTEPS, 2, device)
    began = clock()
    rollout()[-1].sum().backward()
    compiled, held, backward = clock() - began, [], []
    with torch.no_grad():
        forward = fastest(rollout)
    for _ in range(REPEATS):
        held = [rollout()]
        began = clock()
        held[0][-1].sum().backward()
        backward.append(clock() - began)
    recording = fastest(rollout)
    count = len(held[0][0]) * SUBSTEPS / 1e6
    return {
        "forward": count / forward, "recording": count / recording, "backward": count / min(backward),
        "compile_s": compiled,
    }  # fmt: skip


def engine_rates(device: str) -> dict[str, dict[str, dict[str, float]]]:
    """:func:`rates` of each law and number of particles."""
    sizes = {name: SIZES if name == "NeoHookean" else SIZES[-1:] for name in engine.MATERIALS}
    return {name: {str(n): rates(name, n, device) for n in sizes[name]} for name in engine.MATERIALS}


def beside(checkout: Path) -> dict[str, dict[str, float]]:
    """:func:`rates` of elastic particles of another version."""
    here = str(Path(__file__).resolve())
    text = engine.child([here, "--only-elastic"], 1, cache=False, checkout=checkout)
    return json.loads(text.splitlines()[-1])


def timed_phases(scene: str, folder: Path, accelerator: str, whole: bool) -> Record:
    """Seconds of an iteration of each phase, the particles, and the seconds of the whole velocity phase; of a whole fit
    those of the command, and how good it is.
    """
    from pacnerf_lpo import __main__ as program
    from pacnerf_lpo.commands import fit
    from pacnerf_lpo.evaluation.evaluate import RESULTS_FILE
    from pacnerf_lpo.evaluation.tables import markdown_table
    from pacnerf_lpo.phases.lpo import LPOModule
    from pacnerf_lpo.phases.physics_id import PhysicsIDModule
    from pacnerf_lpo.phases.static_grid import StaticGridModule

    counts = {name: PHASES[name] if whole else FEW for name in ("warm-up", "main", "correction")}
    begins: dict[str, list[float]] = {name: [] for name in PHASES}
    particles: list[int] = []

    def timed(module: type, phase: Callable[[int], str]) -> AbstractContextManager[object]:
        step = module.training_step  # type: ignore[attr-defined]

        def training_step(self, batch, *rest):
            begins[phase(int(batch))].append(clock())
            if hasattr(self, "state"):
                particles.append(len(self.state.positions))
            return step(self, batch, *rest)

        return patch.object(module, "training_step", training_step)

    shared = Path(f"configs/shared/{scene}.yaml")
    configs = ["configs/fit.yaml", f"configs/scenes/{scene}.yaml", *([str(shared)] if shared.is_file() else [])]
    configs += ["configs/baselines/3v_dagger.yaml", "configs/corrections/lpo.yaml"]
    with (
        tempfile.TemporaryDirectory() as run,
        timed(StaticGridModule, lambda step: "static"),
        timed(PhysicsIDModule, lambda step: "warm-up" if step < counts["warm-up"] else "main"),
        timed(LPOModule, lambda step: "correction"),
    ):
        method, lpo = "phases.physics.init_args.method.init_args", "phases.correction.init_args"
        words = [f"--config={config}" for config in configs]
        words += [f"--data.root={folder}", f"--trainer.accelerator={accelerator}", f"--outer_loop.run_dir={run}"]
        words += ["--intervals=false", "--outer_loop.compare_methods=false", "--outer_loop.rounds=1"]
        words += [f"--{method}.warm_up_iterations={counts['warm-up']}", f"--{method}.main_iterations={counts['main']}"]
        words += [f"--{lpo}.iterations={counts['correction']}"]
        words += [f"--truth={folder / 'truth.json'}"] if whole else []
        began = clock()
        with nullcontext() if whole else patch.object(fit, "finish"):
            if program.main(["fit", *words]):
                raise SystemExit(f"the fit of {folder} failed")
        fitted: Record = {}
        if whole:
            results = json.loads((Path(run) / RESULTS_FILE).read_text())
            fitted = {"command_s": clock() - began, "table": markdown_table(results)}
        phases = json.loads((Path(run) / "manifest.json").read_text())["phases"]
    found = {name: median(b - a for a, b in pairwise(each)) for name, each in begins.items()}
    velocity = sum(phase["seconds"] for phase in phases if phase["phase"] == "velocity")
    return {**found, "velocity": velocity, "particles": particles[-1], **fitted}


def phases_of(found: Record) -> list[str]:
    """A scene's part of the page."""
    seconds = {name: found[name] * PHASES.get(name, 1) for name in A100}
    rows = [
        [name, f"{found[name]:.3f}" if name in PHASES else "", PHASES.get(name, ""), f"{total:.0f}",
         f"{A100[name]:.0f}", f"{A100[name] / total:.0f}"]
        for name, total in seconds.items()
    ]  # fmt: skip
    head = ["phase", "an iteration [s]", "iterations", "phase [s]", "paper's droplet, A100 [s]", "times as fast"]
    total, paper = sum(seconds.values()), sum(A100.values())
    lines = [f"Path traced, 256 x 256, three views, {found['particles']:,} particles:", "", table(head, rows), ""]
    lines += [f"Together {total:.0f} s, the paper's droplet {paper:.0f} s: {paper / total:.0f} times as fast."]
    if "table" in found:
        lines += [f"Fitted whole; the command took {found['command_s']:.0f} s, with its report:", "", found["table"]]
    return lines


def page(results: Record) -> str:
    """The record as Markdown."""
    lines = ["# On a GPU", "", origin(results, "gpu", f"`{COMMAND}`"), ""]
    lines += [f"One {results['device']}. {results['remark']}".strip(), ""]
    lines += ["Million particle-substeps per second, float32, 8 particles in a cell, ordered by cell:", ""]
    rows = [
        [name, f"{int(n):,}", *(f"{r[key]:.0f}" for key in ("forward", "recording", "backward"))]
        for name, sizes in results["engine"].items()
        for n, r in sizes.items()
    ]
    lines += [table(["material", "particles", "forward", "recording", "backward"], rows)]
    for n, r in results.get("before", {}).get("elastic", {}).items():
        now = results["engine"]["NeoHookean"][n]
        ratios = " and ".join(f"{now[key] / r[key]:.2f}" for key in ("forward", "backward"))
        lines.append(
            f"\n- {int(n):,} elastic particles, beside {results['before']['commit']}: forward and backward are "
            f"{ratios} times as fast."
        )
    lines += ["", "The videos and the GPU are others than the paper's: its seconds are a yardstick, no comparison."]
    for scene, found in results["phases"].items():
        lines += ["", f"## {scene}", "", *phases_of(found)]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE=FOLDER")
    parser.add_argument("--whole", action="append", default=[], metavar="SCENE", help="fit it to its report")
    parser.add_argument("--keep", action="store_true", help="write validation/results/gpu.json and its page")
    parser.add_argument("--before", type=Path, help="checkout of another version, for a comparison side by side")
    parser.add_argument("--remark", default="", help="a sentence for the page")
    parser.add_argument("--only-elastic", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not torch.cuda.is_available():
        sys.exit("no CUDA device is visible to torch")
    if options.only_elastic:
        print(json.dumps({str(n): rates("NeoHookean", n, "cuda") for n in SIZES}))
        return
    results: Record = {**made(), "device": torch.cuda.get_device_name(), "remark": options.remark}
    results["engine"] = engine_rates("cuda")
    if options.before:
        results["before"] = {"commit": options.before.resolve().name, "elastic": beside(options.before)}
    results["phases"] = {}
    for scene in options.scenes:
        name, folder = scene.split("=", 1)
        results["phases"][name] = timed_phases(name, Path(folder), "gpu", name in options.whole)
        if options.keep:
            keep("gpu", results, page)
    print(page(results))


if __name__ == "__main__":
    main()
