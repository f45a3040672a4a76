"""A smooth force on the body that no law gives: the discrepancy of every model, and what an unknown effect does."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from pacnerf_lpo.identification.base_fit import TOUCH
from pacnerf_lpo.identification.forward_model import outcome
from pacnerf_lpo.identification.problem import Part, Problem
from pacnerf_lpo.identification.processes import Progress, each
from pacnerf_lpo.identification.shape_errors import of_each
from pacnerf_lpo.mpm.differentiation import maximum
from pacnerf_lpo.mpm.effects.base import BodyForce, Effect
from pacnerf_lpo.mpm.parameters import Identity, Parameter
from pacnerf_lpo.mpm.point import Point

KNOTS = 5
AXES = "xyz"
PARTS = ("1", *AXES)
"""Constant, and linear in the position in the body at frame 0."""
PROBE = 0.5  # m/s^2 at the rim of the body


def names_of_force(parts: Sequence[str] = PARTS) -> list[str]:
    return [f"force_{axis}_{part}_{knot}" for knot in range(KNOTS) for part in parts for axis in AXES]


def parts_on(problem: Problem) -> Sequence[str]:
    """What moves the body of a problem: all of a force where it deforms, the constant part where it is rigid."""
    return PARTS if problem.deforms else PARTS[:1]


class SmoothForce(BodyForce):
    """A body acceleration that is piecewise linear in time and affine in the position in the body at frame 0: a_i(X, t)
    = sum_k hat_k(t) (a_ki + A_kij (X - X_c)_j / L), with evenly spaced knots k. Not a law of nature: a probe.

    Args:
        duration: of the video [s].
        centre: X_c [m, (3,)].
        extent: L [m].
    """

    parameters = {  # noqa: RUF012
        name: Parameter(name, "m/s^2", Identity(), (-1e4, 1e4), "force", scale=PROBE) for name in names_of_force()
    }
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
            hat = maximum(1.0 - abs(point.t / c.force_interval - float(knot)), 0.0)
            if isinstance(hat, float) and hat == 0.0:
                continue
            for index, axis in enumerate(AXES):
                value = named[f"force_{axis}_1_{knot}"]
                for other, x in zip(AXES, inside, strict=True):
                    value = value + named[f"force_{axis}_{other}_{knot}"] * x
                total[index] = total[index] + hat * value
        return total


def force_of(problem: Problem) -> SmoothForce:
    """The smooth force on the body of a problem."""
    positions, times = problem.body.positions, problem.video.times
    centre = positions.mean(0)
    extent = float((positions - centre).norm(dim=1).max())
    return SmoothForce(float(times[-1] - times[0]), tuple(centre.tolist()), extent)


def force_changes(
    problem: Problem, effects: Sequence[Effect], known: dict[str, float], progress: Progress
) -> np.ndarray:
    """Changes of the residual per m/s^2 of every coefficient of a smooth force [pixels s^2/m, (R, F, 11, 60)], by one
    simulation of a coarser body each, 60 for each recording of a body that deforms and 15 of a rigid one; zero
    where that is unstable. ``known``: every value of the model [SI]. Raises SimulationError where the motion without
    the force is unstable.
    """
    return of_each(problem, [_of_recording(part, progress) for part in problem.parts(effects, known)])


def _of_recording(part: Part, progress: Progress) -> np.ndarray:
    problem = part.recording
    models = [*part.effects, force_of(problem)]
    still = problem.coarse_model(models, part.known)
    base = problem.residual(still.predict(still.start))
    names = names_of_force(parts_on(problem))
    pushed = ((problem.coarse_model(models, {**part.known, name: PROBE}),) for name in names)
    columns: list[np.ndarray] = []
    for number, predicted in enumerate(each(outcome, pushed), 1):
        if number % len(PARTS) == 0:
            progress(f"smooth force on {problem.scene}: {number} of {len(names)}")
        change = base - problem.residual(predicted) if isinstance(predicted, np.ndarray) else 0 * base
        columns.append(change / PROBE)
    return np.nan_to_num(np.stack(columns, -1))


def contact_accelerations(problem: Problem, effects: Sequence[Effect], known: dict[str, float]) -> np.ndarray:
    """Acceleration of the body by more than gravity, from its first contact on, around the knot of every coefficient of
    a smooth force: root mean square over particles and frames [m/s^2, (60,) for each recording, (15,) of a rigid body,
    which touches nothing]. Arguments and errors as of :func:`force_changes`; two simulations each.
    """
    return np.concatenate([_contact_accelerations(part) for part in problem.parts(effects, known)])


def _contact_accelerations(part: Part) -> np.ndarray:
    count = len(names_of_force(parts_on(part.recording)))
    if not part.recording.deforms:
        return np.zeros(count)
    model, physics = part.recording.coarse_model(part.effects, part.known), part.recording.physics
    path = model.path(model.start).double()
    squares = np.zeros(len(path))
    gravity = torch.tensor(physics.gravity, dtype=path.dtype)
    beyond = path.diff(dim=0).diff(dim=0) * physics.frame_rate**2 - gravity
    squares[1:-1] = beyond.square().sum(-1).mean(-1).numpy()
    squares[: max(model.contact(model.start, TOUCH) - 1, 0)] = 0.0
    knots = np.linspace(0, len(path) - 1, KNOTS)
    hats = np.maximum(1 - np.abs(np.arange(len(path))[:, None] - knots) / (knots[1] - knots[0]), 0.0)
    around = np.sqrt(squares @ hats / np.maximum(hats.sum(0), 1.0))  # knots may lie closer than frames
    return np.repeat(around, count // KNOTS)
