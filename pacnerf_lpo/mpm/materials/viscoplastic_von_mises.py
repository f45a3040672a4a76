"""Creams and pastes: they yield, and flow the slower the more viscous."""

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

from torch import Tensor

from pacnerf_lpo.mpm.differentiation import exp, maximum
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.materials.common import BULK, SHEAR, YIELD, kept_share
from pacnerf_lpo.mpm.parameters import Log10, Parameter, named
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.principal import return_mapped
from pacnerf_lpo.mpm.tensors import Tensor3


class ViscoplasticVonMises(Material):
    """Von Mises yield with plastic viscosity: of the excess y over the yield stress, y / (1 + eta / (2 mu^ dt)) is
    removed per substep, mu^ = mu tr(b) / 3 (PAC-NeRF's non-Newtonian law, after Yue et al. 2015).

    Args:
        mu: shear modulus [Pa].
        kappa: bulk modulus [Pa].
        tau_y: yield stress [Pa].
        eta: plastic viscosity [Pa s].
        known: names of parameters that are not identified.
    """

    family = "viscoplastic"
    parameters = named(
        SHEAR, BULK, YIELD, Parameter("eta", "Pa s", Log10(), (0.0, 1e9), "plastic viscosity", impact=0.03, rate=0.05)
    )

    def __init__(
        self, mu: float = 1e3, kappa: float = 1e5, tau_y: float = 100.0, eta: float = 1.0, known: Sequence[str] = ()
    ):
        super().__init__({"mu": mu, "kappa": kappa, "tau_y": tau_y, "eta": eta}, known)

    @staticmethod
    def coefficients(p: Mapping[str, Tensor]) -> dict[str, Tensor]:
        return {"mu": p["mu"], "lam": p["kappa"] - 2 * p["mu"] / 3, "tau_y": p["tau_y"], "eta": p["eta"]}

    @staticmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        mu, lam = point.stiffness * c.mu, point.stiffness * c.lam
        largest = math.sqrt(2 / 3) * c.tau_y / (2.0 * mu)
        delay = 1.5 * c.eta / (mu * point.dt)

        def flow(e: list[Any], mean: Any, norm: Any) -> tuple[Any, Any]:
            trace_b = exp(2.0 * e[0]) + exp(2.0 * e[1]) + exp(2.0 * e[2])
            return kept_share(norm, maximum(norm - largest, 0.0) / (1.0 + delay / trace_b)), mean

        return return_mapped(point.F, mu, lam, flow)
