"""The recordings of a study on the page of a diagnosis: what each shows, and what it contributes."""

from collections.abc import Mapping
from typing import Any

from pacnerf_lpo.report.page import parts
from pacnerf_lpo.report.wording import listed, readable


def recordings_section(result: Mapping[str, Any]) -> str:
    """A table of the recordings with a sentence on each; nothing where there is one only."""
    recordings = result.get("recordings", [])
    if len(recordings) < 2:
        return ""
    labels = {p["name"]: p["label"] for p in result["rounds"][0]["parameters"]}
    rows = []
    for number, one in enumerate(recordings, 1):
        tells = ", ".join(f"{labels.get(name, name)} {share:.0%}" for name, share in one["tells"].items())
        seen = f"{len(one['views'])} views, {len(one['frames'])} frames"
        phases = listed(list(dict.fromkeys(one["phases"])), "and")
        rows.append((f"{number}: {one['name']}", seen, phases, asks_for(one), tells))
    return parts("diagnosis").recordings(rows)


def asks_for(recording: Mapping[str, Any]) -> str:
    """Which of the fitted effects explains this recording best, by how much its cost falls."""
    refits = recording["refits"]
    if not refits:
        return f"no effect was fitted (cost {recording['cost']:.0f} of {recording['numbers']} numbers)"
    best = min(refits, key=lambda name: refits[name])
    return f"{readable(best)}: cost {recording['cost']:.0f} falls to {refits[best]:.0f}"
