"""Which force field would explain a residual that no known effect explains, and which law it looks like."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from pacnerf_lpo.diagnosis.comparison import Comparison
from pacnerf_lpo.diagnosis.localising import PHASES, phases_of
from pacnerf_lpo.identification.problem import Part, Problem
from pacnerf_lpo.identification.smooth_force import AXES, KNOTS, SmoothForce, force_of, parts_on
from pacnerf_lpo.inference.force_law import Law, name_force
from pacnerf_lpo.mpm.effects.base import Effect

SAMPLES = 200


@dataclass(frozen=True)
class ResidualForce:
    """The smooth force that the residual asks for, in the recording where it is largest.

    times: of the knots [s since frame 0, (K,)]
    mean: acceleration of the whole body [m/s^2, (K, 3)]
    field: all coefficients [m/s^2, (K, 4, 3)]: constant, then, unless it is rigid, linear in each material coordinate
    law: what it looks like, in all recordings together.
    explained: share of the excess of the cost over the noise that it would remove.
    """

    times: np.ndarray
    mean: np.ndarray
    field: np.ndarray
    law: Law
    explained: float


def residual_force(
    problem: Problem, effects: Sequence[Effect], comparison: Comparison, deviation: float
) -> ResidualForce:
    """The posterior mean of the smooth force beside a fitted model, with a prior standard deviation of every
    coefficient [m/s^2], and what law it looks like.
    """
    mask, parts = comparison.fitted, problem.parts(effects, comparison.known)
    noise = comparison.marginal(problem, mask)
    left = noise.whiten_residual(comparison.residual[mask])
    design = noise.whiten(comparison.errors.force[mask]) * deviation
    solution = deviation * np.linalg.solve(design.T @ design + np.eye(design.shape[1]), design.T @ left)
    fields = solution.reshape(len(parts), KNOTS, len(parts_on(problem)), len(AXES))
    rest, size = left - design @ (solution / deviation), len(left)
    explained = float(left @ left - rest @ rest) / max(float(left @ left) - size, 1e-9)
    forces = [force_of(part.recording) for part in parts]
    knots = [np.linspace(0.0, force.constants["force_interval"] * (KNOTS - 1), KNOTS) for force in forces]
    samples = [_samples(*given) for given in zip(parts, fields, knots, forces, strict=True)]
    acceleration, velocity, position, spin, contact, blocks = map(np.concatenate, zip(*samples, strict=True))
    law = name_force(acceleration, velocity, position, spin, contact, blocks)
    shown = int(np.argmax((fields[:, :, 0] ** 2).sum((1, 2))))
    field = fields[shown]
    return ResidualForce(knots[shown], field[:, 0], field, law, float(np.clip(explained, 0.0, 1.0)))


def _samples(part: Part, field: np.ndarray, knots: np.ndarray, force: SmoothForce) -> tuple[np.ndarray, ...]:
    """The field along the fitted motion of a recording, as :func:`name_force` regresses it on a library of laws."""
    problem, model = part.recording, part.model
    path = model.path(model.start)
    centre = np.array([force.constants[f"force_centre_{axis}"] for axis in AXES])
    extent = force.constants["force_extent"]
    times = problem.video.times.numpy() - float(problem.video.times[0])
    chosen = np.random.default_rng(0).choice(path.shape[1], min(SAMPLES, path.shape[1]), replace=False)
    positions = path[:, torch.as_tensor(chosen)].numpy().astype(float)
    velocity = np.gradient(positions, times, axis=0)
    inside = (positions[0] - centre) / extent
    at_times = np.stack([[np.interp(times, knots, field[:, p, a]) for a in range(3)] for p in range(field.shape[1])])
    acceleration = at_times[0].T[:, None] + np.einsum("jaf,nj->fna", at_times[1:], inside[:, : len(at_times) - 1])
    touching = np.array([phase != PHASES[0] for phase in phases_of(part, path)])
    frames, samples = positions.shape[:2]
    return (
        acceleration.reshape(-1, 3),
        velocity.reshape(-1, 3),
        positions.reshape(-1, 3),
        np.repeat(_spin(positions, velocity), samples, axis=0),
        np.repeat(touching, samples),
        np.repeat(np.arange(frames), samples),
    )


def _spin(positions: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Angular velocity of point sets of equal masses [rad/s, (F, 3)], by their angular momentum."""
    relative = positions - positions.mean(1, keepdims=True)
    momentum = np.cross(relative, velocity - velocity.mean(1, keepdims=True)).sum(1)
    square = (relative**2).sum((1, 2))
    inertia = square[:, None, None] * np.eye(3) - np.einsum("fni,fnj->fij", relative, relative)
    return np.linalg.solve(inertia, momentum[..., None])[..., 0]
