"""What the residual does where body, resolution or opacity are wrong: directions of the noise, in addition to what
replicates show.

A few replicates show the size of such errors, but hardly any of their directions. So each of some smooth errors of the
shape and of the density is tried once, by as much as it may be wrong.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations_with_replacement

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.forward_model import Model, outcome
from pacnerf_lpo.identification.problem import Part, Problem, StateProblem
from pacnerf_lpo.identification.processes import Progress, each
from pacnerf_lpo.identification.replicates import bumps, distortion

DENSITY_ERROR = 0.05
"""Of the density of the reconstructed body, from place to place."""
OPAQUE = 3.3
"""Optical depth of opaque particles relative to the model's: with it one layer of them covers nine tenths, not half."""
LOCAL = 2.0
"""Size of an error in one place relative to one that is everywhere."""


def shape_errors(problem: Problem, model: Model, free: np.ndarray, progress: Progress = lambda _: None) -> np.ndarray:
    """Changes of the residual [pixels, (V, F, 11, M)] by errors of the body, each of one standard deviation, by one
    simulation of the coarse body each; where its shape is known, errors of the measurement. An error with which the
    motion is unstable is left out.

    Args:
        problem: the run.
        model: whose body may be wrong.
        free: coordinates at which it was fitted [(K,)]
        progress: receives a line about each step.

    Raises:
        SimulationError: the motion is unstable with every one of them.
    """
    reference = model.predict(free)
    parts = problem.parts(model.effects, model.physical(free))
    found = [_of_recording(part, problem.part_of(reference, n), progress) for n, part in enumerate(parts)]
    return of_each(problem, found)


def discretisation_errors(problem: Problem, model: Model, free: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Changes of the residual of each recording [(R, F, 11, 3 or 2 for each)] when its body is coarser, and, where
    cameras show it, when its particles are opaque, and the bias of a wrong shape; none of a body that is rigid.

    The error of a method of order p at node spacing h is C h^p, and the step to 1.4 h changes it by (1.4^p - 1) C h^p:
    the whole error for p = 2, two fifths of it for p = 1. Replicates, with 0.6 h to 0.9 h, show a quarter and more.

    A surface is half transparent in the model, and where it is does not matter while the body is thick, as residuals
    are relative to frame 0. A sheet or a spray thinner than the spacing is opaque in a matte, and hardly there in the
    model.

    Args:
        problem, model, free: as for :func:`shape_errors`.
        bias: what a wrong shape changes on average, from :func:`~.replicates.replicates` [(R, F, 11)]

    Raises:
        SimulationError: the motion of the coarse body is unstable.
    """
    reference, changes = model.predict(free), []
    for number, part in enumerate(problem.parts(model.effects, model.physical(free))):
        if not part.recording.deforms:
            changes.append(np.zeros((*part.recording.usable.shape, 0)))
            continue
        others = [part.recording.coarse_model(part.effects, part.known)]
        if part.recording.views:
            others.append(part.model)
            others[-1].opacity = OPAQUE
        own = problem.part_of(reference, number)
        seen = [part.recording.relative(other.predict(other.start) - own) for other in others]
        changes.append(np.stack([*seen, problem.part_of(bias, number)], axis=-1))
    return of_each(problem, changes)


def of_each(problem: Problem, changes: Sequence[np.ndarray]) -> np.ndarray:
    """Changes of the residual of every recording, each by causes of its own [(R', F', 11, M') each], as changes of the
    whole residual by all of them [(R, F, 11, M)].
    """
    columns = []
    for number, own in enumerate(changes):
        others = [np.zeros((*other.shape[:3], own.shape[3])) for other in changes]
        columns.append(problem.join([*others[:number], own, *others[number + 1 :]]))
    return np.concatenate(columns, axis=-1)


def _of_recording(part: Part, reference: np.ndarray, progress: Progress) -> np.ndarray:
    problem = part.recording
    if not isinstance(problem, StateProblem):
        return problem.measuring_errors
    right = problem.coarse_model(part.effects, part.known)
    base = right.predict(right.start)
    bodies = [body for body in wrong_bodies(problem, distortion(problem, reference)) if len(body.positions)]
    seen: list[np.ndarray | SimulationError] = []
    for found in each(outcome, ((problem.model(part.effects, part.known, body),) for body in bodies)):
        seen.append(found)
        progress(f"wrong shapes of {problem.scene}: {len(seen)} of {len(bodies)}")
    changes = [problem.relative(found - base) for found in seen if not isinstance(found, SimulationError)]
    if not changes:
        raise next(found for found in seen if isinstance(found, SimulationError))
    return np.stack(changes, axis=-1)


def wrong_bodies(problem: StateProblem, sigma: float) -> Iterator[Body]:
    """The coarse body of a problem with one smooth error each: displacements of first and second order that are
    together about ``sigma`` [m], surfaces moved inwards by about as much, places moved by more, and a density that is
    higher here than there.
    """
    body = problem.coarse_body
    linear, quadratic = polynomials(body.positions, body.positions)
    axes = torch.eye(3, dtype=body.positions.dtype)
    strains = [linear[i][:, None] * axes[j] + linear[j][:, None] * axes[i] for i in range(3) for j in range(i, 3)]
    bends = [field[:, None] * axis for field in quadratic for axis in axes]
    displacements = strains + bends
    for displacement in displacements:
        size = displacement.square().sum(1).mean().sqrt() * len(displacements) ** 0.5
        yield Body(body.positions + displacement * (sigma / size), body.fraction, body.spacing)
    yield problem.thinned(lambda points: sigma + 0 * points[:, 0])
    for order, fields in enumerate((linear, quadratic)):
        for number in range(len(fields)):

            def offset(points: Tensor, order: int = order, number: int = number) -> Tensor:
                return sigma * polynomials(points, body.positions)[order][number]

            yield problem.thinned(offset)
    for bump in bumps(body, body.positions):
        for axis in axes:
            yield Body(body.positions + LOCAL * sigma * bump[:, None] * axis, body.fraction, body.spacing)
    for lean in (*linear, torch.stack(quadratic[:3]).sum(0)):
        fraction = body.fraction * (1 + DENSITY_ERROR * lean).clamp_min(0.1)
        yield Body(body.positions, fraction, body.spacing)


def polynomials(points: Tensor, body: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Coordinates, and their squares followed by their products, with mean 0 and mean square 1 in a body.

    Args:
        points: where to evaluate them [m, (N, 3)]
        body: positions of its particles [m, (P, 3)]

    Returns:
        Three fields of first order, and six of second, (N,) each.
    """

    def normalised(field: Tensor, inside: Tensor) -> Tensor:
        return (field - inside.mean()) / inside.std(correction=0).clamp_min(1e-9)

    linear = [normalised(points[:, axis], body[:, axis]) for axis in range(3)]
    inside = [normalised(body[:, axis], body[:, axis]) for axis in range(3)]
    pairs = sorted(combinations_with_replacement(range(3), 2), key=lambda pair: pair[0] != pair[1])
    return linear, [normalised(linear[i] * linear[j], inside[i] * inside[j]) for i, j in pairs]
