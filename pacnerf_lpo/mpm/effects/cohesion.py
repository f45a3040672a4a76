"""Sand that sticks together: damp grains, powders."""

import math
from dataclasses import replace
from types import SimpleNamespace

from pacnerf_lpo.mpm.differentiation import exp, sqrt
from pacnerf_lpo.mpm.effects.base import LawEffect
from pacnerf_lpo.mpm.materials.drucker_prager import DruckerPrager
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Law, Point
from pacnerf_lpo.mpm.tensors import add_isotropic, scaled


class Cohesion(LawEffect):
    """The Drucker-Prager cone moved by the tension p = C / tan(theta) that it bears, theta the friction angle:
    Mohr-Coulomb's tau = C + sigma tan(theta) in triaxial compression.

    As Hencky stress is linear in the logarithmic strain, the law at F exp(-s), s = p / (3 K), with p added to its
    stress, is the law whose cone is moved, and nothing else changes. Like a modulus, C is multiplied by the particle's
    stiffness factor.

    Args:
        cohesion: C [Pa].
    """

    parameters = named(Parameter("cohesion", "Pa", Identity(), (-1e-3, 1e7), "cohesion", scale=50.0))
    signature = "the heap keeps clumps and steep edges"
    confused_with = ("SurfaceTension",)
    separating_experiment = "two heaps of different size: cohesion holds a small one at any slope, friction does not"
    materials = (DruckerPrager,)
    unsuited = "has no friction cone to move; it needs DruckerPrager"
    one_sided = True
    probes = ({"cohesion": 50.0}, {"cohesion": 500.0})

    @staticmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        sine = 3.0 * c.alpha / (2.0 * math.sqrt(2 / 3) + c.alpha)
        tension = c.cohesion * sqrt(1.0 - sine * sine) / sine
        shift = tension / (3.0 * c.lam + 2.0 * c.mu)
        F, tau = inner(replace(point, F=scaled(point.F, exp(-shift))), c)
        return scaled(F, exp(shift)), add_isotropic(tau, point.stiffness * tension)
