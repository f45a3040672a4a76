"""Hencky elasticity in principal log-strains, shared by the plastic laws."""

from typing import Any

from pacnerf_lpo.mpm.differentiation import sqrt, where


def mean_and_deviator(e: list[Any]) -> tuple[Any, list[Any], Any]:
    """Mean strain, deviatoric strains, and their norm."""
    mean = (e[0] + e[1] + e[2]) / 3.0
    deviator = [x - mean for x in e]
    return mean, deviator, sqrt(deviator[0] * deviator[0] + deviator[1] * deviator[1] + deviator[2] * deviator[2])


def shortened(e: list[Any], deviator: list[Any], norm: Any, excess: Any) -> list[Any]:
    """Strains whose deviator is shorter by ``excess``."""
    factor = excess / where(norm > 0.0, norm, 1.0)
    return [x - factor * d for x, d in zip(e, deviator, strict=True)]


def stress(e: list[Any], mu: Any, lam: Any) -> list[Any]:
    """Principal Kirchhoff stresses 2 mu e + lambda tr(e) [Pa]."""
    pressure = lam * (e[0] + e[1] + e[2])
    return [2.0 * mu * x + pressure for x in e]
