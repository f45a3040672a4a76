"""The hypotheses of a round compete: which of them are fitted, in which order, and from where."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import takewhile

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.refitting import Ahead, How, Refit, bent, refit
from pacnerf_lpo.diagnosis.rounds import Round, discrepancy_wins, leaves_more
from pacnerf_lpo.diagnosis.screening import FORCE, Screening
from pacnerf_lpo.diagnosis.store import Store
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.processes import Progress, prefixed
from pacnerf_lpo.inference.decision import DECISIVE, LEVEL, LINEAR, explains_most, worth_refitting
from pacnerf_lpo.mpm.effects.base import BodyForce

MOST_AGAIN = 3
"""Times that a round begins again from a better optimum of its model; after that, evidence is only counted against it.
"""


@dataclass
class Competition:
    """Fits of every hypothesis that could win in a round: of those whose linear change says so, and in a widened round
    of those whose linear change is no accident, and of effects of which a straight line says little. While more than
    noise is left, non-local ones, of which a line never says much, are fitted from their probes, and where the model
    without them has gone far from what was expected and no effect explains the most of it, by a search of their own
    parameter space, too.

    problem, store: what is under diagnosis, and where results are kept.
    number: of the round, in the names of steps.
    found: the round, screened.
    kept: refits that are not made again.
    refits: so far, one of each hypothesis; they took so many simulations as ``simulated`` says.
    """

    problem: Problem
    store: Store
    number: str
    found: Round
    progress: Progress
    kept: Sequence[Refit] = ()

    def __post_init__(self) -> None:
        assert self.found.screening is not None
        self.screening, self.refits, self.simulated = self.found.screening, list(self.kept), 0

    def run(self) -> list[Refit]:
        """All refits, against the best optimum of the model without them that any of them has found."""
        found, size = self.found, int(self.found.comparison.fitted.sum())
        gone = [*found.left_out, *found.unconfirmed]
        by_name = {candidate.name: candidate for candidate in found.candidates if candidate.name not in gone}
        tried: list[str] = []
        while left := [name for name in self._order(by_name) if name not in tried]:
            self._attempt(by_name[left[0]])
            tried.append(left[0])
        ahead = self._leader()
        for name in [] if ahead is None else takewhile(lambda name: name != ahead.name, tried):
            self._attempt(by_name[name], "beside")
        for searched in (False, True) if bent(found.comparison) else (False,):
            for candidate in by_name.values():
                if not candidate.discrete or candidate.observes:
                    continue
                known = any(again.name == candidate.name for again in self.refits)
                least = min((again.cost for again in self.refits if again.p_value < LEVEL), default=np.inf)
                wanted = not explains_most(found.comparison.cost, least, size) if searched else not known
                if wanted and more_than_noise(found, self.refits, size):
                    self._attempt(candidate, "searched" if searched else "thoroughly")
        return against_the_best(self.refits, self.screening)

    def _order(self, by_name: dict[str, Candidate]) -> list[str]:
        """Names of the hypotheses that are worth a fit; the incumbent first, then by their linear change, or by less
        where a fit has not kept what that promised.
        """
        found, screening = self.found, self.screening
        scored = {one.name: one.log_bayes_factor for one in screening.scores if one.name in by_name}
        for again in self.refits:
            if again.name in scored:
                scored[again.name] = min(again.log_bayes_factor, scored[again.name])
        names = worth_refitting(list(scored.items()), screening.threshold, 0.0 if found.widened else LINEAR)
        if found.widened:
            names += [name for name in scored if name not in names and self._no_line_leads_to(by_name[name])]
        if found.beside not in by_name:
            return names
        return [found.beside, *(name for name in names if name != found.beside)]

    def _no_line_leads_to(self, candidate: Candidate) -> bool:
        """Whether a straight line from the model says little of an effect: where that has moved far or leaves more than
        it predicts, and of a force, where one of which nothing is known explains the recording.
        """
        found = self.found
        force = isinstance(candidate.effect, BodyForce) and discrepancy_wins(found, FORCE)
        return not candidate.observes and (force or bent(found.comparison) or leaves_more(found))

    def _leader(self) -> Refit | None:
        """The best refit that is decisively better than none. A fault of a held-out camera is fitted to other data."""
        same = (again for again in self.refits if again.name not in self.screening.outside)
        return min((one for one in same if one.log_bayes_factor > DECISIVE), key=lambda one: one.cost, default=None)

    def _attempt(self, candidate: Candidate, how: How = "thoroughly") -> None:
        """Fit one, also from where the best so far ended, or the incumbent."""
        found, screening, name = self.found, self.screening, candidate.name
        if any(again.name == name for again in self.kept):
            return
        if found.again < MOST_AGAIN and any(again.better for again in self.refits):
            return  # all of them will be fitted again beside a better model
        best = min((one.cost for one in self.refits if {one.name, name}.isdisjoint(screening.outside)), default=np.inf)
        leader = self._leader()
        known = found.incumbent if leader is None else leader.known
        ahead = Ahead(best, known if known and how != "searched" else None)
        told = prefixed(self.progress, f"refit with {name}: ")
        step = partial(refit, self.problem, found.effects, found.comparison, candidate, screening, told)
        again = self.store.once(f"{self.number}_refit_{how}_{name}", partial(step, ahead, how))
        if again is None:
            return
        self.simulated += again.simulated
        before = next((other for other in self.refits if other.name == name), None)
        if before is None or again.log_bayes_factor > before.log_bayes_factor:
            self.refits = [other for other in self.refits if other is not before] + [again]


def against_the_best(refits: Sequence[Refit], screening: Screening) -> list[Refit]:
    """Refits against the best optimum of the model without them that any of those to the same data has found."""
    found = []
    for again in refits:
        same = [other for other in refits if (other.name in screening.outside) == (again.name in screening.outside)]
        least = min(same, key=lambda other: other.cost_without)
        found.append(again.against(least.cost_without, least.held_without, screening))
    return found


def more_than_noise(found: Round, refits: Sequence[Refit], size: int) -> bool:
    """Whether the best model of a round so far leaves more than noise, so that another hypothesis could be better: a
    mean square above 1 of the fitted data, whose number is ``size``, where these or those that were held out contradict
    the model without any. How little a model leaves below that is no evidence.
    """
    least = min((again.cost for again in refits), default=found.comparison.cost)
    return min(found.check.p_value, found.held.p_value) < LEVEL and least > size
