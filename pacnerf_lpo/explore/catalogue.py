"""Everything that can be changed: numbers of the model, and the effects it has or could have."""

from collections.abc import Mapping, Sequence
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
from pacnerf_lpo.explore.records import EffectInfo, Setting
from pacnerf_lpo.identification.forward_model import VELOCITY
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import OF, Log10, Parameter, own_name
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.report.wording import readable

REACH = 15.0
"""Noticeable changes to either side of a number, see ``Parameter.scale``: of a modulus or viscosity a factor of thirty,
three times what people guess wrong.
"""
PROBES = 2.0
"""A coefficient is looked for up to twice the largest size at which a diagnosis tries it."""


class Catalogue:
    """The numbers and effects of a problem.

    Sliders lie around ``base``, the values of the first step [SI]; ``listed`` is a YAML list of effects of one's own.

    Raises:
        UserInputError: the list cannot be read.
    """

    def __init__(self, problem: Problem, base: Mapping[str, float], listed: str | None = None):
        self.problem, self.base = problem, dict(base)
        material = problem.physics.material
        self.installed = {name_of(effect): effect for effect in problem.physics.effects}
        self.declared: list[dict[str, Any]] = []
        self.effects: dict[str, Effect] = dict(self.installed)
        found = whole_catalogue(material, problem.video.view_ids, ())
        if listed is not None:
            found = [*read_candidates(Path(listed), material, ()), *found]
        for candidate in found:
            self._take(candidate)
        self.parameters = self._described()

    def _take(self, candidate: Candidate) -> None:
        taken = {name for effect in self.effects.values() for name in effect.parameters}
        adopted = self.problem.adopt(candidate.effect)
        if candidate.name not in self.effects and not taken & set(adopted.parameters):
            self.effects[candidate.name] = adopted

    def _described(self) -> dict[str, Parameter]:
        """Parameters of material, motion and ground by name."""
        problem = self.problem
        model = problem.model(problem.physics.effects, self.base)
        found = {unknown.name: unknown for unknown in model.unknowns}
        if problem.deforms:
            for name in self.base:
                own, _, recording = name.partition(OF)
                known = problem.physics.parameters.get(own)
                if name not in found and known is not None:
                    found[name] = known.of_recording(recording) if recording else known
        coefficients = {name for effect in self.effects.values() for name in effect.parameters}
        self.free = {unknown.name for unknown in model.unknowns} | coefficients
        return {name: parameter for name, parameter in found.items() if name not in coefficients}

    def declare(self, entry: str | dict[str, Any]) -> str:
        """Take an effect of one's own into the catalogue; returns its name.

        Args:
            entry: its class path, such as ``lorentz.Lorentz``, or an entry of ``physics.effects``.

        Raises:
            UserInputError: no such class, or it does not apply to the material.
        """
        given = entry if isinstance(entry, dict) else {"class_path": entry}
        effect = read_effects(Path("explore"), [given])[0]
        effect.check_material(self.problem.physics.material)
        found = Candidate(name_of(effect), effect)
        config = as_config(effect, effect.guess)
        if found.name not in self.effects:
            self._take(found)
            if found.name not in self.effects:
                raise UserInputError(f"explore: {found.name} has a coefficient that an effect of the catalogue has too")
            self.declared.append(config)
            self.free |= set(self.effects[found.name].parameters)
        return found.name

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

    def owner(self, name: str) -> str | None:
        """The effect that a number belongs to; None: to the material, the motion or the ground.

        Raises:
            UserInputError: there is no such number.
        """
        if name in self.parameters:
            return None
        found = next((own for own, effect in self.effects.items() if name in effect.parameters), None)
        if found is None:
            everything = [*self.parameters, *(n for effect in self.effects.values() for n in effect.parameters)]
            near = get_close_matches(name, everything, 1, 0.0)
            raise UserInputError(f"explore: there is no setting {name}; did you mean {near[0]}?")
        return found

    def check(self, name: str, value: float) -> float:
        """A value that may be set [SI]. Raises UserInputError."""
        owner = self.owner(name)
        effect = None if owner is None else self.effects[owner]
        parameter = self.parameters[name] if effect is None else effect.parameters[name]
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

    def settings(
        self, values: Mapping[str, float], active: Sequence[str], intervals: Mapping[str, tuple[float, float]]
    ) -> list[Setting]:
        """All numbers, with those of a step."""
        found = [
            self._setting(name, parameter, None, values, True, intervals) for name, parameter in self.parameters.items()
        ]
        for own, effect in self.effects.items():
            for name, parameter in effect.parameters.items():
                found.append(self._setting(name, parameter, own, values, own in active, intervals))
        return found

    def _setting(
        self,
        name: str,
        parameter: Parameter,
        owner: str | None,
        values: Mapping[str, float],
        active: bool,
        intervals: Mapping[str, tuple[float, float]],
    ) -> Setting:
        effect = None if owner is None else self.effects[owner]
        null = None if effect is None else effect.null[name]
        value = values.get(name, null if null is not None else 0.0)
        side = parameter.bounds if effect is None else effect.side(name)
        low, high = max(parameter.bounds[0], side[0]), min(parameter.bounds[1], side[1])
        slider = _reach(parameter, self.base.get(name, value)) if effect is None else _probed(effect, name, parameter)
        seen = [value] if null is None or value != null else []
        slider = max(low, min(slider[0], *seen, slider[0])), min(high, max(slider[1], *seen, slider[1]))
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
            intervals.get(name),
            active,
            name in self.free,
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

    def show(self, name: str, value: float) -> str:
        """A number with its unit."""
        owner = self.owner(name)
        parameter = self.parameters[name] if owner is None else self.effects[owner].parameters[name]
        return parameter.show(value)


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
