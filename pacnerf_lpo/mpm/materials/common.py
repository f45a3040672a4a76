"""Parameters that several materials share."""

from pacnerf_lpo.mpm.parameters import Log10, Parameter, Saturated

YOUNG = Parameter("E", "Pa", Log10(), (0.0, 1e12), "Young's modulus", impact=30.0)
POISSON = Parameter(
    "nu", "1", Saturated(), (-0.45, 0.45), "Poisson's ratio", scale=0.05, prior_value=(0.35, 0.1), rate=0.01
)
"""Usual are soft solids, from foams (0.2) to gels and rubber (0.5)."""
SHEAR = Parameter("mu", "Pa", Log10(), (0.0, 1e12), "shear modulus", impact=10.0)
BULK = Parameter("kappa", "Pa", Log10(), (0.0, 1e12), "bulk modulus", impact=30.0)
YIELD = Parameter("tau_y", "Pa", Log10(), (0.0, 1e12), "yield stress", impact=0.2)
