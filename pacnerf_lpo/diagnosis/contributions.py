"""What each recording is, and what it contributes to a diagnosis."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis.rounds import Round
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.smooth_force import AXES
from pacnerf_lpo.inference.intervals import LEAST_STRENGTH
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import OF


def recordings(problem: Problem, rounds: Sequence[Round]) -> list[dict[str, Any]]:
    """Every recording: its views and frames, the phases of its motion, and of the first round

    - ``cost`` and ``refits``: weighted sum of squares of its fitted numbers, ``numbers``, under the model and under the
      model with each effect that was fitted: which effect this recording asks for;
    - ``tells``: its share of what all recordings tell of each parameter that they have in common (information).
    """
    first, comparison = rounds[0], rounds[0].comparison
    parts = problem.parts(first.effects, comparison.known)
    shared = [index for index, name in enumerate(comparison.names) if OF not in name]
    names = [comparison.names[index] for index in shared]
    information: list[np.ndarray] = []
    found: list[dict[str, Any]] = []
    for part, mask, phases in zip(parts, entries_of_each(problem, comparison.fitted), first.phases, strict=True):
        noise = comparison.noise(problem, mask)
        information.append((noise.whiten(comparison.changes(mask))[:, shared] ** 2).sum(0))
        again = {r.name: noise.square(np.nan_to_num(r.residual[mask])) for r in first.refits}
        video = part.recording.video
        found.append(
            {
                "name": part.name,
                "views": list(video.view_ids),
                "frames": list(video.frame_ids),
                "times": video.times.tolist(),
                "phases": phases,
                "numbers": int(mask.sum()),
                "cost": noise.square(comparison.residual[mask]),
                "refits": again,
            }
        )
    total = np.sum(information, axis=0)
    told = np.flatnonzero(total > LEAST_STRENGTH**2)
    for one, own in zip(found, information, strict=True):
        one["tells"] = {names[index]: round(float(own[index] / total[index]), 4) for index in told}
    return found


def estimates(problem: Problem, rounds: Sequence[Round]) -> dict[str, list[tuple[float, float]]]:
    """For every effect that was added and has one coefficient, or one for each recording: what each recording by itself
    says of it, from its linear change, all else free; the least-squares value and its standard error [SI].
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for done in rounds:
        if done.accepted is None or done.probes is None:
            continue
        tried = next((one for one in done.probes.hypotheses if one.name == done.accepted.name), None)
        if tried is None or len(type(done.candidate(tried.name).effect).parameters) > 1:
            continue
        column = np.zeros(problem.usable.shape)
        column[problem.usable] = (tried.alternatives[0] / tried.widths[0]).sum(1)
        fitted = problem.fitted_with([*done.effects, done.candidate(tried.name).effect])
        found[tried.name] = [_estimate(problem, done, column, mask) for mask in entries_of_each(problem, fitted)]
    return found


def steady_forces(problem: Problem, last: Round, effect: Effect) -> list[tuple[np.ndarray, np.ndarray]]:
    """For every recording of a rigid body: the steady acceleration that does what an effect of the last model does
    there, by least squares [m/s^2, (3,)], and its covariance [(3, 3)]. Where it points is not presumed.
    """
    comparison, found = last.comparison, []
    without = problem.model(last.effects, {**comparison.known, **effect.null})
    residual = problem.residual(without.predict(without.start))
    others = ~np.isin(comparison.names, list(effect.parameters))
    for mask in entries_of_each(problem, comparison.fitted):
        moved = comparison.changes(mask)[:, others]
        noise, force = comparison.noise(problem, mask).with_directions(moved), comparison.errors.force[mask]
        own = force[:, np.abs(force).max(0) > 0]
        columns = noise.whiten(own.reshape(len(own), -1, len(AXES)).sum(1))  # hats at all knots make a constant
        covariance = np.linalg.pinv(columns.T @ columns, rcond=1e-10, hermitian=True)
        found.append((covariance @ columns.T @ noise.whiten_residual(residual[mask]), covariance))
    return found


def _estimate(problem: Problem, done: Round, column: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    noise = done.comparison.marginal(problem, mask)
    change, left = noise.whiten(column[mask]), noise.whiten_residual(done.comparison.residual[mask])
    strength = max(float(change @ change), 1e-30)
    return float(change @ left) / strength, 1 / float(np.sqrt(strength))


def entries_of_each(problem: Problem, mask: np.ndarray) -> list[np.ndarray]:
    """The entries of a mask that are of each recording, among those of all [(R, F, 11), bool]."""
    own = [problem.part_of(mask, number) for number in range(len(problem.parts((), {})))]
    return [problem.join([part & (other == number) for other, part in enumerate(own)]) for number in range(len(own))]
