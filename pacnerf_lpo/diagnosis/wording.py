"""What a diagnosis found, in sentences."""

from __future__ import annotations

import re
from collections.abc import Sequence

from pacnerf_lpo.diagnosis.catalogue import Candidate
from pacnerf_lpo.diagnosis.statistics.residual_force import Law
from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.quantities import quantity

NOTHING = "Nothing detectable is missing: what the model leaves over is no more than its own numerical error."
UNKNOWN = "Something is missing, but none of the known effects explains it."
FAULTY = (
    "No missing effect is detectable: what the model leaves over is more than its own numerical error, but looks less "
    "like a force on the body than like an error of the reconstruction or of a camera."
)
ASIDE = (
    "No missing effect is detectable, but the model does not hold in the views and frames kept aside: its parameters "
    "may stand in for an effect, or the reconstruction is wrong there."
)
REST = "What is left is more than the model's own numerical error: a further effect, or a faulty reconstruction."
LIKENESS = 0.5
"""Share of a force that a law explains which it is said to look like."""


def readable(name: str) -> str:
    """``LinearDrag`` as *linear drag*, ``CameraShift@3`` as *camera shift of view 3*."""
    kind, _, view = name.partition("@")
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", kind).lower()
    return f"{words} of view {view}" if view else words


def either(names: Sequence[str]) -> str:
    """Effects that cannot be told apart, as a choice."""
    words = [readable(name) for name in names]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def probability(p: float) -> str:
    """A p-value as a person reads it."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


def missing(candidate: Candidate, alike: Sequence[str], p: float, removed: float, again: bool) -> str:
    """The sentence about an accepted effect.

    Args:
        candidate: the effect that was added.
        alike: names that cannot be told apart from it, itself among them.
        p: family-wise p-value of the score test.
        removed: share of the held-out excess error that it removes.
        again: whether another effect was found before.
    """
    named = either([candidate.name, *(name for name in alike if name != candidate.name)])
    what = f"{named} is {'also ' if again else ''}missing" if not candidate.observes else f"{named}: a camera is wrong"
    return f"{what[0].upper()}{what[1:]} ({probability(p)}); adding it removes {removed:.0%} of the held-out error."


def nearest(names: Sequence[str], removed: float, remaining: str) -> str:
    """What the effects do that were accepted and do not explain it.

    Args:
        names: of the effects.
        removed: share of the held-out error that they remove together.
        remaining: about the rest of it.
    """
    tried = " and ".join(readable(name) for name in names)
    comes, removes = ("comes", "removes") if len(names) == 1 else ("come", "together remove")
    return f"Nearest {comes} {tried}, which {removes} {removed:.0%} of the held-out error; {remaining}."


MORE_THAN_HALF = "more than half remains"
LIKE_A_FORCE = "what remains still looks like a force"


def times(ratio: float) -> str:
    """About an error whose mean square is so many times that of the twins."""
    return f"what remains is {ratio**0.5:.1f} times the model's own numerical error"


def moved(parameter: Parameter, before: float, after: float) -> str:
    """How a parameter changes when the effect is added."""
    values = quantity(before, parameter.unit), quantity(after, parameter.unit)
    return f"{parameter.label} moves from {values[0]} to {values[1]}"


def separation(candidate: Candidate, alike: Sequence[str]) -> str | None:
    """What recording would tell apart the effects of one class; None if there is one."""
    if len(alike) < 2:
        return None
    others = either([name for name in alike if name != candidate.name])
    return f"To tell {readable(candidate.name)} from {others}: {candidate.effect.separating_experiment}."


def force(explained: float, held: float, law: Law) -> list[str]:
    """About the smooth force that would remove the residual.

    Args:
        explained, held: share that it removes of the fitted residual, and of the excess in the views kept aside.
        law: that it looks like.
    """
    aside = f"{held:.0%}" if held > 0 else "nothing"
    found = [
        f"A smooth force on the body would remove {explained:.0%} of what is left, and {aside} in the views kept aside."
    ]
    terms = ", ".join(f"{term.coefficient:.3g} {term.unit} times ({term.name})" for term in law.terms)
    if law.terms and law.explained >= LIKENESS:
        found.append(f"It looks like {terms}, which explains {law.explained:.0%} of it.")
    elif law.terms:
        found.append(f"No simple law describes that force; the nearest, {terms}, explains {law.explained:.0%} of it.")
    else:
        found.append("No simple law describes that force: it follows neither place nor velocity.")
    return found
