"""Null replicates: residuals that the fitted model would have if it were true, from other discretisations of it."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.forward_model import Model, with_effects
from pacnerf_lpo.identification.problem import Part, Problem, beside_median
from pacnerf_lpo.identification.processes import Progress, each
from pacnerf_lpo.identification.shape_modes import PLACES, bumps
from pacnerf_lpo.identification.silhouette_moments import KINDS
from pacnerf_lpo.inference.sensor import sensor_scale

FINENESS = (0.6, 0.9)
"""Replicates move on grids that are finer than the model's by factors from this range, which is wide, so that they
differ by what the resolution does: the error of the finest is 0.36 of the model's if it is of second order.
"""
STEPS = (1.0, 1.4)
"""They take more steps than their grid needs, as other solvers do: each step dissipates a little."""
DENSITY_ERROR = 0.1
"""Of the reconstructed body, from the centre to the rim."""
TRIALS = 4
SEEDS = 101
"""Recordings of one study have seeds that are so far apart."""
MEDIAN_OF_CHI2 = 0.4549
SINGLE_CAMERAS = 0.2
"""Of all views, may be wrong."""


def replicates(
    problem: Problem,
    model: Model,
    free: np.ndarray,
    count: int,
    seed: int,
    progress: Progress = lambda _: None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals [(T, R, F, 11)] of data simulated from the model itself, every recording by itself, the standard
    deviation of the sensor noise in them, and what a wrong shape changes on average [(R, F, 11) each].

    Each replicate has a finer grid, smaller time steps and particles at random places, a shape distorted smoothly by as
    much as the outlines at frame 0 disagree, and fresh sensor noise. On average a distortion changes something, too:
    the lowest point of a rougher body is lower. A reconstruction may be rougher than the body or smoother, so this
    mean, found by as many distortions of the model's own body, opposite ones in turn, is taken from the residuals, and
    returned: its size is known, its sign is not. How noisy the outlines of a recording are is measured where the
    replicates agree.

    Args:
        model, free: reference prediction, and coordinates at which it was fitted [(K,)]
        count: T.
        seed: of all random choices.

    Raises:
        SimulationError: a finer motion is unstable.
    """
    parts, reference = problem.parts(model.effects, model.physical(free)), model.predict(free)
    found = []
    for number, part in enumerate(parts):
        found.append(_of_recording(part, problem.part_of(reference, number), count, seed + SEEDS * number, progress))
    residuals, sensors, biases = zip(*found, strict=True)
    return problem.join(residuals, axis=1), problem.join(sensors), problem.join(biases)


def _of_recording(
    part: Part, reference: np.ndarray, count: int, seed: int, progress: Progress
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    problem = part.recording
    sigma = distortion(problem, reference)
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    attempts = range(count)
    while attempts:
        draws = [np.random.default_rng((seed, attempt)) for attempt in attempts]
        pairs = []
        for attempt, random in zip(attempts, draws, strict=True):
            body = problem.sample(problem.spacing * random.uniform(*FINENESS), seed=1000 * seed + attempt + 1)
            true = problem.model(part.effects, part.known, shaken(distorted(body, sigma, random), random))
            true.physics = with_effects(true.physics, true.physics.effects, 1 / random.uniform(*STEPS), 1.0)
            # one way and then the opposite one, so that the mean is what is of second order
            alike, sign = np.random.default_rng((seed, count, attempt // 2)), (-1) ** attempt
            wrong = distorted(problem.body, sign * sigma, alike)
            pairs.append((true, problem.model(part.effects, part.known, wrong)))
        for random, seen in zip(draws, each(_predicted, pairs), strict=True):
            if isinstance(seen, SimulationError):
                unstable = seen
                continue
            found.append((*seen, problem.drawn_noise(random), problem.lasting_noise(random)))
            progress(f"replicate {len(found)} of {count}")
        attempts = range(attempts.stop, attempts.stop + count - len(found))
        if attempts and attempts.start > 2 * count:
            raise unstable
    true_seen, wrong_seen, noise, slow = (np.stack(part) for part in zip(*found, strict=True))
    bias = np.nan_to_num(problem.relative(wrong_seen - reference)).mean(0)
    errors, scale = problem.relative(true_seen - reference) - bias, np.ones_like(problem.sensor)
    outlines = np.s_[..., : problem.views, :, : len(KINDS)]
    if problem.views:
        root = problem.noise[: problem.views, :, : len(KINDS), : len(KINDS)]
        scale[outlines] = sensor_scale(problem.residual(reference)[outlines], errors[outlines], root)
    return errors + problem.relative(scale * noise + slow), scale * problem.sensor, bias


def _predicted(true: Model, wrong: Model) -> tuple[np.ndarray, np.ndarray] | SimulationError:
    """What both predict at their start [(V + R, F, 11) each], or what went wrong with either."""
    try:
        return true.predict(true.start), wrong.predict(wrong.start)
    except SimulationError as error:
        return error


def distortion(problem: Problem, reference: np.ndarray) -> float:
    """How far the reconstructed surface may be from the true one [m]: as far as makes the outlines of distorted bodies
    disagree at frame 0 as much as the measured ones do, but for single cameras; at least what the problem says.

    Where no camera shows the body, that is all. ``reference``: summaries that the model predicts [(V, F, 11)].
    """
    least = problem.least_shape_error
    if not problem.views or not np.isfinite(problem.measured[: problem.views, 0]).any():
        return least
    random = np.random.default_rng(0)
    shapes = np.stack([problem.at_rest(distorted(problem.body, 2 * least, random)) for _ in range(TRIALS)])
    views = slice(problem.views)
    sensor = problem.sensor[views, 0, :-1]
    caused = _typical_squares(beside_median(shapes - reference[views, 0, :-1]) / sensor)
    differences = problem.relative(problem.measured - reference)[views, 0, :-1]
    measured = _typical_squares(differences / sensor) - 1
    return max(least, 2 * least * float(np.sqrt((measured / caused).clip(min=0.0).max())))


def _typical_squares(values: np.ndarray) -> np.ndarray:
    """Variance of deviates [(..., V, K)] in which single cameras that are wrong do not count: by their median square,
    and by the mean of all but the worst fifth of the views, as a shape that few cameras have seen is wrong in some
    directions only [(2,)].
    """
    squares = np.moveaxis(values**2, -2, 0).reshape(values.shape[-2], -1)
    squares = squares[np.isfinite(squares).any(axis=1)]
    of_views = np.sort(np.nanmean(squares, axis=1))
    kept = max(1, len(of_views) - max(1, round(SINGLE_CAMERAS * len(of_views))))
    return np.array([np.nanmedian(squares) / MEDIAN_OF_CHI2, of_views[:kept].mean()])


def distorted(body: Body, sigma: float, random: np.random.Generator, reference: Body | None = None) -> Body:
    """The body with its surface moved by about ``sigma`` [m], by an affine part and by places that move on their own,
    and with a matter that is denser on one side than on the other.

    Args:
        body: to distort.
        sigma: root mean square of the displacement.
        random: of the distortion.
        reference: another sampling of the body, whose particles say where its places are; None: the body. With the
            same reference and random numbers, all samplings are distorted alike.
    """
    reference = body if reference is None else reference
    centre = reference.positions.mean(0)
    extent = float((reference.positions.amax(0) - reference.positions.amin(0)).norm()) / 2
    dtype, count = body.positions.dtype, min(PLACES, len(reference.positions))
    drawn = (random.standard_normal(shape) for shape in ((3, 3), (count, 3), (3,)))
    strain, moves, lean = (torch.tensor(numbers, dtype=dtype) for numbers in drawn)

    def field(positions: Tensor) -> Tensor:
        return (positions - centre) / extent @ (strain + strain.T) / 2 + bumps(reference, positions).T @ moves

    there = field(reference.positions)
    size = (there - there.mean(0)).square().sum(1).mean().sqrt().clamp_min(1e-9)
    moved = (field(body.positions) - there.mean(0)) * (sigma / size)
    denser = 1 + DENSITY_ERROR * ((body.positions - centre) / extent @ lean)
    fraction = (body.fraction * denser).clamp_min(0.1 * body.fraction.min())
    return replace(body, positions=body.positions + moved, fraction=fraction)


def shaken(body: Body, random: np.random.Generator) -> Body:
    """The same body by full particles at random places: a cell has one as probably as it is occupied."""
    kept = torch.from_numpy(random.random(len(body.fraction))) < body.fraction
    size = body.fraction[:, None] ** (1 / 3) * (body.spacing / 2)
    steps = size * torch.tensor(random.uniform(-0.5, 0.5, (len(size), 3)), dtype=body.positions.dtype)
    positions = (body.positions + steps)[kept]
    discs = body.discs.moved(steps, kept, positions, body.spacing / 2)
    return Body(positions, torch.ones_like(body.fraction[kept]), body.spacing, discs)
