"""``plan.json`` and ``plan.html``: which recording to make next, ranked, in words and as bars."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pacnerf_lpo.diagnosis.plan import ENOUGH, Proposal
from pacnerf_lpo.inference.decision import DECISIVE
from pacnerf_lpo.manifest import write_atomically
from pacnerf_lpo.report.diagnosis_words import odds
from pacnerf_lpo.report.page import page as shell
from pacnerf_lpo.report.wording import together

RESULT, PAGE = "plan.json", "plan.html"
BAR, ROW, WIDTH = 18, 46, 720


def write_plan(folder: Path, scene: str, names: Sequence[str], proposals: Sequence[Proposal]) -> Path:
    """Write both files into the folder of a diagnosis; returns the path of the page.

    ``names`` are the hypotheses that are to be separated; the best proposal comes first.
    """
    content = {"scene": scene, "hypotheses": list(names), "proposals": [asdict(one) for one in proposals]}
    write_atomically(folder / RESULT, json.dumps(content, indent=1).encode())
    write_atomically(folder / PAGE, page(scene, names, proposals).encode())
    return folder / PAGE


def sentences(names: Sequence[str], proposals: Sequence[Proposal]) -> list[str]:
    """What to do, best first, and what is expected of it."""
    found = [f"To separate {together(names)}, with the expected odds for the one that is true:"]
    found += [f"{rank}. {one.words}: {odds(one.score)}" for rank, one in enumerate(proposals, 1)]
    best = max((one.score for one in proposals), default=0.0)
    if best < DECISIVE:
        found.append("None of these recordings is expected to decide; two of the best together may.")
    return found


def page(scene: str, names: Sequence[str], proposals: Sequence[Proposal]) -> str:
    """The page as text: one bar for each recording, cut off beyond the longest, and the odds pair by pair."""
    title = f"{scene}: which recording would separate {together(names)}"
    end = 1.05 * ENOUGH
    bars = [
        (rank * ROW, one.score >= DECISIVE, one, WIDTH * float(np.clip(one.score / end, 0.002, 1.0)))
        for rank, one in enumerate(proposals)
    ]
    sizes = {"line": WIDTH * DECISIVE / end, "height": len(proposals) * ROW, "width": WIDTH, "bar": BAR}
    shown = {"heading": title, "odds": odds, "bars": bars, "proposals": proposals}
    return shell("plan", title, ("plan.css",), (), {}, **shown, **sizes)
