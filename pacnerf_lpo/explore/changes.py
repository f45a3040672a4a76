"""The steps that changes make of a step, before they are simulated."""

from collections.abc import Mapping, Sequence

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore.catalogue import Catalogue
from pacnerf_lpo.explore.records import Step


def with_values(catalogue: Catalogue, step: Step, values: Mapping[str, float]) -> Step:
    """With other values, which were checked [SI]; a coefficient of an effect that the model has not adds it, unless the
    value is that at which it vanishes.

    Raises:
        UserInputError: an effect that does not suit the others.
    """
    owners = {name: catalogue.owner(name) for name in values}
    added = [
        own
        for name, own in owners.items()
        if own and own not in step.effects and values[name] != catalogue.effects[own].null[name]
    ]
    effects = joined(catalogue, step.effects, list(dict.fromkeys(added)))
    given = {name: value for name, value in values.items() if owners[name] is None or owners[name] in effects}
    title = ", ".join(f"{_called(catalogue, name)} {catalogue.show(name, value)}" for name, value in values.items())
    known = {**step.values, **_nulls(catalogue, added), **given}
    return Step(0, step.number, title, "set", known, effects, step.intervals)


def with_effect(catalogue: Catalogue, step: Step, effect: str, values: Mapping[str, float]) -> Step:
    """With one more effect, at checked values [SI]. Raises UserInputError where it does not suit the others."""
    if effect in step.effects:
        raise UserInputError(f"explore: the model has {effect} already; change its settings instead")
    effects = joined(catalogue, step.effects, [effect])
    shown = ", ".join(catalogue.show(name, value) for name, value in values.items())
    known = {**step.values, **_nulls(catalogue, [effect]), **values}
    return Step(0, step.number, f"+ {effect} {shown}".rstrip(), "add", known, effects, step.intervals)


def without_effect(catalogue: Catalogue, step: Step, effect: str) -> Step:
    """Without an effect. Raises UserInputError where the model has it not."""
    own = catalogue.effect(effect).parameters
    if effect not in step.effects:
        raise UserInputError(f"explore: the model has no {effect}; it has {', '.join(step.effects) or 'none'}")
    kept = tuple(name for name in step.effects if name != effect)
    values = {name: value for name, value in step.values.items() if name not in own}
    intervals = {name: ends for name, ends in step.intervals.items() if name not in own}
    return Step(0, step.number, f"- {effect}", "remove", values, kept, intervals)


def joined(catalogue: Catalogue, effects: Sequence[str], more: Sequence[str]) -> tuple[str, ...]:
    """Effects of a model with some more. Raises UserInputError where they do not suit each other."""
    found = tuple(effects)
    for name in more:
        if name not in {candidate.name for candidate in catalogue.candidates(found)}:
            raise UserInputError(f"explore: {name} cannot be added to a model with {' and '.join(found) or 'none'}")
        found = (*found, name)
    return found


def _nulls(catalogue: Catalogue, effects: Sequence[str]) -> dict[str, float]:
    return {name: null for own in effects for name, null in catalogue.effects[own].null.items()}


def _called(catalogue: Catalogue, name: str) -> str:
    """A setting in the name of a step: by its effect where that has one coefficient."""
    owner = catalogue.owner(name)
    alone = owner is not None and len(catalogue.effects[owner].parameters) == 1
    return owner if alone and owner is not None else name
