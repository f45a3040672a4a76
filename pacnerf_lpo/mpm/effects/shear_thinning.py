"""Fluids that flow the easier the faster they are sheared."""

from types import SimpleNamespace

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.differentiation import exp, log
from pacnerf_lpo.mpm.effects.base import LawEffect
from pacnerf_lpo.mpm.materials.newtonian import Newtonian
from pacnerf_lpo.mpm.materials.viscoplastic_von_mises import ViscoplasticVonMises
from pacnerf_lpo.mpm.parameters import Identity, Parameter, named
from pacnerf_lpo.mpm.point import Law, Point
from pacnerf_lpo.mpm.tensors import contraction, deviator, symmetric


class ShearThinning(LawEffect):
    """The viscosity of a fluid (mu), or the plastic viscosity of a paste (eta), times (1 + (g / g0)^2)^((n - 1) / 2),
    with the shear rate g = sqrt(2 dev D : dev D) (Carreau 1972). Far above the onset g0 it is a power law with the
    material's viscosity as its value at g0; below, the viscosity stays as it is.

    Args:
        power_index: n [1]; below 1 thinning, above 1 thickening.
        onset_rate: g0 [1/s].
    Raises:
        UserInputError: onset rate not positive.
    """

    parameters = named(Parameter("power_index", "1", Identity(), (-0.5, 3.0), "power-law index"))
    null = {"power_index": 1.0}  # noqa: RUF012
    signature = "a fast spread on impact, then an early arrest"
    confused_with = ("GroundFriction", "YieldStress")
    separating_experiment = "drops from two heights: a power law changes its effective viscosity, a friction does not"
    materials = (Newtonian, ViscoplasticVonMises)
    unsuited = "has no viscosity that could thin; it needs Newtonian or ViscoplasticVonMises"
    probes = ({"power_index": 0.7}, {"power_index": 0.4}, {"power_index": 1.3})

    def __init__(self, power_index: float = 1.0, onset_rate: float = 1.0):
        if not onset_rate > 0:
            raise UserInputError(f"ShearThinning: onset_rate = {onset_rate:g} 1/s; give a positive rate")
        self.onset_rate = onset_rate
        super().__init__({"power_index": power_index}, {"onset_rate": onset_rate})

    @staticmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        rate = deviator(symmetric(point.C))
        squared = 2.0 * contraction(rate, rate) / (c.onset_rate * c.onset_rate)
        factor = exp(0.5 * (c.power_index - 1.0) * log(1.0 + squared))
        name = "eta" if hasattr(c, "eta") else "mu"
        return inner(point, SimpleNamespace(**{**vars(c), name: factor * getattr(c, name)}))
