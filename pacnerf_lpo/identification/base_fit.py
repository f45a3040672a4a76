"""Material, motion and the coefficients of some effects, fitted from a guess: what every hypothesis is judged by."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import CONVERGED, Fit
from pacnerf_lpo.identification.multistart import Search, Stage, Watch, horizons, multistart
from pacnerf_lpo.identification.problem import COARSER, Problem
from pacnerf_lpo.identification.processes import Progress
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import Log10

SAMPLES = 8
"""Points tried for each modulus: over three decades they lie nearer to each other than one fit reaches."""
JOINT_SAMPLES = 32
"""Points tried for moduli and coefficients of effects at once, where a strong effect hides behind a wrong modulus."""
EXPLAINED = 3.0
"""Cost per row of a coarse body's best fit: above that it is not its own error alone that is left."""
WIDE = 1.5
"""Standard deviations of its prior, to either side, over which a modulus or a coefficient is searched."""
COMPETITIVE = 3.0
"""Of the cost of the fit from the guess: a point above that, with all else as there, promises no other minimum."""
COMPETING = 1.5
"""Of the best cost: a coarse body's error makes optima that differ by less change places on a finer one."""
SEARCH_ITERATIONS, ITERATIONS = 4, 15
MOST_OPTIMA = 2
"""Of the coarse body: so many are followed on the fine one."""
FAR = 2.0
"""Standard deviations of a prior: an estimate farther away is reported."""
TO_NO_SPACING = 1 / (COARSER**2 - 1)
"""Of the step from the coarse body to the problem's: so much farther is vanishing node spacing, if the error goes with
its square (Richardson 1911). A plastic body is deformed by a coarse grid as by another yield stress, and a fit that
does not know that ends in another valley."""
TOUCH = 1.5
"""Node spacings above the ground: a particle lower than this feels it, as far as a quadratic B-spline reaches. A stiff
body is thrown back before it comes much nearer."""


@dataclass(frozen=True)
class BaseFit:
    """A fitted model.

    model: of the problem's body.
    free: its coordinates [(K,)];  known: every value there [SI]
    cost: sum of squares of the residual and of the priors' rows.
    notes: sentences about estimates at a bound or far from the guess, and about points left out as unstable.
    rollouts: simulations that it took, on both bodies.
    """

    model: Model
    free: np.ndarray
    known: dict[str, float]
    cost: float
    notes: tuple[str, ...]
    rollouts: int


class Objective:
    """Weighted residual of a model in the fitted entries, then one row for each unknown: how far it is from the mean of
    its prior in standard deviations. Every evaluation begins with the model's own time step, so that it does not depend
    on which points were unstable before.

    Args:
        problem, model: what is compared.
        mean, deviation: of the priors, in free coordinates [(K,)]
        level: error of the residual in units of its weights, which know the sensor's error but not the model's: a prior
            must not be outvoted by what is not known.
        coarse: the same model of a coarse body, by which what the model shows is extrapolated to vanishing node
            spacing; None: it is not.
    """

    def __init__(
        self,
        problem: Problem,
        model: Model,
        mean: np.ndarray,
        deviation: np.ndarray,
        level: float = 1.0,
        coarse: Model | None = None,
    ):
        self.models = [model] if coarse is None else [model, coarse]
        self.mean, self.deviation, self.level = mean, deviation, level
        self._weighted = [problem.weighted_residual_of(one) for one in self.models]

    def __call__(self, free: np.ndarray) -> np.ndarray:
        """Rows at free coordinates [(K,) to (D + K,)]. Raises SimulationError."""
        for one in self.models:
            one.restart()
        rows, *coarse = (weighted(free) for weighted in self._weighted)
        for others in coarse:
            rows = rows + TO_NO_SPACING * (rows - others)
        return np.concatenate((rows, self.level * (free - self.mean) / self.deviation))


def base_fit(
    problem: Problem,
    effects: Sequence[Effect],
    known: dict[str, float],
    progress: Progress = lambda _: None,
    followed: bool = False,
) -> BaseFit:
    """Fit material, velocity and effects to the fitted views and frames, with priors, beginning from a guess.

    Fits on a coarse body take in more and more frames, from ``known`` and from points that differ in the moduli and
    promise another minimum, and one takes in all frames at once, from ``known``; the best of them go on with what the
    problem's own body shows, extrapolated to vanishing node spacing. Where nothing is difficult that takes some sixty
    rollouts.

    Args:
        problem: measurements, and the user's guess, around which the priors lie.
        effects: of the model. One without a gradient at its null, which ``known`` leaves there, starts at its probes.
        known: values to start from, velocity among them [SI].
        followed: another fit goes on from here, so that the last hundredth of the cost is left to it.

    Raises:
        SimulationError: the motion is unstable at every start, with the shortest time step too.
    """
    return refined(problem, effects, known, coarse_search(problem, effects, known, progress), progress, followed)


def coarse_search(
    problem: Problem,
    effects: Sequence[Effect],
    known: dict[str, float],
    progress: Progress = lambda _: None,
    watch: Watch = lambda items, _: items,
    most_samples: int = JOINT_SAMPLES,
) -> Search:
    """The part of a base fit on the coarse body; arguments as of :func:`base_fit`. Its fits, best first, have the rows
    of an :class:`Objective`; there are none where every motion is unstable.

    Args:
        watch: passes points on as they are tried, as for :func:`~.multistart.multistart`.
        most_samples: points tried for all moduli together, at most.
    """
    coarse = problem.coarse_model(effects, known)
    mean, deviation = priors(problem, coarse)
    starts = [np.clip(start, *coarse.bounds) for start in at_probes(coarse, effects)]
    frames = problem.split.last_fitted + 1
    contact, looked = _contact(coarse, starts)
    rows = [_rows(problem, until, len(mean)) for until in horizons(contact, frames)]
    settings = Objective(problem, coarse, mean, deviation), coarse.scales, coarse.bounds
    free = problem.physics.material.free_names
    moduli = [p.name for p in coarse.unknowns if p.name in free and isinstance(p.transform, Log10)]
    coefficients = [name for effect in effects for name in effect.parameters]
    spans, wider = (_spans(coarse, names, mean, deviation) for names in (moduli, [*free, *coefficients]))
    first = None, rows[-min(len(rows), 3)]
    touched = f"contact in frame {contact} of {frames}" if contact < coarse.shape[1] else "no contact seen"
    progress(f"base fit from {len(starts)} starts on a coarse body; {touched}")
    refitted = Stage(*settings, rows, MOST_OPTIMA, SEARCH_ITERATIONS, within=COMPETING)
    sampled = Stage(*settings, first, spans=spans, samples=min(SAMPLES * len(moduli), most_samples), within=COMPETITIVE)
    # The first frames lead a bad guess to the right valley, and away from it a good one, which their errors outvote.
    walked = multistart([replace(refitted, within=None)], starts, watch)
    begun = multistart([replace(refitted, rows=rows[-1:], within=None)], [*walked.fits, *starts], watch)
    elsewhere = multistart([sampled], begun.fits or starts, watch)
    ended = multistart([refitted], [*begun.fits, *elsewhere.fits] or starts, watch)
    search = _as_one(walked, begun, elsewhere, ended)
    if coefficients and search.fits and level_of(search.fits, len(mean)) ** 2 > EXPLAINED:
        progress("base fit: nothing explains the video yet; searching the effects' coefficients, too")
        sampled = replace(sampled, keep=MOST_OPTIMA, spans=wider, samples=JOINT_SAMPLES)
        search = _as_one(search, multistart([sampled, refitted], search.fits, watch))
    return replace(search, rollouts=search.rollouts + looked)


def _as_one(*parts: Search) -> Search:
    """What searches after each other have found, and what they took."""
    return Search(parts[-1].fits, sum(part.rollouts for part in parts), sum(part.unstable for part in parts))


def refined(
    problem: Problem,
    effects: Sequence[Effect],
    known: dict[str, float],
    search: Search,
    progress: Progress = lambda _: None,
    followed: bool = False,
) -> BaseFit:
    """The part of a base fit on the problem's own body, from what a :func:`coarse_search` ended with; arguments as of
    :func:`base_fit`. Raises SimulationError.
    """
    fine = problem.model(effects, known)
    mean, deviation = priors(problem, fine)
    starts = [np.clip(start, *fine.bounds) for start in at_probes(fine, effects)]
    found: Sequence[Fit | np.ndarray] = search.fits or starts
    level = level_of(search.fits, len(mean))
    progress(f"base fit: {len(found)} optima on the body itself")
    coarse = problem.coarse_model(effects, known) if problem.deforms else None
    final = Objective(problem, fine, mean, deviation, level, coarse)
    last = Stage(final, fine.scales, fine.bounds, iterations=ITERATIONS, confirm=not followed)
    ended = multistart([last], found)
    if not ended.fits:  # a point may be stable on the coarse body alone
        ended = multistart([last], starts)
    if not ended.fits:
        raise SimulationError(0, 0, "the motion is unstable from every start of the base fit; give another guess")
    best = ended.fits[0]
    left_out = search.unstable + ended.unstable
    unstable = [f"{left_out} points of the search were left out: their motion is unstable."] if left_out else []
    return BaseFit(
        fine,
        best.free,
        fine.physical(best.free),
        best.cost,
        (*notes(fine, best.free, mean, deviation), *unstable),
        search.rollouts + ended.rollouts,
    )


def priors(problem: Problem, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations of a model's free coordinates [(K,), (K,)]: those of the effects, and for the rest
    around what the user guessed.
    """
    guess = {**model.known, **problem.first_guess, **problem.guess}
    of_effects = {name: effect.prior(name) for effect in model.effects for name in effect.parameters}
    found = [of_effects.get(unknown.name) or unknown.prior(guess[unknown.name]) for unknown in model.unknowns]
    mean, deviation = np.array(found).T
    return mean, deviation


def notes(model: Model, free: np.ndarray, mean: np.ndarray, deviation: np.ndarray) -> list[str]:
    """What is suspect about estimates at free coordinates [(K,)], a sentence each."""
    found, values, expected = [], model.physical(free), model.physical(mean)
    for index, unknown in enumerate(model.unknowns):
        shown, label = unknown.show(values[unknown.name]), unknown.label[:1].upper() + unknown.label[1:]
        away = abs(free[index] - mean[index]) / deviation[index]
        inside = min(free[index] - model.bounds[0][index], model.bounds[1][index] - free[index])
        if inside < CONVERGED * model.scales[index]:
            found.append(f"{label}: {shown} is a bound of what is possible.")
        elif away > FAR:
            prior = unknown.show(expected[unknown.name])
            found.append(f"{label}: {shown} is {away:.1f} standard deviations of its prior from {prior}.")
    return found


def at_probes(model: Model, effects: Sequence[Effect]) -> list[np.ndarray]:
    """Free coordinates to begin with [(K,) each]: as known, but an effect without a gradient at its null, which stands
    there, at each of its probes.
    """
    found = [model.start]
    for effect in effects:
        if effect.discrete and all(model.known[name] == null for name, null in effect.null.items()):
            found = [model.moved(point, probe) for point in found for probe in effect.probes]
    return found


def _contact(model: Model, starts: Sequence[np.ndarray]) -> tuple[int, int]:
    """First frame in which the body touches the ground, and how many rollouts it took to see that; the number of frames
    where it never does, or no motion is stable.
    """
    for used, start in enumerate(starts, 1):
        try:
            return model.contact(start, TOUCH), used
        except SimulationError:
            continue
    return model.shape[1], len(starts)


def _rows(problem: Problem, until: int, unknowns: int) -> np.ndarray:
    """Which rows of an :class:`Objective` are of the first frames or of a prior [(D + K,), bool]."""
    return np.append(np.nonzero(problem.fitted)[1] < until, np.ones(unknowns, bool))


def _spans(
    model: Model, names: Sequence[str], mean: np.ndarray, deviation: np.ndarray
) -> dict[int, tuple[float, float]]:
    """Between which free coordinates some unknowns are searched, by index."""
    low, high = np.clip((mean - WIDE * deviation, mean + WIDE * deviation), *model.bounds)
    return {index: (low[index], high[index]) for index in map(model.names.index, names)}


def level_of(fits: Sequence[Fit], unknowns: int) -> float:
    """Error of the residual in units of its weights, by what the best fit leaves; at least 1."""
    if not fits:
        return 1.0
    return max(1.0, float(np.sqrt(fits[0].cost / max(len(fits[0].residual) - 2 * unknowns, 1))))
