"""Measured flights on the page of a diagnosis: positions over time, the model before and after, and what each flight by
itself says of the effects that were found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis.contributions import estimates
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.rigid import RigidProblem
from pacnerf_lpo.report.diagnosis_markup import table, text
from pacnerf_lpo.report.diagnosis_stages import Stage
from pacnerf_lpo.report.wording import readable

LARGE = 0.5
"""A side force is large where spin x speed reaches this part of the largest of all flights."""


def flights(problem: Problem, shown: Sequence[Stage], rounds: Sequence[Round]) -> list[dict[str, Any]]:
    """Of every flight: name, times [s], measured positions [m, 3 x F], those of the model before and after all that was
    found, the largest spin x velocity [m/s^2 per unit of the Magnus coefficient], and for every effect that was found
    with one coefficient what this flight says of it.
    """
    found = []
    stages = [shown[0], shown[-1]] if len(shown) > 1 else [shown[0]]
    parts = [problem.parts(stage.effects, stage.known) for stage in stages]
    own = estimates(problem, rounds)
    for number, part in enumerate(parts[0]):
        recording = part.recording
        if not isinstance(recording, RigidProblem):
            return []
        flight = recording.flight
        paths = [recording_parts[number].model for recording_parts in parts]
        centres = [model.path(model.start).mean(1).numpy() for model in paths]
        velocity = np.gradient(centres[-1], flight.times, axis=0)
        side = 0.0 if flight.spin is None else float(np.linalg.norm(np.cross(flight.spin, velocity), axis=1).mean())
        found.append(
            {
                "name": part.name,
                "times": np.round(flight.times, 5).tolist(),
                "measured": _columns(flight.positions),
                "models": [_columns(centre) for centre in centres],
                "spin": None if flight.spin is None else list(flight.spin),
                "spin_times_velocity": side,
                "estimates": {name: list(of_all[number]) for name, of_all in own.items()},
            }
        )
    return found


def _columns(positions: np.ndarray) -> list[list[float | None]]:
    """Coordinates [m, 3 x F], None where there is none."""
    return [[round(float(x), 5) if np.isfinite(x) else None for x in column] for column in positions.T]


def agreement(flights: Sequence[Mapping[str, Any]]) -> str | None:
    """In how many flights the side force has the direction of the measured spin x velocity, in words; None where no
    such force was found by a spin that was measured.
    """
    told = [(f["spin_times_velocity"], *f["estimates"]["Magnus"]) for f in flights if "Magnus" in f["estimates"]]
    most = max((side for side, _, _ in told), default=0.0)
    if most == 0.0:
        return None
    large = [(value, error) for side, value, error in told if side >= LARGE * most]
    along = sum(value > 0 for value, _ in large)
    clear = [value > 0 for value, error in large if abs(value) > 2 * error]
    flights_of = "flight" if len(large) == 1 else f"{len(large)} flights"
    return (
        f"Spin times velocity is large in {flights_of}, at least {LARGE * most:.0f} m/s²; each by itself, the side "
        f"force points along it in {along}, and in {sum(clear)} of the {len(clear)} in which it is at least twice its "
        "error."
    )


def flights_section(result: Mapping[str, Any]) -> str:
    """Plots, which the page's script draws, and a table of what each flight says; nothing where there was a video."""
    found = result.get("flights") or []
    if not found:
        return ""
    names = list(found[0]["estimates"])
    head = ["flight", "samples", *(f"{text(readable(name))}, this flight alone" for name in names)]
    spinning = any(one["spin"] for one in found)
    head += ["mean |spin x velocity| [m/s²]"] if spinning else []
    rows = []
    for one in found:
        cells = [text(one["name"]), str(len(one["times"]))]
        cells += [f"{value:.3g} ± {error:.2g}" for value, error in one["estimates"].values()]
        cells += [f"{one['spin_times_velocity']:.0f}"] if spinning else []
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    said = agreement(found)
    note = f'<p class="note">{text(said)}</p>' if said else ""
    options = "".join(f'<option value="{k}">{text(one["name"])}</option>' for k, one in enumerate(found))
    each = f'<div class="card scroll">{table(head, rows)}{note}</div>' if names else ""
    controls = f'<div class="controls"><label>flight <select id="flight">{options}</select></label></div>'
    return (
        f'<section id="flights"><h2>See it</h2>{controls}<div class="pair" id="flight-charts"></div>'
        f'<div class="legend" id="flight-legend"></div>{each}</section>'
    )
