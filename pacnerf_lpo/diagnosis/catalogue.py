"""The effects that a diagnosis tries: all that the package knows, or those of a list."""

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jsonargparse import ArgumentError, ArgumentParser

from pacnerf_lpo.config_errors import explain, read_any_yaml
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import effects as known_effects
from pacnerf_lpo.mpm.effects.base import Effect, GroundEffect
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.parameters import own_name
from pacnerf_lpo.render import camera_faults
from pacnerf_lpo.render.camera_faults.base import Observation

PACKAGE = __name__.split(".")[0]
SPREADS = (0.05, 0.22, 1.0)
"""Prior standard deviations of the coefficients of an effect in units of the widest, equally probable: whether it is
as large as its farthest probe or twenty times larger, nobody knows before."""


@dataclass(frozen=True)
class Candidate:
    """An effect on trial.

    name: class name, with the file id of its camera where it concerns one: ``CameraShift@3``.
    effect: an instance at its null.
    quick: it is tried at the first of its probes alone, where one coefficient leads smoothly from its null.
    """

    name: str
    effect: Effect
    quick: bool = False

    @property
    def joint(self) -> bool:
        """Whether its coefficients are components that are estimated together, like a force along x and z."""
        return len(self.effect.parameters) > 1 and not self.effect.one_sided

    @property
    def discrete(self) -> bool:
        """Whether it is non-local: no small change of a coefficient leads from its null to it."""
        return self.effect.discrete

    @property
    def observes(self) -> bool:
        """Whether it is a fault of the cameras, and no physics."""
        return isinstance(self.effect, Observation)

    @property
    def view(self) -> int | None:
        """File id of the one camera that it concerns."""
        return getattr(self.effect, "view", None)

    @property
    def components(self) -> int:
        """How many trials one after the other are components that are estimated together."""
        return len(self.effect.parameters) if self.joint else 1

    def trials(self) -> list[dict[str, float]]:
        """Values at which the effect is tried [SI]: the probes of the class, or of each component alone its farthest
        one; every one where each probe is of all components, as that of an effect which every recording has for itself.
        """
        probes, null = list(self.effect.probes), self.effect.null
        if not self.joint:
            return probes[:1] if self.quick and not self.discrete and len(null) == 1 else probes
        if any(probe[name] == null[name] for probe in probes for name in null):
            probes = [{name: self._farthest(name) for name in null}]
        return [{**null, name: probe[name]} for probe in probes for name in null]

    @property
    def spreads(self) -> tuple[float, ...]:
        """Prior standard deviations of the coefficients in units of the widest; a non-local effect has only that."""
        return (1.0,) if self.discrete else SPREADS

    def width(self, name: str) -> float:
        """Widest prior standard deviation of one coefficient [its unit], by its largest probe."""
        return self.effect.reach * abs(self._farthest(name) - self.effect.null[name])

    def _farthest(self, name: str) -> float:
        """The probe of one coefficient that is farthest from its null."""
        null = self.effect.null[name]
        return null + max((probe[name] - null for probe in self.effect.probes), key=abs)


def whole_catalogue(material: Material, views: Sequence[int], installed: Sequence[Effect]) -> list[Candidate]:
    """Every effect of the package that applies to the material of a model and is not ``installed`` in it yet; camera
    faults view by view, by the file ids of the cameras. Of a rigid body in flight those of the medium around it: its
    gravity is known, and it touches nothing.
    """
    kinds = [kind for kind in known_classes() if material.deforms or kind.of_medium]
    made: list[Effect] = []
    for kind in kinds:
        made += [kind(view=view) for view in views] if issubclass(kind, Observation) else [kind()]  # type: ignore[call-arg]
    return candidates(made, material, installed)


def known_classes() -> list[type[Effect]]:
    """The effects and camera faults of the package, by name."""
    found = {**vars(known_effects), **vars(camera_faults)}
    return [kind for _, kind in sorted(found.items()) if isinstance(kind, type) and hasattr(kind, "parameters")]


def read_candidates(path: Path, material: Material, installed: Sequence[Effect]) -> list[Candidate]:
    """Candidates from a YAML list of ``class_path`` and ``init_args``, as in ``physics.effects``.

    Raises:
        UserInputError: no such file, not such a list, unknown classes, a class twice, effects that do not apply to the
            material, or of which no configuration can be written.
    """
    if not path.is_file():
        raise UserInputError(f"{path}: no such file; give a YAML list of effects, as physics.effects has it")
    found = read_effects(path, read_any_yaml(path))
    names = [name_of(effect) for effect in found]
    for name, effect in zip(names, found, strict=True):
        effect.check_material(material)
        as_config(effect, effect.guess)
        if names.count(name) > 1:
            raise UserInputError(
                f"{path}: {name} is listed {names.count(name)} times; results are told by the name of a class, so "
                f"write one for each, such as `class Other({name.partition('@')[0]})` with other defaults"
            )
    return candidates(found, material, installed)


def read_effects(path: Path, content: Any) -> list[Effect]:
    """Effects from entries of ``class_path`` and ``init_args`` that a file has. Raises UserInputError."""
    if not isinstance(content, list):
        raise UserInputError(f"{path}: not a list of effects; write for each of them a line `- class_path: NAME`")
    parser = ArgumentParser(exit_on_error=False)
    parser.add_argument("--effects", type=list[Effect])
    try:
        return parser.instantiate(parser.parse_object({"effects": content})).effects
    except (ArgumentError, ValueError, TypeError) as error:
        said = str(explain(error, parser, [path] if path.is_file() else []))
        raise UserInputError(said if said.startswith(str(path)) else f"{path}: {said}") from error


def candidates(effects: Sequence[Effect], material: Material, installed: Sequence[Effect]) -> list[Candidate]:
    """Those of the effects that may be added to a model."""
    taken = {own_name(name) for effect in installed for name in effect.parameters}
    grounded = any(isinstance(effect, GroundEffect) for effect in installed)
    free = [effect for effect in effects if not (grounded and isinstance(effect, GroundEffect))]
    suited = [effect for effect in free if not taken & set(effect.parameters) and effect.suits(material)]
    return [Candidate(name_of(effect), effect) for effect in suited]


def name_of(effect: Effect) -> str:
    """Class name and, where it concerns one camera, that camera's file id."""
    view = getattr(effect, "view", None)
    return type(effect).__name__ if view is None else f"{type(effect).__name__}@{view}"


def class_path(thing: object) -> str:
    """What a configuration calls the class of a thing: by its short name if it is the package's."""
    kind = type(thing)
    return kind.__name__ if kind.__module__.split(".")[0] == PACKAGE else f"{kind.__module__}.{kind.__name__}"


def as_config(effect: Effect, values: dict[str, float]) -> dict[str, Any]:
    """An effect with values of its coefficients as an entry of ``physics.effects``.

    Raises:
        UserInputError: an argument of the class is neither a coefficient nor kept, as a constant or as an attribute.
    """
    names = dict(zip(type(effect).parameters, effect.parameters, strict=True))
    arguments: dict[str, Any] = {own: float(f"{values[full]:.6g}") for own, full in names.items()}
    for name in (name for name in inspect.signature(type(effect)).parameters if name not in names):
        if name not in effect.constants and not hasattr(effect, name):
            raise UserInputError(
                f"{type(effect).__name__}: its argument {name} is no coefficient; keep it as self.{name}, so that a "
                "configuration can be written of the effect"
            )
        value = effect.constants[name] if name in effect.constants else getattr(effect, name)
        arguments |= {} if value is None else {name: list(value) if isinstance(value, tuple) else value}
    return {"class_path": class_path(effect), "init_args": arguments}
