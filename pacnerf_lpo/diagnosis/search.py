"""A look at the whole parameter space on a coarse body, before any local fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import torch
from scipy.stats import qmc

from pacnerf_lpo.diagnosis.fitting import Residual, fit
from pacnerf_lpo.diagnosis.model import Model
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.mpm.parameters import Parameter

LOCAL_ITERATIONS = 5
HALVINGS = 1
"""Of the time step: what needs a finer one is not worth its time here."""


def span(parameter: Parameter, start: float, decades: float) -> tuple[float, float] | None:
    """Free coordinates between which a parameter is searched; None where there is nothing to search.

    Args:
        parameter: what is searched.
        start: free coordinate of the guess.
        decades: log10 parameters, to either side.
    """
    low, high = parameter.bounds
    lattice = [
        point
        for point in parameter.transform.lattice(start, decades)
        if low < float(parameter.transform.to_physical(torch.tensor(point, dtype=torch.float64))) < high
    ]
    return (min(lattice), max(lattice)) if len(lattice) > 1 else None


def points(model: Model, spans: Mapping[str, tuple[float, float]], samples: int) -> list[np.ndarray]:
    """The guess, then quasi-random points within the spans, everything else as at the guess [(K,) each]."""
    found = [model.start.copy()]
    if spans:
        for sample in qmc.Sobol(len(spans), seed=0).random(samples):
            point = model.start.copy()
            for (name, (low, high)), share in zip(spans.items(), sample, strict=True):
                point[model.names.index(name)] = low + share * (high - low)
            found.append(point)
    return found


def promising(model: Model, residual: Residual, tried: Iterable[np.ndarray], starts: int) -> list[np.ndarray]:
    """The best few points, and where a short local fit leads from each; none if the motion is unstable at all of them.

    Args:
        model: of a coarse body.
        residual: of its free coordinates.
        tried: points to try [(K,) each]
        starts: how many of the best are improved.
    """
    model.physics.most_halvings = HALVINGS
    losses: list[tuple[float, int, np.ndarray]] = []
    for point in tried:
        model.physics.halvings = 0
        try:
            losses.append((float(np.sum(residual(point) ** 2)), len(losses), point))
        except SimulationError:
            continue
    best = [point for _, _, point in sorted(losses, key=lambda entry: entry[:2])[:starts]]
    for point in list(best):
        try:
            best.append(fit(residual, point, model.scales, model.bounds, LOCAL_ITERATIONS).free)
        except SimulationError:
            continue
    return best
