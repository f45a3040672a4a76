"""What several effects share."""

from torch import Tensor

LEAST_FACTOR = 0.05
"""A gradient leaves at least this part of mass and stiffness."""


def one_at_a_time(**sizes: float) -> tuple[dict[str, float], ...]:
    """Probes that each set one coefficient to its size [SI], and all others to 0."""
    return tuple({name: size if name == moved else 0.0 for name in sizes} for moved, size in sizes.items())


def from_centre(positions: Tensor, mass: Tensor) -> Tensor:
    """Positions relative to the centre of mass [m, (N, 3)]."""
    return positions - (mass[:, None] * positions).sum(0) / mass.sum()


def linear_factor(positions: Tensor, mass: Tensor, gradient: tuple[Tensor, Tensor, Tensor]) -> Tensor:
    """max(1 + k . (X - X_c), 0.05), with the gradient k [1/m, 3 scalars] and the centre of mass X_c [(N,)]."""
    relative = from_centre(positions, mass)
    change = sum((k * x for k, x in zip(gradient, relative.unbind(1), strict=True)), 0.0 * mass)
    return (1.0 + change).clamp_min(LEAST_FACTOR)
