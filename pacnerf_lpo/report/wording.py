"""The verdict of a diagnosis in sentences."""

import re
from collections.abc import Mapping, Sequence
from inspect import signature

from pacnerf_lpo.diagnosis.rounds import Round, Verdict, leaves_more, removed_share, shows_held_out
from pacnerf_lpo.diagnosis.screening import SHAPE
from pacnerf_lpo.identification.study import view_name
from pacnerf_lpo.inference.decision import LEVEL
from pacnerf_lpo.inference.force_law import Law
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.quantities import quantity

NOTHING = "Nothing detectable is missing: what the model does not explain is no more than its own numerical error."
DOUBT_HELD = (
    "No missing effect is detectable, but the model does not predict the held-out views and frames within its error: "
    "the reconstruction or a camera is in doubt."
)
DOUBT_FITTED = (
    "No missing effect is detectable, but the model leaves more than its numerical error in the views and frames it "
    "was fitted to: the reconstruction or a camera is in doubt."
)
DOUBT_SHAPE = "No missing effect is detectable, but the residual looks like an error of the reconstructed shape."
UNKNOWN = "Something is missing, but none of the known effects explains it."
UNFINISHED = "The diagnosis is not finished: no effect has been fitted yet."
GOES_ON = "The diagnosis is not finished: the same command goes on with it, and may still change the verdict."
REMAINDER = (
    "The held-out views and frames still differ from the model by more than its numerical error: a further effect, or "
    "an error of the reconstruction."
)
NO_FORCE = (
    "In the fitted data the residual is no more than the model's numerical error, so it does not determine a missing "
    "force."
)
NAMES = {"KelvinVoigt": "Kelvin-Voigt viscosity"}
RESEMBLES = 0.5
"""Share of a force that a law explains which the force is said to look like."""


def readable(name: str) -> str:
    """``LinearDrag`` as *linear drag*, ``CameraShift@3`` as *camera shift of view 3*."""
    kind, _, view = name.partition("@")
    words = NAMES.get(kind) or re.sub(r"(?<!^)(?=[A-Z])", " ", kind).lower()
    return f"{words} of {view_name(int(view))}" if view else words


def listed(words: Sequence[str], last: str = "or") -> str:
    """``a, b or c``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


def either(names: Sequence[str]) -> str:
    """Effects that are indistinguishable, as a choice."""
    return listed([readable(name) for name in names])


def together(names: Sequence[str]) -> str:
    """Effects that belong together."""
    return listed([readable(name) for name in names], "and")


def unstable(name: str, inside: bool, why: str) -> str:
    """Why an effect was not added to the model, or, where it is ``inside``, not removed from it."""
    begun = (
        "may not be needed, but the model without it" if inside else "explains what is missing, but the model with it"
    )
    remedy = "a larger physics.substep_rate may mend that"
    return f"{capitalised(readable(name))} {begun} is unstable on finer grids and was not examined ({why}); {remedy}."


def unconfirmed(name: str) -> str:
    """Why an effect that was added was taken back."""
    return (
        f"{capitalised(readable(name))} seemed to be missing. But once it was learnt what a model with it may get "
        "wrong, the model without it explained the recording as well; it was taken back."
    )


def probability(p: float) -> str:
    """A p-value as a person reads it."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


def between(interval: tuple[float, float], unit: str) -> str:
    """An interval with its unit."""
    return f"[{quantity(interval[0], unit)}, {quantity(interval[1], unit)}]"


def capitalised(sentence: str) -> str:
    """With a capital letter at its beginning, and the others as they are."""
    return sentence[:1].upper() + sentence[1:]


def verdict(
    material: Material, rounds: list[Round], said: Verdict, intervals: Mapping[str, tuple[float, float]]
) -> list[str]:
    """The verdict on a diagnosis of a model with this material, then what else is to be said; ``intervals`` of
    the last model's values by name [SI].
    """
    last = rounds[-1]
    if said.kind == "unfinished":
        return [UNFINISHED]
    if said.kind == "nothing":
        found = [doubt(last) or NOTHING]
    elif said.kind == "unknown":
        found = [UNKNOWN, *_nearest(rounds, said)]
    else:
        found = [*_named(material, rounds, said, intervals), *([REMAINDER] if leaves_more(last) else [])]
    found += _removed(rounds)
    if last.force is not None:
        determined = force_is_determined(last, said)
        found += force(last.force.explained, last.force.law) if determined else [NO_FORCE]
    return [*found, *(last.accepted or last.best).notes]


def doubt(last: Round) -> str | None:
    """Why the reconstruction is in doubt where no effect was found; None where it is not."""
    if leaves_more(last):
        return DOUBT_HELD
    if last.check.p_value < LEVEL:
        return DOUBT_FITTED
    shape = last.screening and last.screening.score(SHAPE)
    if last.screening and shape and last.screening.p_value(shape.log_bayes_factor) < LEVEL:
        return DOUBT_SHAPE
    return None


def force_is_determined(last: Round, said: Verdict) -> bool:
    """Whether the fitted data, from which a residual force is estimated, leave more than noise."""
    return said.kind == "unknown" or last.check.p_value < LEVEL


def _nearest(rounds: list[Round], said: Verdict) -> list[str]:
    if not said.names:
        return []
    names, several = together(said.names), len(said.names) > 1
    causes, share = f"The nearest known cause{'s' * several}, {names},", said.removed or 0.0
    return [f"{causes} remove{'' if several else 's'} {_share(share, rounds[0])}."]


def _named(
    material: Material, rounds: list[Round], said: Verdict, intervals: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Every effect that was found: its name, how sure it is, and what it changes."""
    found: list[str] = []
    for done, after in zip(rounds, [*rounds[1:], None], strict=True):
        again = done.accepted
        if again is None or again.name not in said.names:
            continue
        candidate, also = done.candidate(again.name), "also " if found else ""
        named = either(done.indistinguishable or [again.name])
        what = f"{named}: a camera is wrong" if candidate.observes else f"{named} is {also}missing"
        removes = "" if after is None else f"; adding it removes {_share(removed_share(done, after), done)}"
        found.append(f"{capitalised(what)} ({probability(again.p_value)}{removes}).")
        sizes = [
            f"{one.label} {quantity(i.value, one.unit)} {between(intervals[i.name], one.unit)}"
            for i in rounds[-1].parameters
            if (one := candidate.effect.parameters.get(i.name))
        ]
        given = signature(type(candidate.effect)).parameters.keys() & candidate.effect.constants.keys()
        known = "".join(f", {name} {candidate.effect.constants[name]:g} as given" for name in sorted(given))
        found += [f"{capitalised('; '.join(sizes))} (90 % interval{'s' * (len(sizes) > 1)}{known})."] if sizes else []
        values = again.known if after is None else {i.name: i.value for i in after.parameters}
        moves = []
        for i in (i for i in done.parameters if i.name in material.free_names):
            one = material.parameters[i.name]
            old, new = quantity(i.value, one.unit), quantity(values[i.name], one.unit)
            ends = f" {between(intervals[i.name], one.unit)}" if after is rounds[-1] else ""
            if old != new:
                moves.append(f"{one.label} moves from {old} to {new}{ends}")
        found += [f"{capitalised('; '.join(moves))}."] if moves else []
        others = [name for name in done.indistinguishable if name != again.name]
        advice = done.proposals[0].words if done.proposals else candidate.effect.separating_experiment
        if others and advice:
            found.append(f"To separate {readable(again.name)} from {either(others)}: {advice}.")
    return found


def _share(share: float, before: Round) -> str:
    """How much of the excess error is removed, and in which data."""
    where = "held-out" if shows_held_out(before) else "fitted"
    return f"{'none' if share <= 0 else f'{share:.0%}'} of the {where} error beyond noise"


def _removed(rounds: list[Round]) -> list[str]:
    """Effects that were found at first and left out again, with what took their place."""
    found, names = [], []
    for done in rounds:
        if done.removed and done.accepted is not None:
            gone, better = together(done.removed), readable(done.accepted.name)
            found.append(f"{capitalised(gone)}, found at first, gives way to {better} beside the others.")
        else:
            names += done.removed
    if names:
        now, then = ("is", "was") if len(names) == 1 else ("are", "were")
        needed = f"{now} not needed with the others in the model, and {then} removed"
        found.append(f"{capitalised(together(names))}, found at first, {needed}.")
    return found


def force(explained: float, law: Law) -> list[str]:
    """About the smooth force that would remove a share ``explained`` of the fitted data's excess error, and the law
    that it looks like.
    """
    found = [f"A smooth force on the body would remove {explained:.0%} of the excess error in the fitted data."]
    terms = ", ".join(f"{term.coefficient:.3g} {term.unit} times ({term.name})" for term in law.terms)
    if law.terms and law.explained >= RESEMBLES:
        found.append(f"It looks like {terms}, which explains {law.explained:.0%} of that force.")
    elif law.terms:
        found.append(f"No simple law describes that force; the nearest, {terms}, explains {law.explained:.0%} of it.")
    else:
        found.append("No simple law describes that force: it follows neither position nor velocity.")
    return found
