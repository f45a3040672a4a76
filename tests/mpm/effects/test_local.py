"""The effects on one particle: closed forms, evaluated on floats where no return mapping is inside, and adjoints."""

from __future__ import annotations

import functools
import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from pacnerf_lpo.mpm import effects
from pacnerf_lpo.mpm.materials import DruckerPrager, NeoHookean, Newtonian
from pacnerf_lpo.mpm.point import Point
from tests.mpm.effects.local import Local

pytestmark = pytest.mark.usefixtures("small_threads")
EYE = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
EXACT = 1e-11
"""Relative error of some hundred float64 operations at condition numbers of order one."""


def at(**changed: Any) -> Point:
    """A particle at rest in its undeformed state, of plain numbers."""
    zero = [0.0, 0.0, 0.0]
    resting = {"F": EYE, "C": [zero] * 3, "x": zero, "X": zero, "v": zero, "t": 0.0, "dt": 1e-3}
    return Point(**{**resting, "mass": 1.0, "volume": 1.0, "stiffness": 1.0, **changed})


def stress_free(point: Point, c: SimpleNamespace) -> tuple:
    """A material without stress that tells what coefficients it was given."""
    stress_free.seen = vars(c)  # type: ignore[attr-defined]
    return point.F, [[0.0] * 3 for _ in range(3)]


def test_drag_slows_and_forces_push_as_said():
    v, c = [3.0, -4.0, 0.0], SimpleNamespace(drag_per_length=0.2, push_x=1.0, push_z=-2.0, extra_gravity=0.5, pull=2.0)
    centre = {"pull_centre_x": 1.0, "pull_centre_y": 0.0, "pull_centre_z": 0.0}
    centre |= {"central_x": 0.0, "central_y": 0.5, "central_z": 0.0}
    assert effects.QuadraticDrag.acceleration(at(v=v), c) == pytest.approx([-3.0, 4.0, 0.0])
    assert effects.UniformForce.acceleration(at(), c) == [1.0, 0.0, -2.0]
    assert effects.GravityMagnitude.acceleration(at(), c) == [0.0, -0.5, 0.0]
    c = SimpleNamespace(**vars(c), **centre)
    assert effects.CentralForce.acceleration(at(x=[1.5, 1.0, 0.0]), c) == [-1.0, -1.5, 0.0]


def test_side_force_is_at_a_right_angle_to_spin_and_velocity():
    """S omega x v of a rotation about z; of a shear dv_x/dy = 8, whose spin is -4; of a given spin alone."""
    v, local = [3.0, 0.0, 1.0], effects.Magnus(0.1)
    c = SimpleNamespace(**local.guess, **local.constants)
    turning = [[0.0, -5.0, 0.0], [5.0, 0.0, 0.0], [0.0] * 3]
    shear = [[0.0, 8.0, 0.0], [0.0] * 3, [0.0] * 3]
    assert effects.Magnus.acceleration(at(v=v, C=turning), c) == pytest.approx([0.0, 1.5, 0.0])
    assert effects.Magnus.acceleration(at(v=v, C=shear), c) == pytest.approx([0.0, -1.2, 0.0])
    assert effects.Magnus.acceleration(at(v=v, C=EYE), c) == [0.0, 0.0, 0.0]
    given = effects.Magnus(0.1, spin=(0.0, 20.0, 0.0))
    c = SimpleNamespace(**given.guess, **given.constants)
    assert effects.Magnus.acceleration(at(v=v, C=turning), c) == pytest.approx([2.0, 0.0, -6.0])


def test_friction_below_sticking_is_coulombs():
    u = [2.0, -1.0, 0.0]
    assert effects.GroundFriction.velocity(u, SimpleNamespace(ground_friction=0.5)) == pytest.approx([1.5, 0.0, 0.0])
    free = effects.GroundFriction.velocity([2.0, 1.0, 0.0], SimpleNamespace(ground_friction=0.5))
    assert free == [2.0, 1.0, 0.0]
    stuck = SimpleNamespace(**effects.GroundFriction.null)
    assert effects.GroundFriction.velocity([2.0, 1.0, 0.0], stuck) == [0.0, 0.0, 0.0]


def test_adhesion_holds_below_its_speed_and_returns_what_approaches():
    c = SimpleNamespace(detachment_speed=0.2, restitution=0.25)
    assert effects.Adhesion.velocity([1.0, -2.0, 1.0], c) == [0.0, 0.5, 0.0]
    assert effects.Adhesion.velocity([1.0, 0.1, 1.0], c) == [0.0, 0.0, 0.0]
    assert effects.Adhesion.velocity([1.0, 0.3, 1.0], c) == [1.0, 0.3, 1.0]


def test_kelvin_voigt_adds_a_newtonian_stress_of_the_shear_rate():
    """tau_xy = eta dv_x/dy for simple shear; nothing for a rotation or a uniform expansion."""
    c = SimpleNamespace(solid_viscosity=3.0)
    shear, spin = ([[0.0, 5.0, 0.0], [s, 0.0, 0.0], [0.0] * 3] for s in (0.0, -5.0))
    _, tau = effects.KelvinVoigt.law(stress_free, at(C=shear), c)
    assert tau[0][1] == pytest.approx(15.0) and tau[1][0] == pytest.approx(15.0) and tau[0][0] == 0.0
    for C in (spin, [[2.0 * a for a in row] for row in EYE]):
        _, tau = effects.KelvinVoigt.law(stress_free, at(C=C), c)
        assert torch.tensor(tau).abs().max() < 1e-12


def test_shear_thinning_is_a_power_law_above_its_onset_and_constant_below():
    """g^(n - 1) between rates of 1e3 and 1e4 times the onset: the correction (g0 / g)^2 is 1e-6."""
    c = SimpleNamespace(mu=7.0, power_index=0.4, onset_rate=2.0)

    def viscosity(rate: float) -> float:
        effects.ShearThinning.law(stress_free, at(C=[[0.0, rate, 0.0], [0.0] * 3, [0.0] * 3]), c)
        return stress_free.seen["mu"]  # type: ignore[attr-defined]

    assert viscosity(0.0) == 7.0
    assert viscosity(2.0) == pytest.approx(7.0 * 2.0**-0.3, rel=1e-12)
    assert viscosity(2e4) / viscosity(2e3) == pytest.approx(10**-0.6, rel=1e-5)


def test_thermal_softening_halves_the_moduli_after_its_half_life():
    assert effects.ThermalSoftening.factor(at(t=0.5), SimpleNamespace(softening=2 * math.log(2))) == pytest.approx(0.5)


def test_surface_tension_pulls_in_the_surface_only_and_follows_its_motion():
    """Normal y: tension gamma |g| along x and z, none along y. Stretched by s along x, the area grows by s: J |g| = s
    of one step. A rotation turns g with the body.
    """
    c = SimpleNamespace(surface_tension=2.0)
    _, tau, g = effects.SurfaceTension.law(stress_free, at(history=[0.0, 3.0, 0.0]), c)
    assert torch.tensor(tau).tolist() == torch.diag(torch.tensor([6.0, 0.0, 6.0])).tolist() and g == [0.0, 3.0, 0.0]
    stretch = [[1.2, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    stretching = [[200.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3]
    _, tau, g = effects.SurfaceTension.law(stress_free, at(history=[0.0, 3.0, 0.0], F=stretch, C=stretching), c)
    assert tau[2][2] == pytest.approx(1.2 * 6.0) and g == pytest.approx([0.0, 3.0, 0.0])
    # (I + dt W) turns by w dt up to the cube of it, 1e-6, and lengthens by its square / 2, which the adjugate undoes.
    _, _, g = effects.SurfaceTension.law(
        stress_free, at(history=[0.0, 3.0, 0.0], C=[[0.0, -10.0, 0.0], [10.0, 0.0, 0.0], [0.0] * 3]), c
    )
    assert g[0] / g[1] == pytest.approx(-math.tan(0.01), abs=1e-6)


def test_area_of_a_sphere_is_the_sum_of_its_particles_gradients():
    """Sum of volume |grad phi| = 4 pi r^2, of a sphere of 6 cells sampled at random, within 3 %: the indicator is read
    over a layer of some 2 cells about r, whose area deviates by (1/6)^2 / 3 = 1 %, and the cut at 0.95 moves it by as
    much. The gradients point along the radius.
    """
    generator = torch.Generator().manual_seed(0)
    axis = torch.arange(-14, 14, dtype=torch.float64) / 12
    lattice = torch.cartesian_prod(axis, axis, axis)
    x = lattice + torch.rand(lattice.shape, generator=generator, dtype=torch.float64) / 12
    x = x[x.norm(dim=1) < 1]
    g = effects.SurfaceTension.initial_history(x, torch.ones(len(x), dtype=torch.float64), 1 / 6)
    volume = 1 / 12**3
    assert float(g.norm(dim=1).sum()) * volume == pytest.approx(4 * math.pi, rel=0.03)
    along = (g * x).sum(1).abs() / x.norm(dim=1)
    assert float(along.sum() / g.norm(dim=1).sum()) > 0.98


@pytest.mark.slow
def test_gradient_factors_leave_the_mass_and_move_its_centre():
    x = torch.rand(200, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64) * 0.2 + 1.0
    mass, ones, v = 1 + x[:, 0], torch.ones(200, dtype=torch.float64), torch.zeros(200, 3, dtype=torch.float64)
    k = {
        f"density_gradient_{a}": torch.tensor(z, dtype=torch.float64) for a, z in zip("xyz", (2.0, 0, -1), strict=True)
    }
    _, heavier, _ = effects.DensityGradient.apply(x, v, mass, ones, SimpleNamespace(**k))
    assert float(heavier.sum()) == pytest.approx(float(mass.sum()), rel=1e-12)
    moved = ((heavier - mass)[:, None] * x).sum(0)
    assert moved[0] > 0 and moved[2] < 0
    k = {
        f"stiffness_gradient_{a}": torch.tensor(z, dtype=torch.float64)
        for a, z in zip("xyz", (0, 50.0, 0), strict=True)
    }
    _, same, factor = effects.StiffnessGradient.apply(x, v, mass, ones, SimpleNamespace(**k))
    height = x[:, 1] - (mass * x[:, 1]).sum() / mass.sum()
    torch.testing.assert_close(factor, (1 + 50 * height).clamp_min(0.05), rtol=1e-12, atol=0)
    assert same is mass and factor.min() == 0.05


@functools.cache
def yielding() -> Local:
    """An elastic solid with every effect on it that has an adjoint inside the kernel."""
    return Local(
        NeoHookean(E=2e5, nu=0.25),
        [
            effects.SurfaceTension(),
            effects.KelvinVoigt(),
            effects.YieldStress(),
            effects.ThermalSoftening(),
            effects.LinearDrag(),
            effects.QuadraticDrag(),
            effects.UniformForce(),
            effects.GravityMagnitude(),
            effects.CentralForce(),
            effects.Magnus(),
        ],
    )


@functools.cache
def spinning() -> Local:
    """With a spin that was measured."""
    return Local(NeoHookean(E=2e5, nu=0.25), [effects.Magnus(spin=(3.0, -2.0, 5.0))])


@functools.cache
def cohesive() -> Local:
    return Local(DruckerPrager(theta=30.0, E=2e5, nu=0.3), [effects.Cohesion()])


@functools.cache
def thinning() -> Local:
    return Local(Newtonian(mu=50.0, kappa=1e4), [effects.ShearThinning(onset_rate=10.0), effects.SurfaceTension()])


@pytest.mark.slow
def test_yield_and_hardening_in_pure_shear():
    """F = diag(e^a, e^-a, 1): ||dev e|| = sqrt(2) a stays elastic up to sqrt(2/3) tau_y / (2 mu); beyond, with the
    hardening of the plastic part, (2 mu + 2 H / 3) ||e|| = sqrt(2/3) tau_y + 2 H / 3 ||total||; radial return is exact
    for a radial path, in one step or in two.
    """
    mu, tau_y, H = 8e4, 2e3, 4e4
    onset = tau_y / (2 * math.sqrt(3) * mu)

    def step(F: list[float], strain: float) -> tuple[Tensor, float]:
        out, _ = yielding()(
            yielding().inputs(F=torch.diag(torch.tensor(F, dtype=torch.float64)), history=[0.0, 0.0, 0.0, strain],
                              yield_stress=tau_y, hardening=H)
        )  # fmt: skip
        return out["F"].diagonal(), float(out["history"][3])

    below, none = step([math.exp(0.99 * onset), math.exp(-0.99 * onset), 1.0], 0.0)
    assert float(below[0]) == math.exp(0.99 * onset) and none == 0.0
    a = 4 * onset
    expected = (tau_y * math.sqrt(2 / 3) + 2 * H / 3 * math.sqrt(2) * a) / (2 * mu + 2 * H / 3)
    at_once, strain = step([math.exp(a), math.exp(-a), 1.0], 0.0)
    assert float(at_once[0].log()) * math.sqrt(2) == pytest.approx(expected, rel=EXACT)
    assert strain == pytest.approx(math.sqrt(2 / 3) * (math.sqrt(2) * a - expected), rel=EXACT)
    half, first = step([math.exp(a / 2), math.exp(-a / 2), 1.0], 0.0)
    in_two, second = step([float(half[0]) * math.exp(a / 2), float(half[1]) * math.exp(-a / 2), 1.0], first)
    torch.testing.assert_close(in_two, at_once, rtol=EXACT, atol=0)
    assert second == pytest.approx(strain, rel=EXACT)


@pytest.mark.parametrize("theta", [20.0, 40.0])
def test_cohesive_sand_bears_tension_and_yields_by_mohr_coulomb(theta):
    """Expanded: tau = C / tan(theta) I. Triaxial compression: t1 - t3 = (t1 + t3) sin(theta) + 2 C cos(theta)."""
    C, angle = 300.0, math.radians(theta)
    given = {"theta": theta, "cohesion": C}
    out, _ = cohesive()(cohesive().inputs(F=1.2 * torch.eye(3), **given))
    torch.testing.assert_close(
        out["tau"], C / math.tan(angle) * torch.eye(3, dtype=torch.float64), rtol=1e-9, atol=1e-6
    )
    squeezed = torch.diag(torch.tensor([-0.14, 0.03, 0.03], dtype=torch.float64).exp())
    out, _ = cohesive()(cohesive().inputs(F=squeezed, **given))
    t1, t3 = -float(out["tau"][0, 0]), -float(out["tau"][2, 2])
    assert t1 - t3 == pytest.approx((t1 + t3) * math.sin(angle) + 2 * C * math.cos(angle), rel=1e-9)


SCENES = {
    "yielding": (yielding, {"yield_stress": 2e3, "hardening": 4e4, "solid_viscosity": 20.0, "surface_tension": 50.0,
                            "softening": 1.5, "drag": 2.0, "drag_per_length": 0.3, "push_x": 1.0, "push_z": 0.5,
                            "extra_gravity": -0.5, "pull": 3.0, "magnus": 0.2}),
    "spinning": (spinning, {"magnus": 0.2}),
    "cohesive": (cohesive, {"cohesion": 400.0}),
    "thinning": (thinning, {"power_index": 0.5, "surface_tension": 50.0}),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_adjoint_equals_finite_differences(name):
    """Along every input, in float64: central differences with steps h of 1e-6 of its size, truncation of order 1e-12,
    rounding of some hundred numbers of order one, 3e-14 / h; stresses count in units of 1e4 Pa.
    """
    local, values = SCENES[name][0](), SCENES[name][1]
    generator = torch.Generator().manual_seed(4)

    def noise(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    base = local.inputs(
        F=0.97 * torch.eye(3) + 0.06 * noise(3, 3), C=20 * noise(3, 3), x=noise(3), X=noise(3), v=noise(3),
        stiffness=0.8, history=[5.0, 3.0, -2.0, 0.02][: local.parts["history"]], **values,
    )  # fmt: skip
    unit = torch.cat([torch.full((n,), 1e-4 if k == "tau" else 1.0).double() for k, n in local.outputs.items()])
    seeds = noise(len(unit)) * unit
    _, adjoint = local(base, seeds)
    first = 0
    for part, size in local.parts.items():
        for k in range(first, first + size):
            h = 1e-6 * max(float(base[k].abs()), 1e-3)
            ends = []
            for sign in (1, -1):
                moved = base.clone()
                moved[k] += sign * h
                ends.append((torch.cat([v.reshape(-1) for v in local(moved)[0].values()]) * seeds).sum())
            slope = (ends[0] - ends[1]) / (2 * h)
            torch.testing.assert_close(adjoint[k], slope, rtol=1e-5, atol=3e-14 / h, msg=lambda m, p=part: f"{p}: {m}")
        first += size
    for part in values:
        index = list(local.parts).index(part)
        assert adjoint[sum(list(local.parts.values())[:index])] != 0, f"{part} must matter here"
