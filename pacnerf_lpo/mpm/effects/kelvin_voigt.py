"""Solids that damp their own deformation."""

from types import SimpleNamespace

from pacnerf_lpo.mpm.effects.base import LawEffect
from pacnerf_lpo.mpm.materials.newtonian import Newtonian
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Law, Point
from pacnerf_lpo.mpm.tensors import added, determinant, deviator, scaled, symmetric


class KelvinVoigt(LawEffect):
    """A dashpot parallel to the material: tau += 2 eta J dev(sym grad v), eta times the particle's stiffness factor.

    Explicit time steps bear it while eta < rho dx^2 / (4 dt), about.

    Args:
        solid_viscosity: eta [Pa s].
    """

    parameters = named(Parameter("solid_viscosity", "Pa s", Identity(), (-1e3, 1e6), "viscosity of the solid", 1.0))
    signature = "a lower rebound, and a ringing that dies sooner"
    confused_with = ("LinearDrag", "Adhesion", "ThermalSoftening")
    separating_experiment = "the free ringing of the body after it is plucked, without any flight or contact"
    excluded = (Newtonian,)
    unsuited = "has this viscosity already, mu; leave the effect out"
    one_sided = True
    probes = ({"solid_viscosity": 5.0}, {"solid_viscosity": 50.0}, {"solid_viscosity": 500.0})
    reach = 2.0
    """The motion is no straight line in the viscosity: it is tried up to a sixth of the critical one, sqrt(E rho) L, of
    a body of 100 kPa, 1000 kg/m^3 and 0.3 m, and explicit steps bear hardly more.
    """

    @staticmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        F, tau = inner(point, c)
        viscosity = point.stiffness * c.solid_viscosity
        rate = deviator(symmetric(point.C))
        return F, added(tau, scaled(rate, 2.0 * viscosity * determinant(point.F)))
