"""What several materials share."""

from typing import Any

from pacnerf_lpo.mpm.differentiation import where
from pacnerf_lpo.mpm.parameters import Log10, Parameter, Saturated

YOUNG = Parameter("E", "Pa", Log10(), (0.0, 1e12), "Young's modulus", impact=30.0)
POISSON = Parameter(
    "nu", "1", Saturated(), (-0.45, 0.45), "Poisson's ratio", scale=0.05, prior_value=(0.35, 0.1), rate=0.01
)
"""Usual are soft solids, from foams (0.2) to gels and rubber (0.5)."""
SHEAR = Parameter("mu", "Pa", Log10(), (0.0, 1e12), "shear modulus", impact=10.0)
BULK = Parameter("kappa", "Pa", Log10(), (0.0, 1e12), "bulk modulus", impact=30.0)
YIELD = Parameter("tau_y", "Pa", Log10(), (0.0, 1e12), "yield stress", impact=0.2)


def kept_share(norm: Any, excess: Any) -> Any:
    """Share of a deviator that stays when its norm shrinks by ``excess``; 1 for a deviator of 0."""
    return 1.0 - excess / where(norm > 0.0, norm, 1.0)
