"""Transfers between particles and grid lose no mass and no momentum, whatever the particles are.

P2G gives p_i = sum_p w_ip (m v + A (x_i - x)), of which the second part sums to zero, and G2P takes
v = sum_i w_ip p_i / m_i: with weights that sum to one the momentum of particles is that before. Nothing else acts on
the centre of mass but gravity, so that it moves by sum_k dt (v + (k + 1) dt g). In float64 rounding and nodes below the
mass floor (1e-10) leave 1e-9 of it.
"""

from __future__ import annotations

import torch
from hypothesis import given
from hypothesis import strategies as st

from pacnerf_lpo.mpm.materials import NeoHookean, Newtonian
from pacnerf_lpo.mpm.simulator import Simulator

F64 = torch.float64
DX, DT, FRAMES = 0.1, 1e-4, 3
GRAVITY = torch.tensor([0.3, -9.8, -1.0], dtype=F64)
MATERIALS = {"solid": NeoHookean(E=1e5, nu=0.3), "fluid": Newtonian(mu=50.0, kappa=1e5)}


@given(st.sampled_from(sorted(MATERIALS)), st.integers(1, 60), st.integers(1, 4), st.integers(0, 2**32), st.booleans())
def test_the_centre_of_mass_feels_gravity_only(name: str, count: int, substeps: int, seed: int, falling: bool):
    dice = torch.Generator().manual_seed(seed)
    x = torch.rand(count, 3, dtype=F64, generator=dice) * 0.5 + torch.tensor([-0.2, 1.0, 0.3], dtype=F64)
    v = torch.randn(count, 3, dtype=F64, generator=dice)
    mass, stiffness = (torch.rand(count, dtype=F64, generator=dice) + 0.05 for _ in range(2))
    gravity = GRAVITY if falling else torch.zeros(3, dtype=F64)
    material = MATERIALS[name]
    simulator = Simulator(
        material, dx=DX, substeps=substeps, frame_dt=substeps * DT, gravity=gravity.tolist(), dtype="f64"
    )
    parameters = {key: torch.tensor(value) for key, value in material.guess.items()}
    path = simulator(x, v, mass, stiffness, parameters, FRAMES)
    moved = ((path - x) * mass[:, None]).sum(1) / mass.sum()
    steps = substeps * torch.arange(FRAMES, dtype=F64)[:, None]
    mean = (v * mass[:, None]).sum(0) / mass.sum()
    expected = DT * steps * mean + DT**2 * steps * (steps + 1) / 2 * gravity
    torch.testing.assert_close(moved, expected, rtol=1e-9, atol=1e-9 * FRAMES * substeps * DT * float(v.abs().max()))
