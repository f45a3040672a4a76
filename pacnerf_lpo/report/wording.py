"""The verdict of a diagnosis in sentences."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from pacnerf_lpo.diagnosis.rounds import Round, Verdict, removed_share
from pacnerf_lpo.identification.study import view_name
from pacnerf_lpo.inference.force_law import Law
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.quantities import quantity

NOTHING = "Nothing detectable is missing: what the model does not explain is no more than its own numerical error."
DOUBT = (
    "No missing effect is detectable, but the model does not predict the held-out views and frames within its error: the "
    "reconstruction or a camera is in doubt."
)
UNKNOWN = "Something is missing, but none of the known effects explains it."
UNFINISHED = "The diagnosis has not ended: the effects have not been fitted yet."
REST = (
    "What the model with it does not explain is more than its own numerical error: a further effect, or an error of the "
    "reconstruction."
)
MOST_ODDS = float(np.log(1000.0))
"""Odds that are larger are not worth a number: the prediction is not that exact."""
LIKENESS = 0.5
"""Share of a force that a law explains which it is said to look like."""


def readable(name: str) -> str:
    """``LinearDrag`` as *linear drag*, ``CameraShift@3`` as *camera shift of view 3*."""
    kind, _, view = name.partition("@")
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", kind).lower()
    return f"{words} of {view_name(int(view))}" if view else words


def either(names: Sequence[str]) -> str:
    """Effects that cannot be told apart, as a choice."""
    words = [readable(name) for name in names]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def odds(log_bayes_factor: float) -> str:
    """An expected log Bayes factor as odds that a person can read."""
    if log_bayes_factor > MOST_ODDS:
        return f"more than {np.exp(MOST_ODDS):,.0f} to one"
    factor = float(np.exp(log_bayes_factor))
    return f"{factor:.1f} to one" if factor < 10 else f"{factor:.0f} to one"


def probability(p: float) -> str:
    """A p-value as a person reads it."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


def verdict(material: Material, rounds: list[Round], said: Verdict) -> list[str]:
    """The verdict, then what else is to be said.

    Args:
        material: of the model.
        rounds: of the diagnosis.
        said: their verdict.
    """
    found: list[str] = []
    last = rounds[-1]
    if said.kind == "unfinished":
        return [UNFINISHED]
    if said.kind == "nothing":
        found.append(DOUBT if said.rest else NOTHING)
    if said.kind == "unknown":
        found.append(UNKNOWN)
        if said.names:
            nearest = " and ".join(readable(name) for name in said.names)
            share = 0.0 if said.removed is None else said.removed
            found.append(f"The nearest known cause, {nearest}, removes {share:.0%} of the held-out error.")
    if said.kind in ("missing", "camera"):
        found += _named(material, rounds, said)
        found += [REST] if said.rest else []
    if last.force is not None:
        found += force(last.force.explained, last.force.law)
    return [*found, *last.comparison.notes]


def _named(material: Material, rounds: list[Round], said: Verdict) -> list[str]:
    found: list[str] = []
    for number, done in enumerate(rounds):
        again = done.accepted
        if again is None or again.name not in said.names:
            continue
        after = rounds[number + 1] if number + 1 < len(rounds) else None
        share = removed_share([done, after]) if after is not None else None
        candidate = done.candidate(again.name)
        named, too = either(done.alike), "also " if found else ""
        what = f"{named}: a camera is wrong" if candidate.observes else f"{named} is {too}missing"
        removes = "" if share is None else f"; adding it removes {share:.0%} of the held-out error"
        found.append(f"{what[0].upper()}{what[1:]} ({probability(again.p_value)}{removes}).")
        values = again.known if after is None else after.comparison.known
        changed = [
            f"{material.parameters[i.name].label} moves from {quantity(i.value, material.parameters[i.name].unit)} to "
            f"{quantity(values[i.name], material.parameters[i.name].unit)}"
            for i in done.parameters
            if i.name in material.free_names
        ]
        if changed:
            found.append(f"{'; '.join(changed)[0].upper()}{'; '.join(changed)[1:]}.")
        others = [name for name in done.alike if name != again.name]
        if others and done.proposals:
            best = done.proposals[0]
            found.append(f"To tell {either(done.alike)}: {best.words}; expected odds: {odds(best.score)}.")
        elif others and candidate.effect.separating_experiment:
            found.append(
                f"To tell {readable(again.name)} from {either(others)}: {candidate.effect.separating_experiment}."
            )
    return found


def force(explained: float, law: Law) -> list[str]:
    """About the smooth force that would remove the residual.

    Args:
        explained: share of the excess error that it removes.
        law: that it looks like.
    """
    found = [f"A smooth force on the body would remove {explained:.0%} of the error that is left."]
    terms = ", ".join(f"{term.coefficient:.3g} {term.unit} times ({term.name})" for term in law.terms)
    if law.terms and law.explained >= LIKENESS:
        found.append(f"It looks like {terms}, which explains {law.explained:.0%} of it.")
    elif law.terms:
        found.append(f"No simple law describes that force; the nearest, {terms}, explains {law.explained:.0%} of it.")
    else:
        found.append("No simple law describes that force: it follows neither place nor velocity.")
    return found


NOT_IDENTIFIABLE = (
    "Motion alone gives E / rho, eta / rho and yield stress / rho, not the density itself.",
    "A time offset common to all cameras looks like another initial position and velocity.",
    "Another strength of gravity looks like another length scale.",
    "A tilt of the world looks like a uniform sideways force.",
)
