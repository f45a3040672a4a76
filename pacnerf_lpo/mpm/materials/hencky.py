"""What the plastic laws share."""

from typing import Any

from pacnerf_lpo.mpm.differentiation import where


def kept_share(norm: Any, excess: Any) -> Any:
    """Share of a deviator that stays when its norm shrinks by ``excess``; 1 for a deviator of 0."""
    return 1.0 - excess / where(norm > 0.0, norm, 1.0)
