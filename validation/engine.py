"""The engine's speed, memory and compile time for every material, beside a yardstick run at the same time.

    python -m validation.engine --keep [--before CHECKOUT] [--yardstick TRIAL.py] [--rounds 3]

Every measurement runs in its own process. Times are quoted twice: by the clock, and as processor time of one thread,
which other programs on the machine disturb less; ratios against another version (a checkout of it, for example by
``git worktree add``) and against the yardstick compare runs that alternate.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median

import matplotlib.pyplot as plt
import numpy as np
import torch

from validation.record import Record, keep, made, origin

MATERIALS = {
    "NeoHookean": {"E": 1e6, "nu": 0.3},
    "Newtonian": {"mu": 200.0, "kappa": 1e5},
    "VonMises": {"E": 1e6, "nu": 0.3, "tau_y": 1e4},
    "ViscoplasticVonMises": {"mu": 1e4, "kappa": 1e6, "tau_y": 3e3, "eta": 10.0},
    "DruckerPrager": {"theta": 40.0, "E": 1e6, "nu": 0.3},
}
DX, RATE, SUBSTEPS = 0.04, 4800, 80
COSTS = {
    "flops": {"forward": 1650.0, "backward": 4400.0},
    "bytes": {"forward": 4.0 * (24 + 24 + 15), "backward": 4.0 * (24 + 24 + 24 + 15)},
}
"""Of one elastic particle in one substep. Floating-point operations, counted from transfer_rows.py and the neo-Hookean
law, with those on the fourth node of a row, which has no weight: forward 36 operations on 16 numbers in the gather and
38 in the scatter, their sums, weights and law 470; backward 166 in two adjoint gathers and 38 in the scatter, sums,
weights and law 1100. Memory traffic that no cache saves: states read and written once [bytes]."""
SIZES = {
    "particles": [(1000, 80, 2), (4096, 80, 2), (15625, 80, 2), (64000, 40, 2), (250047, 40, 2), (1000000, 40, 2)],
    "substeps": [(8000, 40, 2), (8000, 80, 2), (8000, 160, 2), (8000, 320, 2)],
    "frames": [(8000, 20, 3), (8000, 20, 5), (8000, 20, 9), (8000, 20, 17)],
}
"""Particles, substeps per frame and frames of the rollouts that show how the cost grows."""
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "engine.png"


def block(particles: int) -> torch.Tensor:
    """A jittered cube of particles above the ground, 8 per cell, ordered by cell [m, (N, 3)]."""
    side = round(particles ** (1 / 3))
    axis = torch.arange(side) + 0.5
    noise = torch.randn(side**3, 3, generator=torch.Generator().manual_seed(0))
    positions = (torch.cartesian_prod(axis, axis, axis) + 0.2 * noise) * DX / 2
    return positions + torch.tensor([0.0, 0.05, 0.0])


def scene(name: str, particles: int, substeps: int, frames: int, device: str = "cpu") -> Callable[[], torch.Tensor]:
    """A rollout of a block thrown down at 1 m/s, differentiable in its material parameters."""
    from pacnerf_lpo.mpm import materials
    from pacnerf_lpo.mpm.simulator import Simulator

    positions = block(particles).to(device)
    velocity = torch.tensor([0.0, -1.0, 0.0], device=device).expand_as(positions)
    ones = torch.ones(len(positions), device=device)
    material = getattr(materials, name)(**MATERIALS[name])
    simulator = Simulator(material, dx=DX, substeps=substeps, frame_dt=substeps / RATE, device=device)
    parameters = {key: torch.tensor(value, requires_grad=True, device=device) for key, value in material.guess.items()}
    return lambda: simulator(positions, velocity, 1000 * (DX / 2) ** 3 * ones, ones, parameters, frames)


def timed(action: Callable[[], object]) -> tuple[float, float]:
    """Seconds by the clock and of processor time."""
    clock, processor = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - clock, time.process_time() - processor


def machine() -> dict[str, float]:
    """What this process can reach: fused multiply-adds in a matrix product [Gflop/s], and copying [GB/s]."""
    a, b = torch.rand(1024, 1024), torch.rand(1 << 25)
    product = min(timed(lambda: a @ a)[0] for _ in range(5))
    copy = min(timed(b.clone)[0] for _ in range(5))
    return {"matmul_gflops": 2 * 1024**3 / product / 1e9, "copy_gb_s": 2 * 4 * len(b) / copy / 1e9}


def measure(name: str, particles: int, substeps: int = SUBSTEPS, frames: int = 2) -> dict[str, float]:
    """Compile times and ms per substep of one material; best of five for each."""
    rollout = scene(name, particles, substeps, frames)
    with torch.no_grad():
        compile_forward = timed(rollout)
    compile_both = timed(lambda: rollout()[-1].sum().backward())
    best: dict[str, tuple[float, float]] = {}

    def keep(key: str, seconds: tuple[float, float]) -> None:
        old = best.get(key, seconds)
        best[key] = min(old[0], seconds[0]), min(old[1], seconds[1])

    for _ in range(5):
        with torch.no_grad():
            keep("forward", timed(rollout))
        held: list[torch.Tensor] = []
        keep("recording", timed(lambda held=held: held.append(rollout())))
        keep("backward", timed(lambda held=held: held[0][-1].sum().backward()))
    result = {
        **machine(),
        "jit_s": compile_forward[0] + compile_both[0],
        "jit_cpu_s": compile_forward[1] + compile_both[1],
    }
    for key, (clock, processor) in best.items():
        total = substeps * (frames - 1)
        result[f"{key}_ms"], result[f"{key}_cpu_ms"] = 1e3 * clock / total, 1e3 * processor / total
    return result


def peak_memory() -> dict[str, float]:
    """Peak resident memory of 14 frames x 200 substeps x 25,000 particles, forward and backward [GB]."""
    rollout = scene("NeoHookean", 29**3, 200, 14)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seconds = timed(lambda: rollout()[-1].sum().backward())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"peak_gb": peak / 1e6, "before_gb": before / 1e6, "seconds": seconds[0], "cpu_seconds": seconds[1]}


def child(arguments: list[str], threads: int, cache: bool, checkout: Path = PICTURE.parents[2]) -> str:
    """Standard output of a Python process with so many threads, with or without Taichi's cache of compiled kernels, of
    the version in a checkout.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads), "TI_OFFLINE_CACHE": str(int(cache))}
    environment["PYTHONPATH"] = str(checkout.resolve())
    return subprocess.run(
        [sys.executable, *arguments], env=environment, check=True, capture_output=True, text=True
    ).stdout


def yardstick(path: Path, threads: int, processor_time: bool) -> dict[str, float]:
    """The trial's figures; with ``processor_time`` from a copy of it that reads the processor's clock."""
    source = path.read_text()
    with tempfile.NamedTemporaryFile("w", suffix=".py") as copy:
        copy.write(source.replace("perf_counter", "process_time") if processor_time else source)
        copy.flush()
        text = child([copy.name, "--threads", str(threads)], threads, cache=False)
    forward, backward = (float(re.search(rf"{key} ([\d.]+) ms", text)[1]) for key in ("forward", "backward"))
    fma, copied = re.search(r"FMA ([\d.]+) Gflop/s, copy ([\d.]+) GB/s", text).groups()
    return {"forward": forward, "backward": backward, "fma": float(fma), "copy": float(copied)}


def comparison(run: dict[str, float], trial: dict[str, float], kind: str) -> str:
    """One run beside the yardstick's, and what it achieves of the machine."""
    forward, backward = run[f"recording_{kind}"], run[f"backward_{kind}"]
    factor = (trial["forward"] + trial["backward"]) / (forward + backward)
    rate = {
        key: 8e3 * (count["forward"] + count["backward"]) / (forward + backward) / 1e6 for key, count in COSTS.items()
    }
    return (
        f"elastic forward + backward {forward:.2f} + {backward:.2f} ms, trial {trial['forward']:.2f} + "
        f"{trial['backward']:.2f} ms: **{factor:.2f} x faster**. Achieved {rate['flops']:.1f} Gflop/s and "
        f"{rate['bytes']:.1f} GB/s. Machine: matrix product {run['matmul_gflops']:.0f} Gflop/s, copy "
        f"{run['copy_gb_s']:.1f} GB/s; as the trial measures it FMA {trial['fma']:.1f} Gflop/s, "
        f"copy {trial['copy']:.1f} GB/s."
    )


def scaling(particles: int, rounds: int) -> tuple[float, float]:
    """Forward + backward of elastic particles with one thread and with two, by the clock [ms per substep]."""
    clocks: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for threads, found in zip((1, 2), clocks, strict=True):
            run = json.loads(child([__file__, "--only", "NeoHookean", "--particles", str(particles)], threads, True))
            found.append(run["recording_ms"] + run["backward_ms"])
    return median(clocks[0]), median(clocks[1])


def beside(checkout: Path, rounds: int) -> dict[str, list[float]]:
    """Recording + backward of another version and of this one, medians of processes that take turns [ms per substep of
    processor time].
    """
    found: dict[str, list[float]] = {}
    for name in MATERIALS:
        both: list[list[float]] = [[], []]
        for _ in range(rounds):
            for times, where in zip(both, (checkout, PICTURE.parents[2]), strict=True):
                run = json.loads(child([__file__, "--only", name], 1, True, where))
                times.append(run["recording_cpu_ms"] + run["backward_cpu_ms"])
        found[name] = [median(times) for times in both]
    return found


def growth() -> dict[str, list[tuple[int, float]]]:
    """What grows, and ms of processor time of a whole rollout, recorded and pulled back, elastic, one thread."""
    found: dict[str, list[tuple[int, float]]] = {}
    for what, sizes in SIZES.items():
        found[what] = []
        for size in sizes:
            words = [f"--{key}={value}" for key, value in zip(("particles", "substeps", "frames"), size, strict=True)]
            run = json.loads(child([__file__, "--only", "NeoHookean", *words], 1, True))
            per_substep = run["recording_cpu_ms"] + run["backward_cpu_ms"]
            grown = {"particles": size[0], "substeps": size[1], "frames": size[2] - 1}[what]
            found[what].append((grown, per_substep * (1 if what == "particles" else size[1] * (size[2] - 1))))
    return found


def slope(points: Sequence[Sequence[float]]) -> float:
    """Of the logarithm of the cost over that of the size: 1 where the cost is proportional."""
    return float(np.polyfit(*np.log(np.array(points)).T, 1)[0])


def draw(grown: Mapping[str, Sequence[Sequence[float]]]) -> None:
    """The picture of the documentation."""
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    for axis, (what, points) in zip(axes, grown.items(), strict=True):
        x, y = np.array(points).T
        axis.loglog(x, y, "o-", label=f"slope {slope(points):.2f}")
        axis.set_xticks(x, [f"{int(size):,}" for size in x], rotation=30)
        axis.minorticks_off()
        axis.set_xlabel(what)
        axis.set_ylabel("ms per substep" if what == "particles" else "ms per rollout")
        axis.legend()
        axis.grid(alpha=0.3)
    figure.savefig(PICTURE, dpi=110)


def page(results: Record) -> str:
    """The record as Markdown."""
    lines = [
        "# Engine",
        "",
        origin(results, "engine", "`python -m validation.engine --keep`"),
        "",
        f"8,000 particles, dx {DX} m, ordered by cell, float32. Programs that were running on the machine already, on "
        f"average: {results['load']:.1f}. *Trial*: an engine written for this comparison, which is not part of the "
        "repository.",
        "",
    ]
    lines += ["| material | forward | recording | backward | backward/forward | all/elastic | first backward ready |"]
    lines += ["|---|---|---|---|---|---|---|"]
    elastic = sum(results["one"]["NeoHookean"][f"{key}_cpu_ms"] for key in ("recording", "backward"))
    for name, r in results["one"].items():
        both = r["recording_cpu_ms"] + r["backward_cpu_ms"]
        lines.append(
            f"| {name} | {r['forward_cpu_ms']:.2f} | {r['recording_cpu_ms']:.2f} | {r['backward_cpu_ms']:.2f} "
            f"| {r['backward_cpu_ms'] / r['recording_cpu_ms']:.2f} | {both / elastic:.2f} | {r['jit_cpu_s']:.1f} s |"
        )
    lines += [
        "",
        f"ms per substep, processor time of one thread, medians of {results['rounds']} processes that take turns; JIT "
        "without cache, forward and backward kernel together. Backward/forward of the elastic processes was "
        f"{results['elastic_ratio'][0]:.2f} to {results['elastic_ratio'][1]:.2f}.",
        "",
    ]
    for title, key, kind in (("One thread, processor time", "one", "cpu_ms"), ("Two threads, clock", "two", "ms")):
        for run, trial in zip(results[f"{key}_rounds"], results[f"{key}_yardstick"], strict=True):
            lines.append(f"- {title}: {comparison(run, trial, kind)}")
    for particles, clocks in results["scaling"].items():
        alone, together = clocks
        lines.append(
            f"- {int(particles):,} elastic particles, forward + backward by the clock: {alone:.2f} ms with one thread, "
            f"{together:.2f} ms with two: **{alone / together:.2f} x faster** (medians)."
        )
    for name, (before, now) in results.get("before", {}).get("ms", {}).items():
        lines.append(
            f"- {name}, {results['before']['commit']} and this version in turn, recording + backward: {before:.2f} and "
            f"{now:.2f} ms: **{before / now:.2f} x faster**."
        )
    for what, points in results["growth"].items():
        costs = ", ".join(f"{int(size):,}: {cost:.3g}" for size, cost in points)
        unit = "ms per substep" if what == "particles" else "ms per rollout of 8,000 particles"
        lines.append(f"- Cost over {what}, forward + backward, {unit}: {costs}; slope {slope(points):.2f}.")
    m = results["memory"]
    lines += [
        "",
        f"14 frames x 200 substeps x {29**3:,} particles, forward and backward: peak {m['peak_gb']:.2f} GB resident "
        f"({m['before_gb']:.2f} GB of it before), {m['seconds']:.0f} s by the clock, "
        f"{m['cpu_seconds']:.0f} s of processor time.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", action="store_true", help="write validation/results/engine.json and its page")
    parser.add_argument("--before", type=Path, help="checkout of another version, for a comparison side by side")
    parser.add_argument("--yardstick", type=Path, help="another engine's program, which prints the same figures")
    parser.add_argument(
        "--rounds", type=int, default=3, help="processes for each material, and alternations with the yardstick"
    )
    parser.add_argument("--only", help=argparse.SUPPRESS)
    parser.add_argument("--particles", type=int, default=8000, help=argparse.SUPPRESS)
    parser.add_argument("--substeps", type=int, default=SUBSTEPS, help=argparse.SUPPRESS)
    parser.add_argument("--frames", type=int, default=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only:
        size = options.particles, options.substeps, options.frames
        print(json.dumps(peak_memory() if options.only == "memory" else measure(options.only, *size)))
        return
    results: Record = {**made(), "load": os.getloadavg()[0], "rounds": options.rounds}
    own = [__file__, "--only"]
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in MATERIALS}
    for _ in range(options.rounds):
        for name, done in runs.items():
            done.append(json.loads(child([*own, name], 1, cache=False)))
    results["one"] = {name: {key: median(run[key] for run in done) for key in done[0]} for name, done in runs.items()}
    elastic = [run["backward_cpu_ms"] / run["recording_cpu_ms"] for run in runs["NeoHookean"]]
    results["elastic_ratio"] = [min(elastic), max(elastic)]
    for key, threads in (("one", 1), ("two", 2)):
        results[f"{key}_rounds"], results[f"{key}_yardstick"] = [], []
        for _ in range(options.rounds if options.yardstick else 0):
            results[f"{key}_rounds"].append(json.loads(child([*own, "NeoHookean"], threads, cache=True)))
            results[f"{key}_yardstick"].append(yardstick(options.yardstick, threads, processor_time=key == "one"))
    results["scaling"] = {str(particles): scaling(particles, options.rounds) for particles in (8000, 29**3)}
    if options.before:
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], cwd=options.before, capture_output=True, text=True
        )
        results["before"] = {"commit": commit.stdout.strip(), "ms": beside(options.before, options.rounds)}
    results["growth"] = growth()
    results["memory"] = json.loads(child([*own, "memory"], 2, cache=True))
    print(page(results))
    if options.keep:
        keep("engine", results, page)
        draw(results["growth"])


if __name__ == "__main__":
    main()
