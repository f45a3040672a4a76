"""What one round of a diagnosis has found, and the verdict of all rounds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.comparison import Comparison, Error
from pacnerf_lpo.diagnosis.refitting import Refit
from pacnerf_lpo.diagnosis.residual_force import ResidualForce
from pacnerf_lpo.diagnosis.screening import FORCE, SHAPE, Probes, Screening
from pacnerf_lpo.inference.checks import Check
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.intervals import Interval
from pacnerf_lpo.mpm.effects.base import Effect

if TYPE_CHECKING:
    from pacnerf_lpo.diagnosis.plan import Proposal


@dataclass
class Round:
    """One round: a model, and what competes to be added to it.

    effects: of the model.
    comparison: the model fitted.
    check, held: whether its residual is what it predicts, in the fitted and in the held-out data.
    parameters: intervals of all unknowns.
    undetermined: what the recording does not determine, in words.
    phases: of the motion, by recording and frame.
    candidates: effects that were screened.
    probes: of the candidates; None if the diagnosis stopped before.
    screening: all hypotheses, ranked; None if the diagnosis stopped before.
    refits: with one more effect each.
    accepted: the refit that was taken over.
    left_out: effects that were not added, or not removed where the model has them, because the model would be unstable
        when it is examined: by name, where that happened.
    unconfirmed: effects that were added and taken back: with the errors learnt again around the model with them, the
        model without them explains the recording as well.
    indistinguishable: names that the recording does not tell apart from the accepted one, itself first.
    proposals: recordings that would tell those apart, best first; empty where none were planned.
    removed: names of earlier effects that this model does without.
    force: the smooth force that would remove the residual; None where it is not asked for.
    profiles: lower and upper end by profile likelihood, of the unknowns it was asked for [SI]
    errors: in units of this model's noise, the errors of the models of all rounds so far, this one the last.
    finished: whether every hypothesis that could win was fitted.
    effort: seconds and simulations of every step, by name.
    again: how often the diagnosis began a round again before this one was reached.
    widened: whether hypotheses to which no straight line leads were fitted, too.
    beside, incumbent: name of the earlier effect in whose place they compete beside the others, it among them, and the
        values of the model with it [SI]; empty in rounds that add one.
    second: the round in which the accepted effect has won again beside later ones; None: there was none.
    estimate: the model fitted to all data, for its values and intervals; None but in the last round.
    """

    effects: tuple[Effect, ...]
    comparison: Comparison
    check: Check
    held: Check
    parameters: list[Interval]
    undetermined: list[str]
    phases: list[list[str]]
    candidates: list[Candidate] = field(default_factory=list)
    probes: Probes | None = None
    screening: Screening | None = None
    refits: list[Refit] = field(default_factory=list)
    accepted: Refit | None = None
    left_out: dict[str, str] = field(default_factory=dict)
    unconfirmed: list[str] = field(default_factory=list)
    indistinguishable: list[str] = field(default_factory=list)
    proposals: list[Proposal] = field(default_factory=list)
    removed: list[str] = field(default_factory=list)
    force: ResidualForce | None = None
    profiles: dict[str, tuple[float, float]] = field(default_factory=dict)
    errors: tuple[Error, ...] = ()
    finished: bool = False
    effort: dict[str, dict[str, float]] = field(default_factory=dict)
    again: int = 0
    widened: bool = False
    beside: str = ""
    incumbent: dict[str, float] = field(default_factory=dict)
    second: Round | None = None
    estimate: Comparison | None = None

    @property
    def best(self) -> Comparison:
        """The model fitted to all data; where it was not, to those that are not held out."""
        return self.estimate or self.comparison

    @property
    def better(self) -> dict[str, float] | None:
        """Values of the model at a decisively better optimum that a refit led to [SI]; None: there is none."""
        found = min(self.refits, key=lambda again: (again.better is None, again.cost_without), default=None)
        return None if found is None else found.better

    def spend(self, step: str, effort: dict[str, float]) -> None:
        """Add the seconds and simulations of a step."""
        before = self.effort.get(step, {})
        self.effort[step] = {name: round(value + before.get(name, 0), 1) for name, value in effort.items()}

    def candidate(self, name: str) -> Candidate:
        """The candidate of a name."""
        return next(candidate for candidate in self.candidates if candidate.name == name)


@dataclass(frozen=True)
class Verdict:
    """What all rounds say together.

    kind: ``nothing``, ``missing``, ``camera``, ``unknown`` or ``unfinished``.
    names: of the effects that are missing; where the cause is unknown, of those that come nearest.
    more_than_noise: whether what is left, with all that was found, is more than the model predicts.
    removed: share of the held-out excess error that the effects remove together; None where there are none.
    """

    kind: str
    names: list[str]
    more_than_noise: bool
    removed: float | None


def verdict(rounds: list[Round]) -> Verdict:
    """The verdict: what was accepted, unless a smooth force is left that no known effect makes. Where the model leaves
    more than it predicts, and no force either explains that, the effects stay named, and the rest is said to be left.
    """
    last, names = rounds[-1], accepted_names(rounds)
    more_than_noise = leaves_more(last) or any(discrepancy_wins(last, name) for name in (FORCE, SHAPE))
    share = removed_share(rounds[0], last) if names else None
    if not last.finished and not names:
        return Verdict("unfinished", [], more_than_noise, None)
    if discrepancy_wins(last, FORCE) or (unknown_wins(last) and not names):
        return Verdict("unknown", names, True, share)
    if not names:
        return Verdict("nothing", [], more_than_noise, None)
    return Verdict("camera" if all("@" in name for name in names) else "missing", names, more_than_noise, share)


def accepted_names(rounds: list[Round]) -> list[str]:
    """Of the effects that were added and not removed again, in their order."""
    removed = {name for found in rounds for name in found.removed}
    names = [found.accepted.name for found in rounds if found.accepted is not None]
    return [name for name in names if name not in removed]


def leaves_more(found: Round) -> bool:
    """Whether the residual is more than the model predicts, in the held-out data."""
    return found.held.p_value < LEVEL


def unknown_wins(found: Round) -> bool:
    """Whether an unknown cause is left: a smooth force explains the residual, better than an error of the
    reconstruction does; or, where the shape is known and cannot be wrong, the residual is more than the model predicts.
    """
    if found.screening is None or found.accepted is not None:
        return False
    known = found.screening.score(SHAPE) is None
    return discrepancy_wins(found, FORCE) or (known and found.finished and leaves_more(found))


def discrepancy_wins(found: Round, name: str) -> bool:
    """Whether an unknown force or a wrong shape explains what is left, and better than the other of the two does."""
    if found.screening is None or found.accepted is not None:
        return False
    own, others = found.screening.score(name), [found.screening.score(other) for other in (FORCE, SHAPE)]
    if own is None or found.screening.p_value(own.log_bayes_factor) >= LEVEL:
        return False
    return own.log_bayes_factor >= max(other.log_bayes_factor for other in others if other is not None)


def shows_held_out(found: Round) -> bool:
    """Whether held-out data leave more than the replicates."""
    return found.errors[-1].held > 0


def removed_share(before: Round, after: Round) -> float:
    """Share of the excess of the held-out error of one round that the model of another removes, both in units of the
    latter's noise; of the fitted data where nothing held out :func:`shows <shows_held_out>` an error. At most 1.
    """
    first, last = after.errors[len(before.errors) - 1], after.errors[-1]
    pair = (first.held, last.held) if shows_held_out(before) else (first.fitted, last.fitted)
    return float(1 - np.clip(max(pair[1], 0.0) / max(pair[0], 1e-9), 0.0, 1.0))
