"""Measured flights on the page of a diagnosis: positions over time, the model before and after, and what each flight by
itself says of the effects that were found.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis.contributions import estimates, steady_forces
from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.rigid import RigidProblem
from pacnerf_lpo.report.diagnosis_stages import Stage
from pacnerf_lpo.report.page import parts, plain
from pacnerf_lpo.report.wording import readable

MAGNUS = "Magnus"
LARGE = 0.5
"""Spin x velocity is large where it reaches this part of the median of all flights: a spin that was measured wrong can
be far larger than any other."""
CLEAR = 2.0
"""A side force is clear from so many times its error on."""
ALIGNED = 45.0
"""Two directions agree within this angle [degrees]."""


def flights(problem: Problem, shown: Sequence[Stage], rounds: Sequence[Round]) -> list[dict[str, Any]]:
    """Of every flight: name, times [s], measured positions [m, 3 x F], those of the model before and after all that was
    found, the mean spin x velocity [m/s^2 per unit of the Magnus coefficient], and for every effect that was found with
    one coefficient what this flight says of it. Where a force by spin was found, ``side``: see :func:`side_force`.
    """
    found = []
    stages = [shown[0], shown[-1]] if len(shown) > 1 else [shown[0]]
    parts = [problem.parts(stage.effects, stage.known) for stage in stages]
    own = estimates(problem, rounds)
    turning = next((effect for effect in rounds[-1].effects if type(effect).__name__ == MAGNUS), None)
    forces = [] if turning is None or problem.deforms else steady_forces(problem, rounds[-1], turning)
    for number, part in enumerate(parts[0]):
        recording = part.recording
        if not isinstance(recording, RigidProblem):
            return []
        flight = recording.flight
        paths = [recording_parts[number].model for recording_parts in parts]
        centres = [model.path(model.start).mean(1).numpy() for model in paths]
        velocity = np.gradient(centres[-1], flight.times, axis=0)
        turned = np.cross(flight.spin or (0.0, 0.0, 0.0), velocity)
        means = velocity.mean(0), turned.mean(0)
        found.append(
            {
                "name": part.name,
                "times": np.round(flight.times, 5).tolist(),
                "measured": plain(flight.positions.T),
                "models": [plain(centre.T) for centre in centres],
                "spin": None if flight.spin is None else list(flight.spin),
                "spin_times_velocity": float(np.linalg.norm(turned, axis=1).mean()),
                "side": side_force(*forces[number], *means) if forces and flight.spin else None,
                "estimates": {name: list(of_all[number]) for name, of_all in own.items()},
            }
        )
    return found


def side_force(force: np.ndarray, covariance: np.ndarray, velocity: np.ndarray, turned: np.ndarray) -> dict[str, float]:
    """The steady force across a flight, found without its spin, and where it points: ``size`` of the acceleration
    across the mean velocity [m/s^2], standard ``error`` of a component of it, and ``angle`` between it and the measured
    spin x velocity [degrees].

    Args:
        force, covariance: acceleration [m/s^2, (3,)] with its covariance.
        velocity, turned: mean velocity, and mean spin x velocity.
    """
    along = velocity / np.linalg.norm(velocity)
    across = np.eye(3) - np.outer(along, along)
    side, size = across @ force, float(np.linalg.norm(across @ force))
    cosine = side @ turned / max(size * float(np.linalg.norm(turned)), 1e-12)
    error = float(np.sqrt(np.trace(across @ covariance @ across) / 2))
    angle = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return {"size": round(size, 3), "error": round(error, 3), "angle": round(angle, 1)}


def agreement(flights: Sequence[Mapping[str, Any]]) -> str | None:
    """In how many flights the side force has the direction of the measured spin x velocity, in words; None where no
    such force was found by spins that were measured.
    """
    measured = [one for one in flights if one["side"] is not None]
    if not measured:
        return None
    typical = float(np.median([one["spin_times_velocity"] for one in measured]))
    large = [one for one in measured if one["spin_times_velocity"] >= LARGE * typical]
    clear = [one for one in large if one["side"]["size"] > CLEAR * one["side"]["error"]]
    with_it = sum(one["side"]["angle"] < ALIGNED for one in clear)
    against = sum(one["side"]["angle"] > 180 - ALIGNED for one in clear)
    least = min(one["spin_times_velocity"] for one in large)
    return (
        f"Direction of the force by spin: spin x velocity is large, at least {least:.0f} m/s², in {len(large)} of "
        f"{len(measured)} flights. In {len(clear)} of them a steady side force, found without the spin, is more than "
        f"twice its error; it points along spin x velocity, within {ALIGNED:.0f}°, in {with_it}, against it in "
        f"{against} (as where a spin was measured with the wrong sense), elsewhere in {len(clear) - with_it - against}."
    )


def flights_section(result: Mapping[str, Any]) -> str:
    """Plots, which the page's script draws, and a table of what each flight says; nothing where there was a video."""
    found = result.get("flights") or []
    if not found:
        return ""
    columns = {"flight": [one["name"] for one in found], "samples": [len(one["times"]) for one in found]}
    names, sides = list(found[0]["estimates"]), [one["side"] for one in found]
    for name in names:
        own = (one["estimates"][name] for one in found)
        columns[f"{readable(name)}, this flight alone"] = [f"{value:.3g} ± {error:.2g}" for value, error in own]
    if any(one["spin"] for one in found):
        columns["mean |spin x velocity| [m/s²]"] = [f"{one['spin_times_velocity']:.0f}" for one in found]
    if any(sides):
        sizes = [f"{side['size']:.2g} ± {side['error']:.2g}" if side else "" for side in sides]
        columns["side force found without the spin [m/s²]"] = sizes
        columns["its angle to spin x velocity"] = [f"{side['angle']:.0f}°" if side else "" for side in sides]
    rows = [*zip(*columns.values(), strict=True)] if names else []
    return parts("diagnosis").flights(found, list(columns), rows, agreement(found))
