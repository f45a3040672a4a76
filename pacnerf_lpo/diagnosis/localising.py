"""Where the residual exceeds the noise floor, by view, frame and phase of the motion."""

from collections.abc import Sequence

import numpy as np
import torch

from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.identification.problem import Part, Problem
from pacnerf_lpo.identification.silhouette_moments import KINDS
from pacnerf_lpo.mpm.effects.base import Effect

PHASES = ("free fall", "impact", "contact", "rebound")
REACH = 1.0
"""A particle within so many node spacings of the ground touches it."""


def phases(problem: Problem, effects: Sequence[Effect], comparison: Comparison) -> list[list[str]]:
    """Phase of the simulated motion in every frame of every recording.

    Free fall until the first contact; impact until the body is lowest; contact while it touches; rebound afterwards in
    the air.
    """
    models = [(part, part.model) for part in problem.parts(effects, comparison.known)]
    return [phases_of(part, model.path(model.start)) for part, model in models]


def phases_of(part: Part, path: torch.Tensor) -> list[str]:
    """Phase of a motion [m, (F, N, 3)] of a recording in every frame; a rigid body is in flight."""
    if not part.recording.deforms:
        return [PHASES[0]] * len(path)
    heights = path[..., 1].numpy() - part.known["ground_height"]
    touches = heights.min(1) < REACH * part.recording.spacing
    if not touches.any():
        return [PHASES[0]] * len(path)
    first, frames = int(np.argmax(touches)), np.arange(len(path))
    lowest = first + int(np.argmin(heights[first:].mean(1)))
    return np.select([frames < first, frames <= lowest, touches], PHASES[:3], PHASES[3]).tolist()


def floor(comparison: Comparison) -> tuple[np.ndarray, np.ndarray]:
    """Bias [pixels] and variance [pixels^2] of the residual under the model, from the replicates [(V, F, 11) each]."""
    bias = comparison.errors.replicates.mean(0)
    variance = comparison.errors.replicates.var(0, ddof=1) * (1 + 1 / len(comparison.errors.replicates))
    return bias, variance


def excess(residual: np.ndarray, comparison: Comparison) -> np.ndarray:
    """Mean square error of the outlines less the noise floor in every view and frame [pixels^2, (V, F)]; NaN where
    nothing was seen.
    """
    bias, variance = floor(comparison)
    return mean_of_outlines((residual - bias) ** 2 - variance)


def mean_excess(problem: Problem, residual: np.ndarray, comparison: Comparison) -> dict[str, float]:
    """:func:`excess` averaged over what was ``fitted`` and what was ``held`` out [pixels^2]; negative below floor."""
    square, split = excess(residual, comparison), problem.split
    return {name: float(np.nanmean(square[mask])) for name, mask in (("fitted", split.fitted), ("held", split.held))}


def mean_of_outlines(values: np.ndarray) -> np.ndarray:
    """Mean over the summaries of each outline [(V, F, 11)] that were seen [(V, F)]; NaN where none was."""
    return np.ma.masked_invalid(values[..., : len(KINDS)]).mean(-1).filled(np.nan)
