"""Intervals of what a run identified, by the statistics of a diagnosis and without its search for missing effects."""

import json
from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from scipy.stats import norm

from pacnerf_lpo.diagnosis.comparison import (
    CONFIDENCE,
    Comparison,
    compare,
    estimate,
    intervals,
    solver_errors,
)
from pacnerf_lpo.diagnosis.run_problem import RunProblem
from pacnerf_lpo.diagnosis.store import FOLDER, Store
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.identification.problem import PARTICLES, Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.manifest import INTERVALS_FILE, write_atomically
from pacnerf_lpo.mpm.effects.base import Effect

REPLICATES, SEED = 8, 1
"""As few simulated nulls as a diagnosis can do with; Student's t makes the intervals as much wider."""


def keep_intervals(run: Run, progress: Progress, particles: int = PARTICLES) -> None:
    """Write ``intervals.json`` into a run: 90 % posterior intervals of every unknown [SI], how far another solver moves
    it, the intervals with that error, what the recording does not determine, and from which phase.

    A fit to the outlines that begins at what the phase identified, and at what the comparison of laws had found where
    there was one (by data that count by their errors, too), weighted by the scatter of simulated nulls on other
    grids and by errors of the reconstructed shape, first with the same data held out as in a diagnosis, then to all of
    them; kept step by step like those of a diagnosis. After a phase that was fitted to images it searches on a coarse
    body first: their optimum may lie in another valley of the outlines. It has more particles than the phase, and does
    not have to believe in the reconstructed shape. So its values take the place of those of the phase, as long as
    nothing was corrected with them.

    Args:
        run: of which a phase with a motion is finished.
        particles: the body is sampled by about so many.

    Raises:
        UserInputError: no law has been chosen yet, or too few views or frames.
        SimulationError: the identified motion is unstable.
    """
    problem = RunProblem(run, particles=particles)
    if problem.stage.record.before is not None:
        return
    effects = tuple(problem.physics.effects)
    searched = not run.by_outlines
    options = {"replicates": REPLICATES, "seed": SEED, "particles": particles, "searched": searched}
    store = Store(run.run_dir / FOLDER, problem.fingerprint, options)
    guess, laws = problem.first_guess, [stage.state.physics for stage in run.stages if stage.record.phase == "law"]
    others = [guess | physics for physics in laws]
    step = partial(compare, problem, effects, guess, (REPLICATES, SEED), searched, progress, others)
    comparison = store.once("intervals", step)
    best = store.once("estimate", partial(estimate, problem, effects, comparison, progress))
    found, undetermined = intervals(problem, effects, best)
    errors, before = solver_errors(problem, effects, best, found), of_equal_weights(problem, effects, best)
    content = {
        "phase": problem.stage.stem,
        "level": CONFIDENCE,
        "parameters": {
            one.name: {
                "value": one.value,
                "low": one.low,
                "high": one.high,
                "determined": one.identifiable,
                **errors[one.name].as_json(),
                "equal_weights": before[one.name],
            }
            for one in found
        },
        "undetermined": undetermined,
        "disagreement": best.dispersion,
        "open_volume": problem.open_volume,
        "p_value": comparison.checks(problem)[0].p_value,
        "seconds": sum(store.seconds.values()),
    }
    write_atomically(run.run_dir / INTERVALS_FILE, json.dumps(content, indent=1).encode())
    if problem.stage.stem == run.stages[-1].stem:
        take_over(run, problem.stage, best.known)


def of_equal_weights(problem: Problem, effects: Sequence[Effect], best: Comparison) -> dict[str, tuple[float, float]]:
    """Between which ends a fit is expected to which every number of an outline counts as much, as in an identification
    before this one, if it ends in the same optimum: in all but one of a hundred runs [SI, low and high by name].

    The estimate A r, with A = (J^T J)^-1 J^T of the residual in units of its presumed error, has the covariance A C A^T
    where C is that of the noise and of the known errors (the sandwich of Huber 1967; the difference from the weighted
    estimate has less, Hausman 1978). ``best`` is that weighted one.
    """
    model, mask = problem.model(effects, best.known), problem.fitted
    weight = problem.presumed_error[:, None]
    rows = best.changes(mask) / weight
    estimator = np.linalg.solve(rows.T @ rows + np.eye(rows.shape[1]), rows.T) / weight.T
    spread = np.linalg.norm(best.noise(problem, mask).inverse_adjoint(estimator.T), axis=0) * best.deviation
    half = float(norm.ppf(1 - LEVEL / 2)) * spread
    low, high = (model.physical(np.clip(best.free + side * half, *model.bounds)) for side in (-1, 1))
    return {name: (low[name], high[name]) for name in model.names}


def take_over(run: Run, stage: Stage, known: dict[str, float]) -> None:
    """Give the state of a phase of a run other parameters and another velocity [SI]; the manifest keeps its own."""
    state, names = stage.state, ("v_x", "v_y", "v_z")
    before = dict(zip(names, state.velocity.mean(0).tolist(), strict=True)) | state.physics
    change = torch.tensor([known[name] - before[name] for name in names])
    physics = {name: known[name] for name in state.physics}
    changed = state.with_(physics=physics, velocity=state.velocity + change)
    write_atomically(stage.state_path, changed.as_bytes())
    stage.record.before = before
    run.manifest.save()
