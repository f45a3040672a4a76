"""Physical effects beside material, ground and gravity, one per file."""

from pacnerf_lpo.mpm.effects.base import BodyForce, Effect, Observation
from pacnerf_lpo.mpm.effects.linear_drag import LinearDrag

__all__ = ["BodyForce", "Effect", "LinearDrag", "Observation"]
