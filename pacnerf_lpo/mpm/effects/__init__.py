"""Physical effects beside material, ground and gravity, one per file."""

from pacnerf_lpo.mpm.effects.base import (
    BodyForce,
    Effect,
    GroundEffect,
    InitialState,
    LawEffect,
    Observation,
    Softening,
)
from pacnerf_lpo.mpm.effects.linear_drag import LinearDrag

__all__ = [
    "BodyForce",
    "Effect",
    "GroundEffect",
    "InitialState",
    "LawEffect",
    "LinearDrag",
    "Observation",
    "Softening",
]
