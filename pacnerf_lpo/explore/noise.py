"""What the residual may be where nothing is missing: as a diagnosis has stored it, or learnt once for the session."""

import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from pacnerf_lpo.diagnosis.comparison import Comparison, intervals
from pacnerf_lpo.diagnosis.localising import floor, mean_of_outlines
from pacnerf_lpo.diagnosis.store import DAMAGED, read
from pacnerf_lpo.explore.catalogue import Catalogue
from pacnerf_lpo.explore.records import Step
from pacnerf_lpo.explore.source import Source
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.model_errors import ModelErrors
from pacnerf_lpo.identification.processes import Progress, prefixed

LEARNT = "explore_noise"
"""Step of the store with what a session has learnt itself."""
REPLICATES, SEED = 8, 1
"""As few simulated nulls as a diagnosis can do with."""


@dataclass(frozen=True)
class Known:
    """A fitted model of a stored diagnosis, and the noise around it.

    effects: names of those of the model.
    intervals: 90 % intervals [SI]
    comparison: the model fitted.
    """

    effects: tuple[str, ...]
    intervals: dict[str, tuple[float, float]]
    comparison: Comparison


class Noise:
    """The noise of a session."""

    def __init__(self, source: Source, catalogue: Catalogue):
        self.source, self.problem, self.catalogue = source, source.problem, catalogue
        self.known = self._stored()

    @property
    def first(self) -> Known | None:
        """The model of the run as the stored diagnosis has fitted it."""
        return next((one for one in self.known if one.effects == self.catalogue.installed and one.intervals), None)

    def floor(self, step: Step) -> tuple[float, float] | None:
        """Root mean square of the replicates in the fitted and the held-out data [the problem's unit]; None where none
        were simulated yet.
        """
        if not self.known:
            return None
        variance = mean_of_outlines(floor(self.nearest(step).comparison)[1])
        split, factor = self.problem.split, self.problem.unit[1]
        parts = (variance[split.fitted], variance[split.held])
        fitted, held = (factor * float(np.sqrt(np.nanmean(part))) if np.isfinite(part).any() else 0.0 for part in parts)
        return fitted, held

    def nearest(self, step: Step) -> Known:
        """The noise that was learnt around the model most like a step: with as many of its effects as can be."""
        return min(self.known, key=lambda one: len(set(one.effects) ^ set(step.effects)))

    def of(self, step: Step, progress: Progress) -> Known:
        """The noise around a step: that of the nearest model, learnt where there is none. Raises SimulationError where
        the step's motion, or a finer one, is unstable.
        """
        if not self.known:
            self.learn(step, progress)
        return self.nearest(step)

    def learn(self, step: Step, progress: Progress) -> None:
        """Learn the noise around a step, unless that was done for a model with its effects: simulated nulls, errors of
        the reconstructed shape and a smooth force, some 160 rollouts.
        """
        if any(set(one.effects) == set(step.effects) for one in self.known):
            return
        what = json.dumps([sorted(step.effects), sorted(step.values.items())])
        name = f"{LEARNT}_{hashlib.sha256(what.encode()).hexdigest()[:8]}"
        comparison = self.source.store.once(name, partial(self._learnt, step, progress))
        self.known.append(Known(step.effects, {}, comparison))

    def reload(self) -> None:
        """Take over what a diagnosis has stored meanwhile."""
        stored = self._stored()
        self.known = [*stored, *(one for one in self.known if not one.intervals)]

    def _learnt(self, step: Step, progress: Progress) -> Comparison:
        problem, effects = self.problem, self.catalogue.chosen(step.effects)
        model = problem.model(effects, step.values)
        told = prefixed(progress, "noise: ")
        errors = ModelErrors.learn(problem, effects, model, model.start, (REPLICATES, SEED), told)
        residual = problem.residual(model.predict(model.start))
        seen = residual, np.zeros((*residual.shape, 0))
        at = model, model.start, priors(problem, model), seen, errors
        return Comparison.at(*at, problem.fitted_with(effects))

    def _stored(self) -> list[Known]:
        """Models that a diagnosis of the same data has fitted."""
        problem, store, known, found = self.problem, self.source.store, self.catalogue.effects, []
        for path in sorted((store.folder / "steps").glob(f"{store.key}_*compare.npz")):
            with suppress(*DAMAGED):
                comparison = read(path)["result"]
                effects = {n: e for n, e in known.items() if set(e.parameters) <= set(comparison.names)}
                names = problem.model(tuple(effects.values()), comparison.known).names
                if set(comparison.names) - set(names) or comparison.residual.shape != problem.usable.shape:
                    continue  # it has an effect that this session does not know
                told, _ = intervals(problem, tuple(effects.values()), comparison)
                ends = {one.name: (one.low, one.high) for one in told if one.identifiable}
                found.append(Known(tuple(effects), ends, comparison))
        return found
