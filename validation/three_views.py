"""Parameters of five path-traced scenes from three views, at 128 x 128 pixels and 3 cm.

    python -m validation.three_views --videos ../shared/data --work runs/three_views

One scene of each family of laws, from other simulators than this one: views 0, 4 and 8, the configuration `cpu` with
3v-dagger, from the guess of the scene's configuration. Identification by images ends with the weighted fit to the
outlines, here of 10,000 particles, so that its grids are finer than 3 cm, too. No run reads the true values, but the
method was built while these scenes were looked at: **development figures**. The yardstick is the best published mean
from three views on the nine PAC-NeRF scenes (ProJo4D, 2026): of other scenes, so no comparison. A study that was
stopped goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from pacnerf_lpo import __main__ as program
from pacnerf_lpo.evaluation.parameter_errors import parameter_errors, read_truth
from validation.record import Record, keep, made, origin, table

SCENES = ("torus", "droplet", "playdoh", "cream", "trophy")
PARTICLES = 10_000
YARDSTICK = {
    "torus": {"E": 0.087, "nu": 0.106},
    "droplet": {"mu": 0.071, "kappa": 1.90},
    "playdoh": {"E": 0.89, "nu": 0.158, "tau_y": 0.132},
    "cream": {"tau_y": 0.032, "eta": 0.507},
    "trophy": {"theta": 0.0157},
}
"""Mean errors of decimal logarithms, of Poisson's ratio as they are, of the friction angle in radians."""
COMMAND = "`python -m validation.three_views --videos ../shared/data --work runs/three_views`"
MINUTES = 40
"""Asked for, on two idle cores."""


def path_traced(name: str, videos: Path) -> tuple[list[str], Path]:
    """What `fit` is told about a path-traced scene, and its truth."""
    return [f"--config=shared/{name}", f"--data.root={videos / name}"], videos / name / "truth.json"


def fitted(run: Path, configs: Sequence[str], words: Sequence[str], truth: Path) -> Record:
    """The results of a run with these configurations and words; what is there already is not done again."""
    begin = [*(f"--config={name}" for name in ("fit", *configs)), *words, "--outer_loop.compare_methods=false"]
    begin += [f"--outer_loop.run_dir={run}", f"--truth={truth}"]
    if not (run / "results.json").is_file():
        goes_on = ["--resume", str(run)] if (run / "manifest.json").is_file() else begin
        if program.main(["fit", *goes_on]):
            raise SystemExit(f"the fit of {run} failed")
    return json.loads((run / "results.json").read_text())


def weighted(results: Record, truth: Path) -> Record:
    """By parameter: its errors by images and by the first weighted fit, whether that has determined it, and whether its
    interval holds the true value.
    """
    answer, intervals = read_truth(truth), results["intervals"]["parameters"]
    phase = next(phase for phase in results["phases"] if "before" in phase)
    found = {}
    for name in set(results["free"]) & set(phase["truth_errors"]):
        own, before = phase["truth_errors"][name], {name: phase["before"][name]}
        found[name] = {
            "by_images": parameter_errors(before, answer, answer.fluid)[name].error,
            "error": own["error"],
            "determined": intervals[name]["determined"],
            "inside": intervals[name]["low"] <= own["true"] <= intervals[name]["high"],
        }
    return {name: found[name] for name in results["free"] if name in found}


def in_words(one: Record) -> str:
    """Whether an interval holds the true value."""
    return ("yes" if one["inside"] else "no") + ("" if one["determined"] else ", not determined")


def page(record: Record) -> str:
    """The record as Markdown."""
    rows = []
    for scene, one in record["scenes"].items():
        for name, found in one["parameters"].items():
            asked = YARDSTICK[scene].get(name)
            missed = asked is not None and found["error"] > asked
            cells = [f"{found['by_images']:.3f}", f"{found['error']:.3f}", "-" if asked is None else f"{asked:.3f}"]
            rows.append([scene, name, *cells, "missed" if missed else "", in_words(found), f"{one['minutes']:.1f}"])
    head = ["scene", "error of", "by images", "weighted fit", "yardstick", "", "in its interval", "minutes"]
    inside = sum(row[-2].startswith("yes") for row in rows)
    lines = [
        "# Parameters from three views",
        "",
        origin(record, "three_views", COMMAND),
        "",
        (__doc__ or "").partition("three_views\n")[2].strip(),
        "",
        "Errors are of decimal logarithms, of Poisson's ratio as they are, of the friction angle in radians. Minutes",
        f"are of all phases and the weighted fit, by one process with other work beside it; {MINUTES} are asked for.",
        "",
        table(head, rows),
        "",
        f"90 % intervals hold {inside} of {len(rows)} true values.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--videos", type=Path, required=True, help="folder of the path-traced videos")
    parser.add_argument("--work", type=Path, required=True, help="folder for the runs")
    options = parser.parse_args()
    found: Record = {**made(), "scenes": {}}
    for name in SCENES:
        found["scenes"][name] = measured(name, options.videos.resolve(), options.work.resolve())
    keep("three_views", found, page)
    print(page(found))


def measured(name: str, videos: Path, work: Path) -> Record:
    """Of one scene, with the minutes that it took."""
    words, truth = path_traced(name, videos)
    configs = (f"scenes/{name}", "baselines/3v_dagger", "cpu", "corrections/none")
    results = fitted(work / name, configs, [*words, f"--intervals={PARTICLES}"], truth)
    seconds = results["intervals"]["seconds"] + sum(phase["seconds"] for phase in results["phases"])
    return {"parameters": weighted(results, truth), "minutes": seconds / 60}


if __name__ == "__main__":
    main()
