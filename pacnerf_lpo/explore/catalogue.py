"""Everything that can be changed, numbers of the model and its effects, and the steps that changes make of a step."""

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from pacnerf_lpo.diagnosis.catalogue import (
    Candidate,
    as_config,
    candidates,
    name_of,
    read_candidates,
    read_effects,
    whole_catalogue,
)
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.explore.records import EffectInfo, Kind, Setting, Step
from pacnerf_lpo.identification.forward_model import VELOCITY
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import OF, Log10, Parameter, named, own_name
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.report.wording import readable

REACH = 15.0
"""Noticeable changes to either side of a number, see ``Parameter.scale``: of a modulus or viscosity a factor of thirty,
three times what people guess wrong.
"""
PROBES = 2.0
"""A coefficient is looked for up to twice the largest size at which a diagnosis tries it."""


class Catalogue:
    """The numbers and effects of a problem; ``listed`` is a YAML list of effects of one's own. Raises UserInputError
    where the list cannot be read.
    """

    def __init__(self, problem: Problem, listed: str | None):
        self.problem, self.base = problem, problem.first_guess
        material = problem.physics.material
        self.effects: dict[str, Effect] = {name_of(effect): effect for effect in problem.physics.effects}
        self.installed = tuple(self.effects)
        self.declared: list[dict[str, Any]] = []
        found = whole_catalogue(material, problem.video.view_ids, ())
        if listed is not None:
            found = [*read_candidates(Path(listed), material, ()), *found]
        for candidate in found:
            self._take(candidate.effect)
        self.parameters = self._described()

    def _take(self, effect: Effect) -> bool:
        """Take an effect in where its name and its coefficients are new; whether they are."""
        taken = {name for known in self.effects.values() for name in known.parameters}
        adopted = self.problem.adopt(effect)
        new = name_of(effect) not in self.effects and taken.isdisjoint(adopted.parameters)
        if new:
            self.effects[name_of(effect)] = adopted
        return new

    def _described(self) -> dict[str, Parameter]:
        """Parameters of material, motion and ground by name."""
        problem = self.problem
        model = problem.model(problem.physics.effects, self.base)
        found = named(*model.unknowns)
        self.free = set(found)
        if problem.deforms:
            for name in self.base:
                own, _, recording = name.partition(OF)
                known = problem.physics.parameters.get(own)
                if name not in found and known is not None:
                    found[name] = known.of_recording(recording) if recording else known
        coefficients = {name for effect in self.effects.values() for name in effect.parameters}
        return {name: parameter for name, parameter in found.items() if name not in coefficients}

    def declare(self, entry: str | dict[str, Any]) -> str:
        """Take an effect of one's own into the catalogue, by its class path, such as ``lorentz.Lorentz``, or as an
        entry of ``physics.effects``; returns its name. Raises UserInputError where there is no such class, or it does
        not apply to the material.
        """
        given = entry if isinstance(entry, dict) else {"class_path": entry}
        effect = read_effects(Path("explore"), [given])[0]
        effect.check_material(self.problem.physics.material)
        name = name_of(effect)
        if name not in self.effects:
            if not self._take(effect):
                raise UserInputError(f"explore: {name} has a coefficient that an effect of the catalogue has too")
            self.declared.append(as_config(effect, effect.guess))
        return name

    def effect(self, name: str) -> Effect:
        """By its name. Raises UserInputError."""
        if name not in self.effects:
            near = get_close_matches(name, self.effects, 1, 0.0)
            raise UserInputError(f"explore: there is no effect {name}; did you mean {near[0]}?")
        return self.effects[name]

    def chosen(self, names: Sequence[str]) -> tuple[Effect, ...]:
        """Effects of a model by their names."""
        return tuple(self.effects[name] for name in names)

    def candidates(self, taken: Sequence[str]) -> list[Candidate]:
        """Effects that may be added to a model with some already."""
        rest = [effect for name, effect in self.effects.items() if name not in taken]
        return candidates(rest, self.problem.physics.material, self.chosen(taken))

    @property
    def numbers(self) -> dict[str, tuple[str | None, Parameter]]:
        """Every number with the effect that it belongs to, None for one of material, motion or ground."""
        of_effects = [(own, one) for own, effect in self.effects.items() for one in effect.parameters.values()]
        return {one.name: (own, one) for own, one in [*((None, one) for one in self.parameters.values()), *of_effects]}

    def owner(self, name: str) -> str | None:
        """The effect that a number belongs to; None: to the material, the motion or the ground. Raises UserInputError
        where there is no such number.
        """
        if name not in self.numbers:
            near = get_close_matches(name, self.numbers, 1, 0.0)
            raise UserInputError(f"explore: there is no setting {name}; did you mean {near[0]}?")
        return self.numbers[name][0]

    def check(self, name: str, value: float) -> float:
        """A value that may be set [SI]. Raises UserInputError."""
        owner = self.owner(name)
        effect = None if owner is None else self.effects[owner]
        parameter = self.numbers[name][1]
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            raise UserInputError(f"explore: {name} = {value!r}; give a number")
        value = float(value)
        if effect is not None and value == effect.null[name]:
            return value
        parameter.check(value, "explore")
        if effect is not None and not effect.side(name)[0] <= value <= effect.side(name)[1]:
            raise UserInputError(
                f"explore: {name} = {parameter.show(value)} lies beyond {parameter.show(effect.null[name])}, "
                f"where {owner} vanishes; give a value on its other side"
            )
        return value

    def settings(self, step: Step) -> list[Setting]:
        """All numbers, with those of a step."""
        return [self._setting(step, owner, one) for owner, one in self.numbers.values()]

    def _setting(self, step: Step, owner: str | None, parameter: Parameter) -> Setting:
        name = parameter.name
        effect = None if owner is None else self.effects[owner]
        null = None if effect is None else effect.null[name]
        value = step.values.get(name, null if null is not None else 0.0)
        side = parameter.bounds if effect is None else effect.side(name)
        low, high = max(parameter.bounds[0], side[0]), min(parameter.bounds[1], side[1])
        slider = _reach(parameter, self.base.get(name, value)) if effect is None else _probed(effect, name, parameter)
        seen = slider if value == null else (*slider, value)
        slider = max(low, min(seen)), min(high, max(seen))
        return Setting(
            name,
            parameter.label,
            parameter.unit,
            owner or _group(own_name(name)),
            value,
            null,
            low,
            high,
            slider,
            isinstance(parameter.transform, Log10),
            step.intervals.get(name),
            owner is None or owner in step.effects,
            owner is not None or name in self.free,
            name.partition(OF)[2] or None,
        )

    def infos(self, active: Sequence[str]) -> list[EffectInfo]:
        """All effects."""
        return [
            EffectInfo(
                name,
                readable(name),
                tuple(effect.parameters),
                effect.signature,
                effect.confused_with,
                name in active,
                getattr(effect, "view", None),
            )
            for name, effect in self.effects.items()
        ]


def _group(name: str) -> str:
    if name == GROUND_HEIGHT.name:
        return "ground"
    return "motion" if name in {p.name for p in VELOCITY} or name.endswith("_0") or name == "release" else "material"


def _reach(parameter: Parameter, value: float) -> tuple[float, float]:
    """Where a number of material, motion or ground is looked for around its first value."""
    free, reach = parameter.transform.to_free(value), REACH * parameter.scale
    return parameter.physical(free - reach), parameter.physical(free + reach)


def _probed(effect: Effect, name: str, parameter: Parameter) -> tuple[float, float]:
    """Where a coefficient is looked for, by the sizes at which a diagnosis tries it."""
    null, tried = effect.null[name], [probe[name] for probe in effect.probes]
    if effect.null_is_far(name) or isinstance(parameter.transform, Log10):
        return min(tried) / PROBES, max(tried) * PROBES
    far = PROBES * max((abs(value - null) for value in tried), default=REACH * parameter.scale)
    return null - far, null + far


def with_values(catalogue: Catalogue, step: Step, values: Mapping[str, float]) -> Step:
    """With other values, which were checked [SI]; a coefficient of an effect that the model has not adds it, unless the
    value is that at which it vanishes. Raises UserInputError for an effect that does not suit the others.
    """
    owners = {name: catalogue.owner(name) for name in values}
    nulls = _nulls(catalogue, catalogue.effects)
    added = [own for name, own in owners.items() if own and own not in step.effects and values[name] != nulls[name]]
    given = {name: value for name, value in values.items() if owners[name] in (None, *step.effects, *added)}
    numbers, effects = catalogue.numbers, catalogue.effects
    # a coefficient is called by its effect where that has no other
    called = {name: own if own and len(effects[own].parameters) == 1 else name for name, own in owners.items()}
    title = ", ".join(f"{called[name]} {numbers[name][1].show(value)}" for name, value in values.items())
    return _joined(catalogue, step, list(dict.fromkeys(added)), given, title, "set")


def with_effect(catalogue: Catalogue, step: Step, effect: str, values: Mapping[str, float]) -> Step:
    """With one more effect, at checked values [SI]. Raises UserInputError where it does not suit the others."""
    if effect in step.effects:
        raise UserInputError(f"explore: the model has {effect} already; change its settings instead")
    shown = ", ".join(catalogue.effects[effect].parameters[name].show(value) for name, value in values.items())
    return _joined(catalogue, step, [effect], values, f"+ {effect} {shown}".rstrip(), "add")


def without_effect(catalogue: Catalogue, step: Step, effect: str) -> Step:
    """Without an effect. Raises UserInputError where the model has it not."""
    own = catalogue.effect(effect).parameters
    if effect not in step.effects:
        raise UserInputError(f"explore: the model has no {effect}; it has {', '.join(step.effects) or 'none'}")
    kept = tuple(name for name in step.effects if name != effect)
    values = {name: value for name, value in step.values.items() if name not in own}
    intervals = {name: ends for name, ends in step.intervals.items() if name not in own}
    return Step(0, step.number, f"- {effect}", "remove", values, kept, intervals)


def _joined(
    catalogue: Catalogue, step: Step, more: Sequence[str], values: Mapping[str, float], title: str, kind: Kind
) -> Step:
    """With more effects, and other values. Raises UserInputError where the effects do not suit each other."""
    effects = step.effects
    for name in more:
        if name not in {candidate.name for candidate in catalogue.candidates(effects)}:
            raise UserInputError(f"explore: {name} cannot be added to a model with {' and '.join(effects) or 'none'}")
        effects = (*effects, name)
    known = {**step.values, **_nulls(catalogue, more), **values}
    return Step(0, step.number, title, kind, known, effects, step.intervals)


def _nulls(catalogue: Catalogue, effects: Iterable[str]) -> dict[str, float]:
    return {name: null for own in effects for name, null in catalogue.effects[own].null.items()}
