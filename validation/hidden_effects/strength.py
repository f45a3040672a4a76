"""How strong an effect must be to stand out by a given number of standard deviations, judged as the diagnosis would."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate, whole_catalogue
from pacnerf_lpo.diagnosis.refitting import GIVE_UP, starts
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import Effort, Fit, Residual, fit, fit_or_none, sensitivities
from pacnerf_lpo.identification.problem import relative
from pacnerf_lpo.identification.replicates import replicates
from pacnerf_lpo.identification.standardised import noise_of
from pacnerf_lpo.mpm.effects.base import Effect
from validation.hidden_effects.film import film
from validation.hidden_effects.known_shape import KnownShape, physics_of
from validation.hidden_effects.setting import FAST, Setting

TRIALS = 7
ITERATIONS, FIRST_ITERATIONS = 12, 4
"""Of a refit: until nothing is gained, and while a strength is sought."""
WITHIN = 0.1
"""Strengths are found to a tenth of the wanted signal-to-noise ratio."""
LONGEST_STEP = 8.0
RIVALS = 3
RANGE = (1e-3, 1e3)
LEAST_SNR = 1e-3


@dataclass(frozen=True)
class Sized:
    """Values of an effect's coefficients [SI] and the signal-to-noise ratio they cause.

    values: by their names.
    strength: of the course on which they lie.
    snr: after material and velocity were refitted without the effect.
    beyond: of an effect outside the catalogue, after the best imitation by a known effect was fitted, too.
    imitated_by: that known effect.
    """

    values: dict[str, float]
    strength: float
    snr: float
    beyond: float | None = None
    imitated_by: str | None = None


class Ruler:
    """Measures effects in a scene with nothing hidden.

    Args:
        setting: of the scene.
        true: values of material and velocity [SI]
        count: of replicates.

    Raises:
        SimulationError: the motion without effects is unstable.
    """

    def __init__(self, setting: Setting, true: dict[str, float], count: int):
        self.true = {**physics_of(setting).guess, **true}
        recorded = film(setting, self.true, (), np.random.default_rng(0), FAST.finer)
        self.problem = problem = KnownShape.seen("ruler", setting, recorded.silhouettes, recorded.brightness)
        self.model = model = problem.model((), self.true)
        found, sensor, _ = replicates(problem, model, model.start, count, seed=0)
        self._sensitivities: dict[str, np.ndarray] = {}
        self.masks = {
            "motion": problem.fitted,
            "camera": problem.usable & problem.split.frames[..., None],
        }
        self.noises = {key: noise_of(problem, found, sensor, mask) for key, mask in self.masks.items()}

    def snr(self, effect: Effect, values: dict[str, float]) -> float:
        """What an effect leaves in noise-free data after material and velocity were refitted without it, in units of
        the noise; infinite where the motion is unstable. The refit matters: a lower stiffness imitates much softening.
        """
        found = self._refit(effect, values, ITERATIONS, self._begun(self._key(effect)))
        return np.inf if found is None else float(np.sqrt(found.cost))

    def _refit(self, effect: Effect, values: dict[str, float], iterations: int, start: Fit) -> Fit | None:
        """Material and velocity refitted without an effect, from a fit to other data; None where the motion with the
        effect is unstable.
        """
        try:
            seen = self._seen(effect, values)
        except SimulationError:
            return None
        left, model = self._left(seen, self.model, self._key(effect)), self.model
        return fit(left, start, model.scales, model.bounds, Effort(iterations))

    def _begun(self, key: str) -> Fit:
        """The truth as a fit, with the sensitivities there, which are the same whatever was recorded."""
        if key not in self._sensitivities:
            model = self.model
            left = self._left(self.problem.measured, model, key)
            changes = sensitivities(left, model.start, left(model.start), model.scales, model.bounds)
            self._sensitivities[key] = changes
        return Fit(self.model.start, np.zeros(0), self._sensitivities[key])

    def _key(self, effect: Effect) -> str:
        view = getattr(effect, "view", None)
        return "camera" if view is not None and not self.problem.split.views[view] else "motion"

    def sized_beyond(self, effect: Effect, course: Callable[[float], dict[str, float]], wanted: float) -> Sized | None:
        """The point on a course of values where the best imitation by a known effect leaves the wanted signal-to-noise
        ratio, to a tenth: of what those can imitate no diagnosis can say that it is something else. None where there is
        no such point.

        The best imitators alone are tried while the strength is sought, all of them at its end.

        Raises:
            SimulationError: the motion with the effect is unstable.
        """
        catalogue = whole_catalogue(self.problem.physics.material, (), ())
        tried, found = catalogue, self.sized(effect, course, wanted)
        if found is None:
            return None
        strength = found.strength
        for _ in range(TRIALS):
            left = self.imitated(effect, course(strength), tried)
            best = sorted(left, key=lambda name: left[name])[:RIVALS]
            if not best:
                return None
            beyond = left[best[0]]
            if abs(beyond / wanted - 1) < WITHIN:
                if tried is catalogue:
                    snr = self.snr(effect, course(strength))
                    return Sized(course(strength), strength, snr, beyond, best[0])
                tried = catalogue
            else:
                strength *= float(np.clip(wanted / beyond, 1 / LONGEST_STEP, LONGEST_STEP))
                tried = [candidate for candidate in catalogue if candidate.name in best]
        return None

    def imitated(self, effect: Effect, values: dict[str, float], imitators: Sequence[Candidate]) -> dict[str, float]:
        """What is left of an effect after each of some others was fitted to it, together with material and velocity, in
        units of the noise; a fit that stays far above the best one is given up.

        Fits start as those of a diagnosis: where linear sensitivities lead; from its probes, if an effect is of another
        kind than none.

        Raises:
            SimulationError: the motion with the effect is unstable.
        """
        seen, best, left = self._seen(effect, values), np.inf, {}
        for candidate in imitators:
            for start in starts(candidate, None) if candidate.discrete else [candidate.effect.null]:
                model = self.problem.model([candidate.effect], {**self.true, **start})
                residual = self._left(seen, model, "motion")
                begin = model.start if candidate.discrete else _linear(model, residual)
                effort = Effort(ITERATIONS, GIVE_UP * best)
                found = fit_or_none(residual, begin, model.scales, model.bounds, effort)
                if found is not None:
                    best = min(best, found.cost)
                    left[candidate.name] = min(left.get(candidate.name, np.inf), float(np.sqrt(found.cost)))
        return left

    def _seen(self, effect: Effect, values: dict[str, float]) -> np.ndarray:
        """Summaries without noise [(V, F, 11)]."""
        model = self.problem.model([effect], {**self.true, **values})
        return model.predict(model.start)

    def _left(self, seen: np.ndarray, model: Model, key: str) -> Residual:
        """What a model leaves of summaries, by its free coordinates, in units of the noise."""
        mask, noise = self.masks[key], self.noises[key]
        return lambda free: noise.whiten(np.nan_to_num(relative(seen - model.predict(free))[mask]))

    def sized(self, effect: Effect, course: Callable[[float], dict[str, float]], wanted: float) -> Sized | None:
        """The point on a course of values (from weak to strong) with a signal-to-noise ratio within a tenth of the
        wanted one; None where there is none.
        """
        (low, high), strength, iterations = RANGE, 1.0, FIRST_ITERATIONS
        start, tried = self._begun(self._key(effect)), list[tuple[float, float]]()
        for _ in range(TRIALS):
            found = self._refit(effect, course(strength), iterations, start)
            if found is not None and _near(found, wanted) and iterations == FIRST_ITERATIONS:
                (low, high), iterations, tried = RANGE, ITERATIONS, []
                found = self._refit(effect, course(strength), iterations, found)
            if found is None:
                high = min(high, strength)
                strength = max(strength / LONGEST_STEP, float(np.sqrt(low * high)))
                continue
            snr, start = float(np.sqrt(found.cost)), found
            if _near(found, wanted):
                return Sized(course(strength), strength, snr)
            if snr > wanted:
                high = min(high, strength)
            else:
                low = max(low, strength)
            tried.append((float(np.log(strength)), float(np.log(max(snr, LEAST_SNR)))))
            proposed = strength * float(np.exp(_step(tried, float(np.log(wanted)))))
            strength = proposed if low < proposed < high else float(np.sqrt(low * high))
        return None


def _near(found: Fit, wanted: float) -> bool:
    """Whether a fit leaves the wanted signal-to-noise ratio."""
    return abs(np.sqrt(found.cost) / wanted - 1) < WITHIN


def _step(tried: list[tuple[float, float]], wanted: float) -> float:
    """Change of the logarithm of a strength by the secant through the last two of logarithms of strength and
    signal-to-noise ratio; in proportion where there is one, or where the ratio falls.
    """
    slope = 1.0
    if len(tried) > 1:
        (x0, y0), (x1, y1) = tried[-2:]
        slope = (y1 - y0) / (x1 - x0)
    return float(
        np.clip((wanted - tried[-1][1]) / (slope if slope > 0 else 1.0), *np.log([1 / LONGEST_STEP, LONGEST_STEP]))
    )


def _linear(model: Model, residual: Residual) -> np.ndarray:
    """Where one Gauss-Newton step leads from a model's start [(K,)]; the start where the motion is unstable there."""
    now = residual(model.start)
    jacobian = sensitivities(residual, model.start, now, model.scales, model.bounds)
    led = np.clip(model.start - np.linalg.lstsq(jacobian, now, rcond=1e-8)[0], *model.bounds)
    try:
        after = residual(led)
    except SimulationError:
        return model.start
    return led if after @ after < now @ now else model.start


def course_of(effect: Effect, random: np.random.Generator) -> Callable[[float], dict[str, float]]:
    """Values of an effect's coefficients from weak (0) to strong: along the direction of a probe, or of a random
    mixture of components; where the null is far away, the largest probe over the strength.
    """
    null, probes = effect.null, effect.probes
    far = set(filter(effect.null_is_far, null))
    if far:
        largest = {name: max(abs(p[name]) for p in probes) for name in far}
        return lambda s: {**null, **{name: largest[name] / s for name in far}}
    if len(null) > 1 and not effect.one_sided:
        sizes = {name: max(abs(p[name] - null[name]) for p in probes) for name in null}
        mixture = random.standard_normal(len(null))
        mixture /= np.linalg.norm(mixture)
        return lambda s: {name: null[name] + s * m * sizes[name] for name, m in zip(null, mixture, strict=True)}
    probe = probes[int(random.integers(len(probes)))]
    return lambda s: {name: null[name] + s * (probe[name] - null[name]) for name in null}
