"""Constitutive laws, one per file."""

from pacnerf_lpo.mpm.materials.auto import Auto
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.drucker_prager import DruckerPrager
from pacnerf_lpo.mpm.materials.neo_hookean import NeoHookean
from pacnerf_lpo.mpm.materials.newtonian import Newtonian
from pacnerf_lpo.mpm.materials.viscoplastic_von_mises import ViscoplasticVonMises
from pacnerf_lpo.mpm.materials.von_mises import VonMises

__all__ = ["Auto", "DruckerPrager", "Material", "NeoHookean", "Newtonian", "ViscoplasticVonMises", "VonMises"]
