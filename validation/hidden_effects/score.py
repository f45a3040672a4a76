"""Score the diagnosed scenes: ``python -m validation.hidden_effects.score FOLDER --keep``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest, kstest

from pacnerf_lpo.inference.decision import LEVEL
from validation.hidden_effects.outcomes import Outcome, outcome
from validation.hidden_effects.plan import SCORED
from validation.hidden_effects.run import scenes_in
from validation.record import Record, keep, made, origin, read

NOTES = f"""
*Class named*: the verdict names the hidden effect, or one that it says this recording does not tell apart from it.
*Named*: that very effect. *First, first three*: of the ranking of the first round, refits by their odds, by which
the verdict chooses, then the others by their Bayes factors, whatever the verdict; of a pair, one of the two.
*p-value*: of the best of all hypotheses of the first round, unknown force and wrong shape among them, before any
was fitted; the level is {LEVEL:.0%}. *Covered*: true values in the 90 % intervals that the report shows, which
contain what another solver may change, and in those of this solver alone: of hidden coefficients wherever the last
model has them, of material and velocity where the verdict is right.
*Outside the catalogue*: 20 sigma are left of the effect by its best imitation among the known ones, or, where that
was not measured, by material and velocity alone. Intervals in brackets are exact binomial ones at 95 %. A diagnosis
that failed counts as wrong everywhere.
"""
Row = tuple[str, Sequence[bool]]
Group = Callable[[Outcome], bool]


def share(hits: Sequence[bool]) -> str:
    """A share with its counts and its exact 95 % interval."""
    if not hits:
        return "-"
    low, high = binomtest(sum(hits), len(hits)).proportion_ci(0.95)
    return f"{sum(hits)}/{len(hits)} = {np.mean(hits):.0%} [{low:.0%}, {high:.0%}]"


def table(title: str, rows: Sequence[Row], *more: str) -> list[str]:
    """A heading, shares, and further lines; nothing without a scene."""
    shown = [f"| {what} | {share(hits)} |" for what, hits in rows if len(hits)]
    return [f"### {title}", "", "| what | share |", "|---|---|", *shown, *more, ""] if shown else []


def single(outcomes: Sequence[Outcome]) -> list[Row]:
    """Of scenes with one hidden effect."""
    return [
        ("class named", [o.found(o.truth[0]) for o in outcomes]),
        ("named", [o.truth[0] in o.named for o in outcomes]),
        ("something else named, and not the class", [bool(o.named) and not o.found(o.truth[0]) for o in outcomes]),
        ("first of the ranking", [o.top(1) for o in outcomes]),
        ("among the first three", [o.top(3) for o in outcomes]),
    ]


def pair(outcomes: Sequence[Outcome]) -> list[Row]:
    """Of scenes with two hidden effects."""
    counts = [sum(o.found(name) for name in o.truth) for o in outcomes]
    return [
        ("classes of both named", [count == 2 for count in counts]),
        ("class of at least one named", [count >= 1 for count in counts]),
        ("one of the two among the first three", [o.top(3) for o in outcomes]),
    ]


def null(outcomes: Sequence[Outcome]) -> list[Row]:
    """Of scenes in which nothing is hidden."""
    return [
        ("false alarm: an effect or a camera named", [bool(o.named) or o.failed for o in outcomes]),
        ("false alarm: *none of the known effects*", [o.kind == "unknown" for o in outcomes]),
        ("any verdict but *nothing is missing*", [o.kind != "nothing" for o in outcomes]),
        (
            "*nothing is missing*, but what is left is more than predicted",
            [o.kind == "nothing" and o.more_than_noise for o in outcomes],
        ),
    ]


def uniformity(outcomes: Sequence[Outcome]) -> list[str]:
    """Kolmogorov-Smirnov tests of the p-values of null scenes."""
    lines = []
    for what, p_values in (
        ("p-values", [o.p_value for o in outcomes if o.p_value is not None]),
        ("Where hypotheses were fitted, p-values", [o.fitted for o in outcomes if o.fitted is not None]),
    ):
        if p_values:
            both, small = kstest(p_values, "uniform"), kstest(p_values, "uniform", alternative="greater")
            tested = f"Kolmogorov-Smirnov D = {both.statistic:.2f} (p = {both.pvalue:.2g})"
            lines += [
                "",
                f"{what} of {len(p_values)} nulls: median {np.median(p_values):.2f}, least {min(p_values):.2g}; "
                f"against the uniform distribution, {tested}; too many small ones: p = {small.pvalue:.2g}.",
            ]
    return lines


def outside(outcomes: Sequence[Outcome]) -> list[Row]:
    """Of scenes with an effect that the catalogue has not."""
    return [
        ("*none of the known effects*", [o.kind == "unknown" for o in outcomes]),
        (
            "that, or an effect named and the rest declared more than predicted",
            [o.kind == "unknown" or (bool(o.named) and o.more_than_noise) for o in outcomes],
        ),
        ("a known effect named", [bool(o.named) for o in outcomes]),
    ]


FAMILIES: tuple[tuple[str, Group, Callable[[Sequence[Outcome]], list[Row]]], ...] = (
    ("Single effects at 20 sigma", lambda o: o.family == "single" and o.snr == 20, single),
    ("Single effects at 7 sigma", lambda o: o.family == "single" and o.snr == 7, single),
    ("Single effects at 3 sigma", lambda o: o.family == "single" and o.snr == 3, single),
    ("Pairs of effects at 20 sigma each", lambda o: o.family == "pair", pair),
    ("Camera faults at 20 sigma", lambda o: o.family == "camera", single),
    ("Nothing hidden", lambda o: o.family == "null", null),
    ("Outside the catalogue", lambda o: o.family == "outside" and o.beyond is not None, outside),
    (
        "Outside the catalogue, relative to material and velocity",
        lambda o: o.family == "outside" and o.beyond is None,
        outside,
    ),
)


Right = Callable[[Outcome, str, list[str]], bool]
ONE: list[tuple[str, Right]] = [
    ("named, and nothing else", lambda o, _, named: tuple(named) == o.truth),
    ("something else named", lambda o, _, named: bool(set(named) - set(o.truth))),
]
RIGHT: dict[Callable, list[tuple[str, Right]]] = {
    single: ONE,
    pair: [("both named, and nothing else", lambda o, _, named: sorted(named) == sorted(o.truth)), ONE[1]],
    null: [("anything but *nothing is missing*", lambda _, kind, __: kind != "nothing")],
    outside: [("*none of the known effects*", lambda _, kind, __: kind == "unknown")],
}


def tables(outcomes: Sequence[Outcome]) -> list[str]:
    """One for each family, and one of the coverage."""
    lines: list[str] = []
    for title, belongs, rows in FAMILIES:
        group = [o for o in outcomes if belongs(o)]
        lines += table(f"{title}: {len(group)}", rows(group), *(uniformity(group) if rows is null else []))
    parts = [
        (f"{what}, {title}{whose}", [covers for o in group for covers in o.inside(kind, alone)])
        for alone, whose in ((False, ""), (True, "; by this solver alone"))
        for kind, what in (("coefficient", "hidden coefficients"), ("material", "material"), ("velocity", "velocity"))
        for title, group in (
            ("where an effect was hidden", [o for o in outcomes if o.truth]),
            ("where nothing was", [o for o in outcomes if not o.truth]),
        )
    ]
    return lines + table("Covered by 90 % intervals", parts)


def compared(outcomes: Sequence[Outcome]) -> list[str]:
    """The diagnosis compared with simpler rules, on the scenes that have both."""
    both = [o for o in outcomes if o.simpler]
    if not both:
        return []
    rules = [None, *both[0].simpler]
    lines = [
        "### Compared with simpler rules",
        "",
        "Exact names only, for no other rule has classes. The other rules are in validation/hidden_effects/simpler.py.",
        "",
        f"| what | {' | '.join(rule or 'this diagnosis' for rule in rules)} |",
        f"|{'---|' * (len(rules) + 1)}",
    ]
    for title, belongs, rows in FAMILIES:
        group = [o for o in both if belongs(o)]
        if not group:
            continue
        for what, right in RIGHT[rows]:
            cells = [share([right(o, *o.said_by(rule)) for o in group]) for rule in rules]
            lines.append(f"| {title}: {what} | {' | '.join(cells)} |")
    return [*lines, ""]


def scene_table(outcomes: Sequence[Outcome]) -> list[str]:
    """What was said of every scene."""
    lines = [
        "| seed | hidden | sigma | verdict | named | first in the ranking | p | CPU |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for o in outcomes:
        cells = [
            f"{o.seed}",
            " + ".join(o.truth) or "nothing",
            f"{o.snr:g}" if o.truth else "",
            o.kind + (", more is left" if o.more_than_noise else ""),
            ", ".join(" ~ ".join(group) for group in o.classes) or "-",
            ", ".join(o.ranking[:3]),
            "-" if o.p_value is None else f"{o.p_value:.2g}",
            f"{o.seconds:.0f} s",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def page(record: Record) -> str:
    """The record as Markdown."""
    outcomes = [outcome_of(values) for values in record["outcomes"]]
    by = "`generate`, `run` and `score` of `python -m validation.hidden_effects`"
    lines = ["# Hidden effects", "", origin(record, "hidden_effects", by), ""]
    scored = all(o.seed in SCORED for o in outcomes)
    which = "scored seeds, disjoint from those used in development" if scored else "development seeds"
    lines += [f"{len(outcomes)} scenes, {which}. {record['note']}".strip(), *NOTES.splitlines()]
    for views, title in (
        (None, "Shape known (fast path)"),
        ("3 views", "Full reconstruction from three views of the video"),
        ("all views", "Full reconstruction from all views of the video"),
    ):
        part = [o for o in outcomes if o.views == views]
        if part:
            lines += ["", f"## {title}: {len(part)} scenes", "", *tables(part), *compared(part)]
            lines += ["<details><summary>Every scene</summary>", "", *scene_table(part), "", "</details>"]
    return "\n".join(lines) + "\n"


def outcome_of(values: Record) -> Outcome:
    """What :func:`compact` made plain."""

    def tupled(value: Any) -> Any:
        return tuple(map(tupled, value)) if isinstance(value, list) else value

    return Outcome(**{name: tupled(value) for name, value in values.items()})


def together(before: Sequence[Outcome], found: Sequence[Outcome | None]) -> list[Outcome]:
    """Scenes by views and seed; those that were found again are as they were found last."""
    by_scene = {(o.views or "", o.seed): o for o in (*before, *found) if o is not None}
    return [by_scene[scene] for scene in sorted(by_scene)]


def compact(outcomes: Sequence[Outcome]) -> list[Record]:
    """The outcomes as plain values, without what is as by default; covered as 0 or 1."""
    defaults = {f.name: f.default for f in fields(Outcome)}

    def values(o: Outcome) -> Record:
        covered = {"covered": o.covered, "covered_alone": o.covered_alone}
        digits = {key: {name: int(covers) for name, covers in table.items()} for key, table in covered.items()}
        found = {**asdict(o), **digits}
        return {name: value for name, value in found.items() if value not in (defaults[name], {})}

    return json.loads(json.dumps([values(o) for o in outcomes]))


def written(record: Record) -> str:
    """The record as JSON, an outcome to a line."""
    lines = [json.dumps(values, separators=(",", ":")) for values in record["outcomes"]]
    head = json.dumps({name: value for name, value in record.items() if name != "outcomes"}, ensure_ascii=False)
    return head[:-1] + ', "outcomes": [\n' + ",\n".join(lines) + "\n]}\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--keep", action="store_true", help="write validation/results/hidden_effects.json and its page")
    parser.add_argument("--add", action="store_true", help="to the scenes of that file, drawn by the same version")
    parser.add_argument("--note", default="", help="a sentence for the page, such as which version was scored")
    options = parser.parse_args()
    found = [outcome(scene) for folder in options.folders for scene in scenes_in(folder)]
    before = read("hidden_effects") if options.add else {"note": "", "outcomes": []}
    outcomes = together([outcome_of(values) for values in before["outcomes"]], found)
    record = {**made(), "note": options.note or before["note"], "outcomes": compact(outcomes)}
    print(page(record))
    if options.keep:
        keep("hidden_effects", record, page, written(record))


if __name__ == "__main__":
    main()
