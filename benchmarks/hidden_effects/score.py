"""Score the diagnosed scenes: ``python -m benchmarks.hidden_effects.score FOLDER --out PAGE.md``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from benchmarks.hidden_effects.outcomes import Outcome, outcome
from benchmarks.hidden_effects.plan import SCORED
from benchmarks.hidden_effects.run import scenes_in
from pacnerf_lpo.manifest import write_atomically

NOTES = """
*Named and accepted*: the verdict names the class and the effect passed the acceptance on held-out views and frames.
*Class*: the effect or one that the diagnosis says it cannot tell from it in this video; linear and quadratic drag, and
shift and rotation of one camera, always count as one. *Top-1, top-3*: of the ranking, whether accepted or not: the
accepted effect, other refits by misfit, the rest by score; of a pair, one of the two. *90 % interval covers*: true
coefficients of accepted effects, by the table that the report ends with (the noise is that of twins with the effect),
then by the first refit wherever there was one (twins without it), then the true material and velocity by the last table
where all that was hidden had been accepted. Error of coefficients: of the first refit. *Outside the catalogue*: 20
sigma are left of the effect by its best imitation among the known ones. Intervals in brackets are exact binomial ones
at 95 %. A diagnosis that failed counts as wrong everywhere.
"""


def share(hits: Sequence[bool]) -> str:
    """A share with its counts and its exact 95 % interval."""
    if not hits:
        return "-"
    low, high = binomtest(sum(hits), len(hits)).proportion_ci(0.95)
    return f"{sum(hits)}/{len(hits)} = {np.mean(hits):.0%} [{low:.0%}, {high:.0%}]"


def median(values: Sequence[float | None], form: str = ".0%") -> str:
    """Median of the values there are."""
    there = [value for value in values if value is not None and np.isfinite(value)]
    return f"{np.median(there):{form}}" if there else "-"


Group = tuple[str, Callable[[Outcome], bool]]
EFFECTS: tuple[Group, ...] = (
    ("single effect, 20 sigma", lambda o: o.family == "single" and o.snr == 20),
    ("single effect, 7 sigma", lambda o: o.family == "single" and o.snr == 7),
    ("single effect, 3 sigma", lambda o: o.family == "single" and o.snr == 3),
    ("camera fault, 20 sigma", lambda o: o.family == "camera"),
    ("pair of effects, 20 sigma each", lambda o: o.family == "pair"),
)


def effect_table(outcomes: Sequence[Outcome]) -> list[str]:
    """How well hidden effects of the catalogue are named."""
    lines = [
        "| hidden | named and accepted | class top-1 | class top-3 | exact top-1 | exact top-3 "
        "| excess removed where accepted | 90 % interval covers | in the first refit | material and velocity "
        "| coefficient error | base bias before → after |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for title, belongs in EFFECTS:
        group = [o for o in outcomes if belongs(o)]
        if not group:
            continue
        right = [all(o.found(name) for name in o.truth) for o in group]
        ranked = [share([o.within(count, exact) for o in group]) for exact in (False, True) for count in (1, 3)]
        removed = median([o.removed for o, named in zip(group, right, strict=True) if named])
        covered = [
            share([inside for o in group for inside in told(o)])
            for told in (lambda o: o.stated, lambda o: o.coefficients, lambda o: o.base_stated)
        ]
        bias = [o.bias for o, named in zip(group, right, strict=True) if named and o.bias is not None]
        change = f"{median([b for b, _ in bias], '.2f')} → {median([a for _, a in bias], '.2f')}"
        error = median([o.coefficient_error for o in group])
        lines.append(f"| {' | '.join([title, share(right), *ranked, removed, *covered, error, change])} |")
    return lines


def other_table(outcomes: Sequence[Outcome]) -> list[str]:
    """False alarms and effects outside the catalogue."""
    nulls = [o for o in outcomes if o.family == "null"]
    lines = ["| what | share |", "|---|---|"]
    rows = [
        ("null: an effect accepted", [bool(o.accepted) or o.kind == "failed" for o in nulls]),
        ("null: anything but *nothing is missing*", [o.kind != "nothing" for o in nulls]),
        ("null: *nothing is missing*, but the reconstruction in doubt", [o.in_doubt for o in nulls]),
        ("null: true material and velocity in their 90 % intervals", [inside for o in nulls for inside in o.base]),
    ]
    outside = [o for o in outcomes if o.family == "outside"]
    for title, strange in (
        ("outside the catalogue", [o for o in outside if o.beyond is not None]),
        ("outside, 20 sigma beside material and velocity alone", [o for o in outside if o.beyond is None]),
    ):
        unknown = [o.kind == "unknown" for o in strange]
        rows += [
            (f"{title}: *none of the known effects*", unknown),
            (
                f"{title}: that, or an effect accepted and the rest declared more than noise",
                [plain or (o.unexplained and bool(o.accepted)) for plain, o in zip(unknown, strange, strict=True)],
            ),
            (f"{title}: a known effect accepted", [bool(o.accepted) for o in strange]),
        ]
    return lines + [f"| {title} | {share(hits)} |" for title, hits in rows if hits]


def scene_table(outcomes: Sequence[Outcome]) -> list[str]:
    """What was said of every scene."""
    lines = [
        "| seed | hidden | sigma | verdict | accepted | first in the ranking | CPU |",
        "|---|---|---|---|---|---|---|",
    ]
    for o in outcomes:
        cells = [
            f"{o.seed}",
            " + ".join(o.truth) or "nothing",
            f"{o.snr:g}" if o.truth else "",
            o.kind,
            ", ".join(o.accepted) or "-",
            ", ".join(o.ranking[:3]),
            f"{o.seconds:.0f} s",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def page(outcomes: Sequence[Outcome], command: str, note: str) -> str:
    """The whole result as Markdown."""
    lines = ["# Hidden effects", "", f"`{command}` wrote this page.", ""]
    scored = all(o.seed in SCORED for o in outcomes)
    which = "scored seeds, disjoint from those used in development" if scored else "development seeds"
    lines += [f"{len(outcomes)} scenes, {which}. {note}".strip(), *NOTES.splitlines()]
    for views, title in (
        (None, "Shape known (fast path)"),
        ("3 views", "Full reconstruction from three views of the video"),
        ("all views", "Full reconstruction from all views of the video"),
    ):
        part = [o for o in outcomes if o.views == views]
        if part:
            lines += ["", f"## {title}: {len(part)} scenes", ""]
            lines += [*effect_table(part), "", *other_table(part), "", "<details><summary>Every scene</summary>", ""]
            lines += [*scene_table(part), "", "</details>"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, help="Markdown page to write; the outcomes go beside it as JSON")
    parser.add_argument("--note", default="", help="a sentence for the page, such as which version was scored")
    options = parser.parse_args()
    found = [outcome(scene) for folder in options.folders for scene in scenes_in(folder)]
    outcomes = sorted((o for o in found if o is not None), key=lambda o: (o.views or "", o.seed))
    command = f"python -m benchmarks.hidden_effects.score {' '.join(folder.name for folder in options.folders)}"
    text = page(outcomes, command, options.note)
    print(text)
    if options.out:
        write_atomically(options.out, text.encode())
        lines = ",\n".join(json.dumps(asdict(o)) for o in outcomes)
        write_atomically(options.out.with_suffix(".json"), f"[\n{lines}\n]\n".encode())


if __name__ == "__main__":
    main()
