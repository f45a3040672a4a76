"""Whether rounds of LPO better the parameters, as published and after the weighted fit.

    python -m validation.rounds --work runs/rounds [--shared ../shared/data]

Five bodies, one of each family of laws, from three views (3v-dagger at the reduced resolution of cpu and cpu_coarse),
identified by images as published (*3v†*, from the guess of the scene's configuration), and then by the weighted fit to
the outlines with which an identification ends unless `fit` is told `--intervals false`. Four rounds of LPO follow; the
parameters of a round are identified before its correction.

*Matched* scenes have the solver, the grid and the time step of the model, as the paper's have: `synthesize` drops a
body (of other particles than the model has) and films it with camera noise; as in the paper the model knows the ground.
*Path-traced* scenes come from other simulators. All are **development figures**: these scenes had shown that the
weighted fit must search the whole parameter space first (begun at the values by images, it had cream's yield stress a
thousand times too small), that it is right where images are not, that it must not bend the shape, and that later
rounds, by images, must stay inside its intervals. A study that was stopped goes on.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from pacnerf_lpo.commands import synthesize
from pacnerf_lpo.data.shapes import Ball, Block, Shape, Torus
from pacnerf_lpo.mpm.materials import (
    DruckerPrager,
    Material,
    NeoHookean,
    Newtonian,
    ViscoplasticVonMises,
    VonMises,
)
from validation.record import Record, keep, made, origin, table
from validation.three_views import fitted, in_words, path_traced, weighted

ROUNDS, VIEWS, FRAMES, PIXELS, RATE = 4, 11, 14, 128, 24.0
DX, SUBSTEP_RATE = 0.04, 1800.0
"""Of data and model: the configuration cpu_coarse has them."""
BOX = {"box_lower": "[-0.5,0.1,-0.5]", "box_upper": "[0.5,1.2,0.5]"}
SPEED, GRAVITY = 1.0, 9.8
WORSE = 0.1
"""No error may grow by more, as a decimal logarithm, of Poisson's ratio, or in radians."""
SUPERSCRIPTS = ("", "²", "³", "⁴")
COMMAND, OPTION = "python -m validation.rounds --work runs/rounds", " --shared ../shared/data"
LATER = [f"round {index}" for index in range(2, ROUNDS + 1)]


@dataclass(frozen=True)
class Scene:
    """A body that falls.

    half: from its centre to its lowest point [m];  height: of the centre at frame 0 [m]
    """

    material: Material
    shape: Shape
    half: float
    height: float
    seed: int


SCENES = {
    "torus": Scene(NeoHookean(E=1e6, nu=0.3), Torus(0.2, 0.08), 0.28, 0.8, 11),
    "droplet": Scene(Newtonian(mu=200.0, kappa=1e5), Ball(0.2), 0.2, 0.6, 12),
    "playdoh": Scene(VonMises(E=2e6, nu=0.3, tau_y=15400.0), Block((0.4, 0.25, 0.3)), 0.125, 0.6, 13),
    "cream": Scene(ViscoplasticVonMises(mu=1e4, kappa=1e6, tau_y=3e3, eta=10.0), Ball(0.18), 0.18, 0.7, 14),
    "trophy": Scene(DruckerPrager(theta=40.0, E=1e6, nu=0.3), Block((0.3, 0.4, 0.3)), 0.2, 0.55, 15),
}


def contact(scene: Scene) -> int:
    """The first frame in which the falling body is where the grid feels the ground: one and a half cells above it."""
    drop = scene.height - scene.half - 1.5 * DX
    seconds = (np.sqrt(SPEED**2 + 2 * GRAVITY * drop) - SPEED) / GRAVITY
    return int(np.ceil(seconds * RATE))


def matched(name: str, work: Path) -> tuple[list[str], Path]:
    """What `fit` is told about a matched scene, and its truth; its video is made where it is not there."""
    scene, video = SCENES[name], work / "matched" / name / "video"
    if not video.is_dir():
        synthesize.run(
            str(video), scene.material, scene.shape, height=scene.height, velocity=(0.0, -SPEED, 0.0), frames=FRAMES,
            views=VIEWS, image_size=PIXELS, dx=DX, substep_rate=SUBSTEP_RATE, seed=scene.seed,
        )  # fmt: skip
    words = [f"--data.root={video}", f"--data.frames={FRAMES}", "--data.image_scale=0.5"]
    words += [f"--data.{key}={value}" for key, value in BOX.items()]
    words += [f"--phases.velocity.init_args.hit_frame={contact(scene)}", "--phases.static.init_args.base_spacing=0.16"]
    return [*words, "--physics.fit_ground_height=false"], video / "truth.json"


def measured(name: str, run: Path, words: Sequence[str], truth: Path) -> Record:
    """Errors of a scene's parameters by images, by the weighted fit and after each round, whether its intervals hold
    the true values, and image quality of the unseen views before and after each correction.
    """
    results = four_rounds(name, run, words, truth)
    errors, psnr = course(results)
    found = weighted(results, truth)
    return {
        "errors": {key: [one["by_images"], *errors[key]] for key, one in found.items()},
        "inside": {key: in_words(one) for key, one in found.items()},
        "psnr": psnr,
    }


def four_rounds(name: str, run: Path, words: Sequence[str], truth: Path) -> Record:
    """The results of a run with corrections."""
    configs = (f"scenes/{name}", "baselines/3v_dagger", "cpu", "cpu_coarse", "corrections/lpo")
    return fitted(run, configs, [*words, f"--outer_loop.rounds={ROUNDS}"], truth)


def course(results: Record) -> tuple[dict[str, list[float]], list[float]]:
    """Errors of each parameter in each round, and PSNR of unseen views before and after each correction [dB]."""
    identified = [phase for phase in results["phases"] if phase["phase"] == "physics"]
    corrected = [phase for phase in results["phases"] if phase["phase"] == "correction"]
    found = [phase["truth_errors"] for phase in identified]
    errors = {key: [errors[key]["error"] for errors in found] for key in results["free"] if key in found[0]}
    return errors, [phase["image_metrics"]["test"]["psnr"] for phase in (identified[0], *corrected)]


def page(results: Record) -> str:
    """The record as Markdown."""
    lines = [
        "# Rounds of correction and identification",
        "",
        origin(results, "rounds", f"`{COMMAND}{OPTION if 'path_traced' in results else ''}`"),
        "",
        (__doc__ or "").partition("shared/data]\n")[2].strip(),
        "",
        "Errors are of decimal logarithms, of Poisson's ratio as they are, of the friction angle in radians; PSNR is",
        "that of unseen views.",
    ]
    for kind, title in (("matched", "Matched scenes"), ("path_traced", "Path-traced scenes")):
        if scenes := results.get(kind):
            lines += ["", f"## {title}", "", *_section(scenes)]
    if scenes := results.get("published"):
        rows = _rows(scenes)
        lines += ["", "## Matched scenes, as published", "", "The same with `--intervals false`:", ""]
        lines += [_psnr("3v†", scenes), "", _errors(["3v†", *LATER], rows), "", f"- {_closer(rows, 2, 1 + ROUNDS)}."]
    return "\n".join(lines) + "\n"


def _section(scenes: Record) -> list[str]:
    rows = [(*row, scenes[row[0]]["inside"][row[1]]) for row in _rows(scenes)]
    held = sum(row[-1].startswith("yes") for row in rows)
    rising = sum(all(a < b for a, b in pairwise(one["psnr"])) for one in scenes.values())
    return [
        _psnr("weighted fit", scenes),
        "",
        _errors(["3v†", "weighted fit", *LATER, "in its interval"], rows),
        "",
        f"- The weighted fit: {_closer(rows, 2, 3)}.",
        f"- After four rounds: {_closer(rows, 2, 2 + ROUNDS)}.",
        f"- By the rounds alone, after the weighted fit: {_closer(rows, 3, 2 + ROUNDS)}.",
        f"- Intervals of the weighted fit hold {held} of {len(rows)} true values.",
        f"- PSNR rises with each round in {rising} of {len(scenes)} scenes.",
    ]


def _rows(scenes: Record) -> list[tuple]:
    return [(scene, key, *errors) for scene, one in scenes.items() for key, errors in one["errors"].items()]


def _psnr(first: str, scenes: Record) -> str:
    rows = [[scene, *(f"{value:.2f}" for value in one["psnr"])] for scene, one in scenes.items()]
    return table(["PSNR [dB]", first, *(f"+LPO{index}" for index in SUPERSCRIPTS[:ROUNDS])], rows)


def _errors(head: Sequence[str], rows: Sequence[tuple]) -> str:
    shown = [[cell if isinstance(cell, str) else f"{cell:.3f}" for cell in row] for row in rows]
    return table(["scene", "error of", *head], shown)


def _closer(rows: Sequence[tuple], before: int, after: int) -> str:
    """How many errors are smaller in one column than in another, and which are much larger."""
    closer = sum(row[after] < row[before] for row in rows)
    worse = [f"{row[1]} of {row[0]}" for row in rows if row[after] > row[before] + WORSE]
    return (
        f"{closer} of {len(rows)} parameters are closer to the truth than before; farther by more than {WORSE}: "
        f"{', '.join(worse) or 'none'}"
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True, help="folder for videos and runs")
    parser.add_argument("--shared", type=Path, help="folder of the path-traced videos; else without them")
    options = parser.parse_args()
    work, found = options.work.resolve(), Record(made())
    found |= {"matched": {}, "published": {}} | ({"path_traced": {}} if options.shared else {})
    for name in SCENES:
        folder, (words, truth) = work / "matched" / name, matched(name, work)
        found["matched"][name] = measured(name, folder / "run", words, truth)
        errors, psnr = course(four_rounds(name, folder / "published", [*words, "--intervals=false"], truth))
        found["published"][name] = {"errors": errors, "psnr": psnr}
        if options.shared:
            words, truth = path_traced(name, options.shared.resolve())
            found["path_traced"][name] = measured(name, work / "path_traced" / name, words, truth)
    keep("rounds", found, page)
    print(page(found))


if __name__ == "__main__":
    main()
