"""A slow, plain-torch MLS-MPM in float64 against which the engine is judged.

It shares no code and no formulation with the engine: stresses and return mappings are written with 3 x 3 matrix
logarithms and exponentials instead of principal stretches, transfers with ``index_add`` instead of hand-written loops,
and every gradient is autograd's. Units are SI; ``N`` particles; y is up and the ground is the plane y = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import torch
from torch import Tensor

SMALLEST_STRETCH = 0.05
EYE = torch.eye(3, dtype=torch.float64)


class SymmetricFunction(torch.autograd.Function):
    """Y = U f(l) U^T for a symmetric matrix U l U^T, with the exact adjoint (Daleckii-Krein) also at equal eigenvalues.

    ``f`` maps eigenvalues to values; ``slope(a, b)`` is the divided difference (f(a) - f(b)) / (a - b), f'(a) when a =
    b.
    """

    @staticmethod
    def forward(
        ctx, matrix: Tensor, f: Callable[[Tensor], Tensor], slope: Callable[[Tensor, Tensor], Tensor]
    ) -> Tensor:
        values, vectors = torch.linalg.eigh(matrix)
        ctx.save_for_backward(vectors, slope(values[..., :, None], values[..., None, :]))
        return vectors @ (f(values)[..., None] * vectors.mT)

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None, None]:
        vectors, slopes = ctx.saved_tensors
        symmetric = 0.5 * (grad + grad.mT)
        return vectors @ (slopes * (vectors.mT @ symmetric @ vectors)) @ vectors.mT, None, None


def _slope_log(a: Tensor, b: Tensor) -> Tensor:
    """(ln a - ln b) / (a - b) without cancellation: ln(a/b) = log1p((a - b)/b)."""
    relative = (a - b) / b
    tiny = relative.abs() < 1e-12
    return torch.where(tiny, 1 / a, torch.log1p(relative) / torch.where(tiny, torch.ones_like(a), a - b))


def _slope_exp(a: Tensor, b: Tensor) -> Tensor:
    """(e^a - e^b) / (a - b) = e^b expm1(a - b) / (a - b)."""
    difference = a - b
    tiny = difference.abs() < 1e-12
    return b.exp() * torch.where(tiny, torch.ones_like(a), torch.expm1(difference) / torch.where(tiny, 1.0, difference))


def _slope_floored_log(a: Tensor, b: Tensor) -> Tensor:
    """Divided difference of ln max(x, floor): the logarithm's above the floor, zero below, a chord across."""
    floor = SMALLEST_STRETCH**2
    clamped_a, clamped_b = a.clamp(min=floor), b.clamp(min=floor)
    shrink = torch.where((a - b).abs() < 1e-12 * a, 1.0, (clamped_a - clamped_b) / torch.where(a == b, 1.0, a - b))
    return torch.where((a <= floor) & (b <= floor), 0.0, _slope_log(clamped_a, clamped_b) * shrink)


def log_symmetric(matrix: Tensor) -> Tensor:
    """Matrix logarithm of symmetric positive definite matrices (..., 3, 3)."""
    return SymmetricFunction.apply(matrix, torch.log, _slope_log)


def floored_log_symmetric(matrix: Tensor) -> Tensor:
    """Matrix logarithm with eigenvalues raised to ``SMALLEST_STRETCH**2`` where they are smaller."""
    return SymmetricFunction.apply(matrix, lambda x: x.clamp(min=SMALLEST_STRETCH**2).log(), _slope_floored_log)


def exp_symmetric(matrix: Tensor) -> Tensor:
    """Matrix exponential of symmetric matrices (..., 3, 3)."""
    return SymmetricFunction.apply(matrix, torch.exp, _slope_exp)


def trace(matrix: Tensor) -> Tensor:
    """Trace shaped (..., 1, 1), ready to multiply a matrix."""
    return matrix.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None, None]


def deviator(matrix: Tensor) -> Tensor:
    """Trace-free part."""
    return matrix - trace(matrix) / 3 * EYE


def safe_norm(matrix: Tensor) -> Tensor:
    """Frobenius norm shaped (..., 1, 1); at zero both the value and the gradient are zero."""
    square = (matrix * matrix).sum((-2, -1), keepdim=True)
    return torch.where(square > 0, torch.where(square > 0, square, 1.0).sqrt(), 0.0)


def lame(E: Tensor, nu: Tensor) -> tuple[Tensor, Tensor]:
    """Shear modulus and first Lame parameter [Pa]."""
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


# A law: (deformation gradient (N,3,3), velocity gradient C (N,3,3), dt, parameters, stiffness (N,1,1)) -> (new F,
# Kirchhoff tau [Pa])
Law = Callable[[Tensor, Tensor, float, dict[str, Tensor], Tensor], tuple[Tensor, Tensor]]


def neo_hookean(F: Tensor, C: Tensor, dt: float, p: dict[str, Tensor], stiffness: Tensor) -> tuple[Tensor, Tensor]:
    """tau = mu (F F^T - I) + lambda ln J I."""
    mu, lam = (stiffness * x for x in lame(p["E"], p["nu"]))
    F = (EYE + dt * C) @ F
    return F, mu * (F @ F.mT - EYE) + lam * torch.linalg.det(F).log()[:, None, None] * EYE


def newtonian(F: Tensor, C: Tensor, dt: float, p: dict[str, Tensor], stiffness: Tensor) -> tuple[Tensor, Tensor]:
    """tau = kappa (J - J^-6) I + mu J sym(grad v); F = J^(1/3) I carries the volume ratio only."""
    mu, kappa = stiffness * p["mu"], stiffness * p["kappa"]
    J = torch.linalg.det((EYE + dt * C) @ F)[:, None, None].clamp(min=SMALLEST_STRETCH)
    return J ** (1 / 3) * EYE, kappa * (J - J**-6) * EYE + mu * J * 0.5 * (C + C.mT)


def _hencky(F: Tensor, mu: Tensor, lam: Tensor, plastic_part: Callable[[Tensor], Tensor]) -> tuple[Tensor, Tensor]:
    """Replace the trial strain ln sqrt(F F^T) by ``plastic_part(strain)``; stress 2 mu eps + lambda tr(eps) I of the
    result.
    """
    left = F @ F.mT
    strain = plastic_part(0.5 * floored_log_symmetric(left))
    F = exp_symmetric(strain) @ exp_symmetric(-0.5 * log_symmetric(left)) @ F
    return F, 2 * mu * strain + lam * trace(strain) * EYE


def _perzyna(F: Tensor, dt: float, mu: Tensor, lam: Tensor, tau_y: Tensor, eta: Tensor) -> tuple[Tensor, Tensor]:
    """Von Mises return mapping ||s|| <- ||s|| - y / (1 + eta / (2 mu_hat dt)), y = ||s|| - sqrt(2/3) tau_y > 0."""

    def flow(strain: Tensor) -> Tensor:
        s = 2 * mu * deviator(strain)
        norm = safe_norm(s)
        mu_hat = mu * trace(exp_symmetric(2 * strain)) / 3
        excess = (norm - math.sqrt(2 / 3) * tau_y).clamp(min=0) / (1 + eta / (2 * mu_hat * dt))
        return strain - excess / torch.where(norm > 0, norm, 1.0) * s / (2 * mu)

    return _hencky(F, mu, lam, flow)


def von_mises(F: Tensor, C: Tensor, dt: float, p: dict[str, Tensor], stiffness: Tensor) -> tuple[Tensor, Tensor]:
    """Rate-independent von Mises plasticity on Hencky elasticity."""
    mu, lam = (stiffness * x for x in lame(p["E"], p["nu"]))
    return _perzyna((EYE + dt * C) @ F, dt, mu, lam, p["tau_y"], torch.zeros((), dtype=torch.float64))


def viscoplastic(F: Tensor, C: Tensor, dt: float, p: dict[str, Tensor], stiffness: Tensor) -> tuple[Tensor, Tensor]:
    """Von Mises with plastic viscosity eta."""
    mu, kappa = stiffness * p["mu"], stiffness * p["kappa"]
    return _perzyna((EYE + dt * C) @ F, dt, mu, kappa - 2 * mu / 3, p["tau_y"], p["eta"])


def drucker_prager(F: Tensor, C: Tensor, dt: float, p: dict[str, Tensor], stiffness: Tensor) -> tuple[Tensor, Tensor]:
    """Sand: deviatoric strain cut to the cone alpha_f = sqrt(2/3) 2 sin t / (3 - sin t); no stress under expansion."""
    mu, lam = (stiffness * x for x in lame(p["E"], p["nu"]))
    sine = torch.sin(torch.deg2rad(p["theta"]))
    alpha = math.sqrt(2 / 3) * 2 * sine / (3 - sine)

    def flow(strain: Tensor) -> Tensor:
        volume, shear = trace(strain), deviator(strain)
        norm = safe_norm(shear)
        excess = (norm + (3 * lam + 2 * mu) / (2 * mu) * volume * alpha).clamp(min=0)
        return torch.where(volume < 0, strain - excess / torch.where(norm > 0, norm, 1.0) * shear, 0.0)

    return _hencky((EYE + dt * C) @ F, mu, lam, flow)


LAWS: dict[str, Law] = {
    "NeoHookean": neo_hookean,
    "Newtonian": newtonian,
    "VonMises": von_mises,
    "ViscoplasticVonMises": viscoplastic,
    "DruckerPrager": drucker_prager,
}


class State(NamedTuple):
    """x [m, (N,3)], v [m/s, (N,3)], C [1/s, (N,3,3)], F [(N,3,3)]."""

    x: Tensor
    v: Tensor
    C: Tensor
    F: Tensor


@dataclass(frozen=True)
class Twin:
    """One physical set-up: law, ground, grid spacing dx [m], time step dt [s], gravity [m/s^2].

    Nodes lighter than ``lightest_node`` mean particle masses stay at rest, which keeps the division by the mass finite.
    ``spin`` is that of the body [rad/s, (3,)] if it was measured; None: that of the velocity field at each particle.
    """

    law: Law
    dx: float
    dt: float
    ground: Literal["sticky", "slip", "separate", "none"] = "sticky"
    gravity: tuple[float, float, float] = (0.0, -9.8, 0.0)
    lightest_node: float = 1e-10
    spin: tuple[float, float, float] | None = None
    zero: Tensor = field(default_factory=lambda: torch.zeros((), dtype=torch.float64))

    def start(self, positions: Tensor, velocity: Tensor) -> State:
        """Undeformed particles without spin."""
        n = len(positions)
        return State(positions, velocity, torch.zeros(n, 3, 3, dtype=torch.float64), EYE.expand(n, 3, 3))

    def stencil(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Node indices (N,27,3), quadratic B-spline weights (N,27), node minus particle [m, (N,27,3)]."""
        scaled = x / self.dx
        base = torch.floor(scaled.detach() - 0.5)
        f = scaled - base
        w = torch.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2], 1)
        offsets = torch.cartesian_prod(*[torch.arange(3)] * 3)
        weights = w[:, offsets[:, 0], 0] * w[:, offsets[:, 1], 1] * w[:, offsets[:, 2], 2]
        return base.long()[:, None] + offsets, weights, (offsets - f[:, None]) * self.dx

    def boundary(self, nodes: Tensor, u: Tensor, friction: Tensor) -> Tensor:
        """Velocity of the nodes at or below y = 0 after contact with the ground."""
        below = (nodes[:, 1] <= 0)[:, None]
        flat = u * torch.tensor([1.0, 0.0, 1.0], dtype=torch.float64)
        if self.ground == "sticky":
            return torch.where(below, 0.0, u)
        if self.ground == "slip":
            return torch.where(below, flat, u)
        if self.ground == "separate":
            speed = safe_norm(flat[..., None])[..., 0]
            kept = (1 + friction * u[:, 1:2] / torch.where(speed > 0, speed, 1.0)).clamp(min=0)
            return torch.where(below & (u[:, 1:2] < 0), kept * flat, u)
        return u

    def side(self, C: Tensor, v: Tensor) -> Tensor:
        """omega x v; for the spin of a velocity field that is the skew part of its gradient times v."""
        if self.spin is None:
            return (0.5 * (C - C.mT) @ v[..., None])[..., 0]
        return torch.linalg.cross(torch.tensor(self.spin, dtype=v.dtype).expand_as(v), v)

    def substep(
        self,
        state: State,
        mass: Tensor,
        stiffness: Tensor,
        parameters: dict[str, Tensor],
        drag: Tensor,
        friction: Tensor,
        magnus: Tensor,
    ) -> State:
        """P2G, grid update, G2P; before P2G ``drag`` [1/s] and ``magnus`` [1] accelerate the particles,
        a = -c v + S omega x v.
        """
        x, v, C, F = state
        F, tau = self.law(F, C, self.dt, parameters, stiffness[:, None, None])
        nodes, w, arm = self.stencil(x)
        impulse = -self.dt * (self.dx / 2) ** 3 * 4 / self.dx**2 * tau
        pushed = v + self.dt * (magnus * self.side(C, v) - drag * v)
        momentum = mass[:, None, None] * pushed[:, None] + arm @ (impulse + mass[:, None, None] * C).mT
        lower = nodes.amin((0, 1))
        shape = nodes.amax((0, 1)) - lower + 1
        flat = (
            ((nodes - lower)[..., 0] * shape[1] + (nodes - lower)[..., 1]) * shape[2] + (nodes - lower)[..., 2]
        ).reshape(-1)
        active, where = torch.unique(flat, return_inverse=True)
        coordinates = torch.stack(torch.unravel_index(active, tuple(shape.tolist())), 1) + lower
        node_mass = torch.zeros(len(active), 1, dtype=x.dtype).index_add(0, where, (w * mass[:, None]).reshape(-1, 1))
        node_momentum = torch.zeros(len(active), 3, dtype=x.dtype).index_add(
            0, where, (w[..., None] * momentum).reshape(-1, 3)
        )
        heavy = node_mass > self.lightest_node * mass.detach().mean()
        u = node_momentum / torch.where(heavy, node_mass, 1.0)
        u = u + self.dt * torch.tensor(self.gravity, dtype=x.dtype)
        u = torch.where(heavy, self.boundary(coordinates, u, friction), 0.0)[where].reshape(len(x), 27, 3)
        v = (w[..., None] * u).sum(1)
        return State(x + self.dt * v, v, 4 / self.dx**2 * (w[..., None] * u).mT @ arm, F)

    def rollout(
        self,
        state: State,
        mass: Tensor,
        stiffness: Tensor,
        parameters: dict[str, Tensor],
        frames: int,
        substeps: int,
        drag: Tensor | None = None,
        friction: Tensor | None = None,
        magnus: Tensor | None = None,
    ) -> tuple[Tensor, State]:
        """Positions at every frame [m, (frames, N, 3)], the first being the start, and the last state."""
        seen = [state.x]
        coefficients = [self.zero if c is None else c for c in (drag, friction, magnus)]
        for _ in range(frames - 1):
            for _ in range(substeps):
                state = self.substep(state, mass, stiffness, parameters, *coefficients)
            seen.append(state.x)
        return torch.stack(seen), state
