"""Constitutive laws, one per file."""

from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.neo_hookean import NeoHookean
from pacnerf_lpo.mpm.materials.newtonian import Newtonian

__all__ = ["Material", "NeoHookean", "Newtonian"]
