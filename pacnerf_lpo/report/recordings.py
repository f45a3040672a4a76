"""The recordings of a study on the page of a diagnosis: what each shows, and what it contributes."""

from collections.abc import Mapping
from typing import Any

from pacnerf_lpo.report.diagnosis_markup import row, table, text
from pacnerf_lpo.report.wording import listed, readable

Result = Mapping[str, Any]


def recordings_section(result: Result) -> str:
    """A table of the recordings with a sentence on each; nothing where there is one only."""
    recordings = result.get("recordings", [])
    if len(recordings) < 2:
        return ""
    labels = {p["name"]: p["label"] for p in result["rounds"][0]["parameters"]}
    rows = []
    for number, one in enumerate(recordings, 1):
        tells = [f"{text(labels.get(name, name))} {share:.0%}" for name, share in one["tells"].items()]
        seen = f"{len(one['views'])} views, {len(one['frames'])} frames"
        cells = f"{number}: {text(one['name'])}", seen, text(phases_of(one)), text(asks_for(one)), ", ".join(tells)
        rows.append(row(cells))
    head = ["recording", "what there is", "motion", "asks for", "its share of what is known of"]
    return (
        f'<section><h2>What each recording contributes</h2><div class="card scroll">{table(head, rows)}</div></section>'
    )


def phases_of(recording: Mapping[str, Any]) -> str:
    """``free fall, impact and rebound``."""
    return listed(list(dict.fromkeys(recording["phases"])), "and")


def asks_for(recording: Mapping[str, Any]) -> str:
    """Which of the fitted effects explains this recording best, by how much its cost falls."""
    refits = recording["refits"]
    if not refits:
        return f"no effect was fitted (cost {recording['cost']:.0f} of {recording['numbers']} numbers)"
    best = min(refits, key=lambda name: refits[name])
    return f"{readable(best)}: cost {recording['cost']:.0f} falls to {refits[best]:.0f}"
