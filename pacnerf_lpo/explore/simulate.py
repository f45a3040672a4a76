"""One rollout of every recording, and how far it is from what was measured."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from pacnerf_lpo.diagnosis.localising import mean_of_outlines
from pacnerf_lpo.explore.records import Errors, Resolution
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.report.diagnosis_stages import root_mean_square


@dataclass(frozen=True, eq=False)
class Simulated:
    """A model of all recordings, rolled out.

    models: of each recording.
    paths: particles at every frame of each [m, (F, N, 3)]
    predicted: silhouette moments of all rows [(R, F, 11)]
    resolution: of the bodies.
    """

    models: tuple[Model, ...]
    paths: tuple[Tensor, ...]
    predicted: np.ndarray
    resolution: Resolution


def simulate(
    problem: Problem, effects: Sequence[Effect], values: dict[str, float], resolution: Resolution
) -> Simulated:
    """Roll a model out and look at it with all cameras. Raises SimulationError."""
    parts, coarse = problem.parts(effects, values), resolution == "coarse"
    models = tuple(p.recording.coarse_model(p.effects, p.known) if coarse else p.model for p in parts)
    paths = tuple(model.path(model.start) for model in models)
    predicted = [model.observe(path, model.start) for model, path in zip(models, paths, strict=True)]
    return Simulated(models, paths, problem.join(predicted), resolution)


def errors_of(problem: Problem, found: Simulated, floor: tuple[float, float] | None = None) -> Errors:
    """How far a rollout is from the measurements, see :class:`Errors`; the floor of both parts where it is known."""
    unit, factor = problem.unit
    table = np.sqrt(mean_of_outlines((factor * problem.residual(found.predicted)) ** 2))
    split = problem.split
    fitted, held = (np.where(mask, table, np.nan) for mask in (split.fitted, split.held))
    whole = [float(value) if np.isfinite(value := root_mean_square(part, (0, 1))) else None for part in (fitted, held)]
    parts = problem.parts((), {})
    rows = [(f"view {view}", part.name) for part in parts for view in part.recording.video.view_ids]
    rows += [(name, part.name) for part in parts for name in part.recording.point_names]
    return Errors(
        unit,
        tuple(f"{row} of {owner}" if len(parts) > 1 else row for row, owner in rows),
        problem.video.view_ids,
        tuple(owner for _, owner in rows),
        problem.video.times.numpy().astype(float),
        table,
        split.held,
        whole[0],
        whole[1],
        root_mean_square(fitted, (0,)),
        root_mean_square(held, (0,)),
        floor,
        found.resolution,
    )


def out_of_sight(problem: Problem, found: Simulated) -> float:
    """Share of the measured outlines and points of which the model shows nothing."""
    measured = problem.usable[..., :-1].any(-1)
    seen = np.isfinite(problem.residual(found.predicted)[..., :-1]).any(-1)
    return float((measured & ~seen).sum() / max(measured.sum(), 1))
