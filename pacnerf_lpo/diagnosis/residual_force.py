"""When no known effect explains the residual: which force field would, and which law does it look like?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from pacnerf_lpo.diagnosis.comparison import Comparison, noise_of_held_out
from pacnerf_lpo.diagnosis.localising import PHASES, phases_of
from pacnerf_lpo.diagnosis.statistics.acceptance import HeldOut, judge_held_out
from pacnerf_lpo.diagnosis.statistics.residual_force import Law, name_force
from pacnerf_lpo.diagnosis.statistics.score import Remainder
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import outcome
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import each
from pacnerf_lpo.mpm.differentiation import maximum
from pacnerf_lpo.mpm.effects.base import BodyForce
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.point import Point

KNOTS = 5
AXES = "xyz"
PARTS = ("1", *AXES)
"""Constant, and linear in the position in the body at frame 0."""
PROBE = 0.5  # m/s^2 at the rim of the body
SAMPLES = 200
RIDGES = np.logspace(-4, 4, 25)


def _names() -> list[str]:
    return [f"force_{axis}_{part}_{knot}" for knot in range(KNOTS) for part in PARTS for axis in AXES]


class SmoothForce(BodyForce):
    """A body acceleration that is piecewise linear in time and affine in the position in the body at frame 0: a_i(X, t)
    = sum_k hat_k(t) (a_ki + A_kij (X - X_c)_j / L), with evenly spaced knots k. Not a law of nature: a probe.

    Args:
        duration: of the video [s].
        centre: X_c [m, (3,)].
        extent: L [m].
    """

    parameters = {name: Parameter(name, "m/s^2", Identity(), (-1e4, 1e4), "force", scale=PROBE) for name in _names()}  # noqa: RUF012
    null = dict.fromkeys(parameters, 0.0)
    signature = "anything that a smooth force can do"
    probes = ()

    def __init__(self, duration: float, centre: tuple[float, float, float], extent: float):
        constants = {"force_interval": duration / (KNOTS - 1), "force_extent": extent}
        super().__init__(self.null, constants | {f"force_centre_{a}": x for a, x in zip(AXES, centre, strict=True)})

    @staticmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        named = vars(c)
        inside = [(x - named[f"force_centre_{a}"]) / c.force_extent for a, x in zip(AXES, point.X, strict=True)]
        total: list[Any] = [0.0, 0.0, 0.0]
        for knot in range(KNOTS):
            hat = _hat(point.t / c.force_interval - float(knot))
            for index, axis in enumerate(AXES):
                value = named[f"force_{axis}_1_{knot}"]
                for other, x in zip(AXES, inside, strict=True):
                    value = value + named[f"force_{axis}_{other}_{knot}"] * x
                total[index] = total[index] + hat * value
        return total


def _hat(offset: Any) -> Any:
    """Triangle of height 1 between -1 and 1."""
    return maximum(1.0 - maximum(offset, -offset), 0.0)


@dataclass(frozen=True)
class ResidualForce:
    """The force field that a comparison asks for.

    times: of the knots [s, (5,)]
    mean: acceleration of the whole body at the knots [m/s^2, (5, 3)]
    field: a constant and three slopes across the body at the knots [m/s^2, (5, 4, 3)]
    law: the terms it looks like.
    explained: share of the whitened residual in the fitted data that the field removes [0..1]
    held: what it does where nothing was fitted.
    """

    times: np.ndarray
    mean: np.ndarray
    field: np.ndarray
    law: Law
    explained: float
    held: HeldOut


def residual_force(problem: Problem, comparison: Comparison, progress: Callable[[str], None]) -> ResidualForce:
    """Find the smooth force that would remove the residual, and name it.

    One simulation for each of its 60 coefficients gives a linear system; it is solved with the ridge that generalised
    cross-validation chooses, beside the fitted parameters.

    Raises:
        SimulationError: the fitted motion is unstable.
    """
    body, video = problem.body, problem.video
    centre = body.positions.mean(0)
    extent = float((body.positions - centre).norm(dim=1).max())
    duration = float(video.times[-1] - video.times[0])
    effect = SmoothForce(duration, tuple(centre.tolist()), extent)
    mask = problem.fitted
    noise = comparison.noise(problem, mask)
    remainder = Remainder.of(noise, comparison.jacobian[mask])
    left = remainder.residual(np.nan_to_num(comparison.residual[mask]))
    model = problem.model([*comparison.effects, effect], comparison.known)
    base = problem.residual(model.predict(model.start))
    columns = []
    pushed = ((problem.model([*comparison.effects, effect], {**comparison.known, name: PROBE}),) for name in _names())
    for number, predicted in enumerate(each(outcome, pushed), 1):
        progress(f"residual force: {number} of {len(SmoothForce.parameters)}")
        if isinstance(predicted, SimulationError):
            columns.append(np.zeros_like(base))
        else:
            columns.append(np.nan_to_num((base - problem.residual(predicted)) / PROBE))
    changes = np.stack(columns, -1)
    design = remainder.change(changes[mask])
    solution = ridge(design, left)
    field = solution.reshape(KNOTS, len(PARTS), len(AXES))
    rest = left - design @ solution
    knots = np.linspace(0.0, duration, KNOTS)
    law = _name(problem, comparison, field, knots, centre.numpy(), extent)
    explained = 1 - float(rest @ rest) / float(left @ left)
    return ResidualForce(knots, field[:, 0], field, law, explained, _judged(problem, comparison, changes @ solution))


def _judged(problem: Problem, comparison: Comparison, removed: np.ndarray) -> HeldOut:
    """What a force does in the held-out views, in the frames that were fitted (later knots are not determined); in all
    held-out data where none is held out of those frames. The parameters move as the linear model says they must.

    Args:
        problem, comparison: the run and its fitted model.
        removed: of the residual, by the force [pixels, (V, F, 11)]
    """
    fitted, held = problem.fitted, problem.usable & problem.split.held[..., None]
    beside = held & problem.split.frames[:, None]
    mask = beside if beside.any() else held
    residual, jacobian = np.nan_to_num(comparison.residual), np.nan_to_num(comparison.jacobian)
    noise = comparison.noise(problem, fitted)
    left = noise.whiten_residual(residual[fitted] - removed[fitted])
    steps, *_ = np.linalg.lstsq(noise.whiten(jacobian[fitted]), left, rcond=1e-8)
    after = (residual - removed)[mask] - jacobian[mask] @ steps
    return judge_held_out(noise_of_held_out(problem, comparison, mask), residual[mask], after)


def ridge(design: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Ridge regression; the weight minimises generalised cross-validation (Golub, Heath and Wahba 1979).

    Args:
        design: (D, K)
        target: (D,)
    """
    left, strengths, right = np.linalg.svd(design, full_matrices=False)
    along = left.T @ target
    outside = float(target @ target - along @ along)
    best = None
    for weight in RIDGES * max(float(strengths.max()) ** 2, 1e-300) * 1e-4:
        kept = strengths**2 / (strengths**2 + weight)
        misfit = outside + float((((1 - kept) * along) ** 2).sum())
        score = misfit / max(len(target) - float(kept.sum()), 1e-9) ** 2
        if best is None or score < best[0]:
            best = score, right.T @ (kept * along / np.maximum(strengths, 1e-300))
    assert best is not None
    return best[1]


def _name(
    problem: Problem, comparison: Comparison, field: np.ndarray, knots: np.ndarray, centre: np.ndarray, extent: float
) -> Law:
    """Regress the field, sampled along the fitted motion, on a library of laws."""
    model = problem.model(comparison.effects, comparison.known)
    path = model.path(comparison.free)
    times = problem.video.times.numpy() - float(problem.video.times[0])
    chosen = np.random.default_rng(0).choice(path.shape[1], min(SAMPLES, path.shape[1]), replace=False)
    positions = path[:, torch.as_tensor(chosen)].numpy().astype(float)
    velocity = np.gradient(positions, times, axis=0)
    inside = (positions[0] - centre) / extent
    at_times = np.stack([[np.interp(times, knots, field[:, p, a]) for a in range(3)] for p in range(len(PARTS))])
    force = at_times[0].T[:, None] + np.einsum("jaf,nj->fna", at_times[1:], inside)
    touching = np.array(
        [phase != PHASES[0] for phase in phases_of(path, model.body.spacing, comparison.known["ground_height"])]
    )
    frames, samples = positions.shape[:2]
    return name_force(
        force.reshape(-1, 3),
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
