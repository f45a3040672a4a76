"""Whether material, ground and effects make one model, and the local laws that follow from them."""

# mypy: disable-error-code="type-abstract"

from collections.abc import Sequence
from typing import TypeVar

import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.effects.base import BodyForce, Effect, GroundEffect, InitialState, LawEffect, Softening
from pacnerf_lpo.mpm.ground import Ground, Sticky
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.point import LocalLaws

E = TypeVar("E", bound=Effect)


def of_kind(effects: Sequence[Effect], kind: type[E]) -> list[E]:
    """The effects of a kind, in order."""
    return [effect for effect in effects if isinstance(effect, kind)]


def check_model(where: str, material: Material, ground: Ground, effects: Sequence[Effect]) -> None:
    """Raise UserInputError when two of them use one name, two effects bring a ground, or one does not suit the
    material.
    """
    grounds = of_kind(effects, GroundEffect)
    if len(grounds) > 1:
        both = " and ".join(type(effect).__name__ for effect in grounds)
        raise UserInputError(f"{where}: the effects {both} each replace the ground; keep one")
    if grounds and not isinstance(ground, Sticky):
        raise UserInputError(
            f"{where}: the effect {type(grounds[0]).__name__} replaces a ground that is Sticky, but it is "
            f"{type(ground).__name__}; set ground to Sticky, or leave the effect out"
        )
    for effect in effects:
        effect.check_material(material)
    own = [*{**material.parameters, **dict.fromkeys(_coefficients(material))}]
    names = [*own, *ground.parameters, *(name for e in effects for name in (*e.parameters, *e.constants))]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UserInputError(f"{where}: material, ground and effects have two parameters {twice[0]!r}; keep one")


def local_laws(material: Material, ground: Ground, effects: Sequence[Effect]) -> tuple[LocalLaws, dict[str, float]]:
    """What the kernels of a checked model are compiled from, and the coefficients that follow those of the material."""
    grounds = of_kind(effects, GroundEffect)
    inside = [effect for effect in effects if effect.acts_on_motion and not isinstance(effect, InitialState)]
    own = {} if grounds else ground.guess
    values = {**own, **{k: v for effect in inside for k, v in (*effect.guess.items(), *effect.constants.items())}}
    laws = LocalLaws(
        material.law,
        tuple(effect.acceleration for effect in of_kind(effects, BodyForce)),
        grounds[0].velocity if grounds else ground.velocity,
        (*_coefficients(material), *values),
        tuple((effect.law, effect.history) for effect in of_kind(effects, LawEffect)),
        tuple(effect.factor for effect in of_kind(effects, Softening)),
    )
    return laws, values


def _coefficients(material: Material) -> dict[str, torch.Tensor]:
    return material.coefficients({name: torch.tensor(value) for name, value in material.guess.items()})
