"""Pictures of the real measurements for ``docs/real_measurements.md``, from what their diagnoses have written."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.report.flights import ALIGNED, CLEAR

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
DPI = 80
GREY, BLUE, RED = "#999999", "#1f5fa8", "#b5402a"


def draw(work: Path) -> None:
    """``ball_drops.png`` and ``table_tennis.png``, each where its diagnoses are in a working folder."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    written = sorted((work / "diagnoses").glob("*/diagnosis/diagnosis.json"))
    found = {path.parents[1].name: json.loads(path.read_text()) for path in written}
    groups = {name: result for name, result in found.items() if name.startswith("flights_")}
    balls = {name: result for name, result in found.items() if name not in groups}
    if balls:
        _drops(balls)
    if groups:
        _throws(groups)


def _figure(columns: int, rows: int, size: tuple[float, float]) -> tuple[Any, np.ndarray]:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams["font.size"] = 9
    figure, panels = pyplot.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for panel in panels.ravel():
        panel.spines[["top", "right"]].set_visible(False)
        panel.axhline(0.0, color="black", linewidth=0.6)
    return figure, panels.ravel()


def _save(figure: Any, name: str) -> None:
    figure.savefig(FOLDER / name, dpi=DPI)


def _drops(balls: dict[str, dict[str, Any]]) -> None:
    """What free fall, and what the last model, leaves of the heights of every ball."""
    columns = 3
    figure, panels = _figure(columns, -(-len(balls) // columns), (10, 1.9 * -(-len(balls) // columns)))
    for panel, (name, result) in zip(panels, balls.items(), strict=False):
        for number, flight in enumerate(result["flights"]):
            times, heights = np.array(flight["times"]), np.array(flight["measured"][1], float)
            for model, colour, label in zip(flight["models"], (GREY, BLUE), ("gravity alone", "found"), strict=False):
                shown = label if number == 0 else None
                panel.plot(times, heights - np.array(model[1], float), ".-", ms=3, lw=0.8, color=colour, label=shown)
        verdict = result["verdict"]
        found = " + ".join(verdict["effects"]) or {"nothing": "nothing missing"}.get(verdict["kind"], verdict["kind"])
        panel.set_title(f"{name.replace('_', ' ')}: {found}", fontsize=9)
    for panel in panels[::columns]:
        panel.set_ylabel("measured less model [m]")
    for panel in panels[-columns:]:
        panel.set_xlabel("time [s]")
    panels[0].legend(frameon=False, fontsize=8)
    _save(figure, "ball_drops.png")


def _throws(groups: dict[str, dict[str, Any]]) -> None:
    """Drag of every flight by itself, and the direction of its side force."""
    figure, (left, right) = _figure(2, 1, (10, 3.6))
    at = 0
    for name, result in groups.items():
        flights = [one for one in result["flights"] if "QuadraticDrag" in one["estimates"]]
        values, errors = np.array([one["estimates"]["QuadraticDrag"] for one in flights]).reshape(-1, 2).T
        places = at + np.arange(len(values))
        left.errorbar(places, values, errors, fmt="o", ms=3, lw=0.8, color=GREY)
        shared = next((p for p in result["rounds"][-1]["parameters"] if p["name"] == "drag_per_length"), None)
        if shared is not None:
            ends = [places[0], places[-1]]
            left.fill_between(ends, shared["low"], shared["high"], color=BLUE, alpha=0.4, lw=0)
            left.text(places[0], 0.36, f"{name[-1]}: {shared['value']:.3f}", color=BLUE, fontsize=8)
        at += len(values) + 2
    left.set(ylim=(-0.1, 0.4), xlabel="flight", ylabel="quadratic drag [1/m]", title="each flight; bands: the groups")
    sides = [one for result in groups.values() for one in result["flights"] if one.get("side")]
    clear = [one["side"]["size"] > CLEAR * one["side"]["error"] for one in sides]
    for kept, colour, label in ((True, RED, "more than twice its error"), (False, GREY, "less")):
        shown = _angles([one for one, other in zip(sides, clear, strict=True) if other is kept])
        right.plot(*shown, "o", ms=4, color=colour, label=label)
    right.set(xscale="log", ylim=(-5, 185), xlabel="measured |spin x velocity| [m/s²]")
    right.set(ylabel="angle [°]", title="side force found without the spin against spin x velocity")
    right.axhspan(0, ALIGNED, color=BLUE, alpha=0.1, lw=0)
    right.legend(frameon=False, fontsize=8, loc="upper right")
    _save(figure, "table_tennis.png")


def _angles(flights: Sequence[dict[str, Any]]) -> tuple[list[float], list[float]]:
    return [one["spin_times_velocity"] for one in flights], [one["side"]["angle"] for one in flights]
