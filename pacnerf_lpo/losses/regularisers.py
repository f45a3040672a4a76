"""Regularisers of the static phase (PAC-NeRF, Li et al., ICLR 2023; surface term: LPO supplement, eq. 9)."""

from torch import Tensor

SURFACE_ALPHA = (1e-4, 1e-1)


def transmittance_entropy(transmittance: Tensor) -> Tensor:
    """Mean of -T ln T - (1 - T) ln(1 - T) [nat, scalar] over rays (R,): small when rays are either stopped or free."""
    through = transmittance.clamp(1e-6, 1 - 1e-6)
    return -(through * through.log() + (1 - through) * (1 - through).log()).mean()


def matte_cross_entropy(transmittance: Tensor, matte: Tensor) -> Tensor:
    """Mean of -m ln(1 - T) - (1 - m) ln T [nat, scalar] of rays, T (R,) and the object's opacity m (R,).

    On a free ray this is its optical depth, so fog is pushed out with the same force however thin it already is.
    """
    through = transmittance.clamp(1e-6, 1 - 1e-6)
    return -(matte * (1 - through).log() + (1 - matte) * through.log()).mean()


def surface_area(opacity: Tensor, dx: float) -> Tensor:
    """sum_p clamp(alpha_p, 1e-4, 1e-1) dx^2 / 8 [m^2, scalar] of particle alphas (N,), eight to a cell of ``dx`` [m].

    Eq. 9 of the supplement prints dx^2 / 4; the default weights belong to dx^2 / 8.
    """
    return opacity.clamp(*SURFACE_ALPHA).sum() * (dx**2 / 8)
