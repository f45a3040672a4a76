"""The effects in whole rollouts: nothing at their null, mechanics elsewhere, and a gradient per kind.

Three models share their kernels between the tests, since compiling is what takes time: an elastic body with all effects
it can have, the same on an adhesive ground, and a fluid.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import pytest
import torch
from torch import Tensor

from pacnerf_lpo.mpm import effects
from pacnerf_lpo.mpm.effects import Effect
from pacnerf_lpo.mpm.materials import DruckerPrager, Material, NeoHookean, Newtonian
from pacnerf_lpo.mpm.simulator import Simulator
from tests.mpm.scenes import DT, DX, Particles, block, probe

pytestmark = pytest.mark.usefixtures("small_threads")
SUBSTEPS = 12
FORCES: tuple[type[Effect], ...] = (
    effects.LinearDrag,
    effects.QuadraticDrag,
    effects.UniformForce,
    effects.GravityMagnitude,
    effects.CentralForce,
    effects.Magnus,
)
LAWS: tuple[type[Effect], ...] = (
    effects.KelvinVoigt,
    effects.YieldStress,
    effects.SurfaceTension,
    effects.ThermalSoftening,
)
STATES: tuple[type[Effect], ...] = (effects.InitialSpin, effects.StiffnessGradient, effects.DensityGradient)
MODELS: dict[str, tuple[Material, tuple[type[Effect], ...]]] = {
    "elastic": (NeoHookean(E=2e5, nu=0.3), (*FORCES, *LAWS, *STATES, effects.GroundFriction)),
    "adhesive": (NeoHookean(E=2e5, nu=0.3), (effects.Adhesion,)),
    "fluid": (Newtonian(mu=500.0, kappa=1e4), (effects.ShearThinning, effects.SurfaceTension)),
    "sand": (DruckerPrager(theta=30.0, E=2e5, nu=0.3), (effects.Cohesion,)),
}
EACH = [(model, cls) for model, (_, classes) in MODELS.items() for cls in classes]
G = (0.0, -9.8, 0.0)


@functools.cache
def simulator(
    model: str, with_effects: bool = True, gravity: Sequence[float] = G, substeps: int = SUBSTEPS
) -> Simulator:
    """A model in float64, its effects at their null."""
    material, classes = MODELS[model]
    chosen = [cls() for cls in classes] if with_effects else []
    options = {"dx": DX, "substeps": substeps, "frame_dt": substeps * DT, "gravity": gravity, "effects": chosen}
    return Simulator(material, **options, dtype="f64", memory=0)


def run(
    model: str,
    body: Particles,
    frames: int = 5,
    gravity: Sequence[float] = G,
    substeps: int = SUBSTEPS,
    material: dict[str, float] | None = None,
    **values: float | Tensor,
) -> Tensor:
    """Positions [m, (frames, N, 3)] with these parameters of effects, the others at their null."""
    own = {k: torch.tensor(v).double() for k, v in {**MODELS[model][0].guess, **(material or {})}.items()}
    of_effects = {k: torch.as_tensor(v, dtype=torch.float64) for k, v in values.items()}
    inputs = (body.positions, body.velocity, body.mass, body.stiffness)
    return simulator(model, True, gravity, substeps)(*inputs, own, frames, of_effects)


def uniform(body: Particles, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Particles:
    """The same particles with one velocity [m/s] and one mass."""
    v = torch.tensor(velocity).double().expand_as(body.positions)
    ones = torch.ones(len(body.mass)).double()
    return Particles(body.positions, v, 1000 * (DX / 2) ** 3 * ones, ones)


def centre(path: Tensor, body: Particles) -> Tensor:
    """Centre of mass at every frame [m, (frames, 3)]."""
    return (path * body.mass[:, None]).sum(1) / body.mass.sum()


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_nothing_changes_at_the_null(model):
    """All effects of a model at once: equal to the last bit, through a contact."""
    body, material = block(), MODELS[model][0]
    inputs = (body.positions, body.velocity, body.mass, body.stiffness)
    plain = simulator(model, False)(*inputs, {k: torch.tensor(v).double() for k, v in material.guess.items()}, 5)
    assert torch.equal(run(model, body), plain)


@pytest.mark.parametrize(("model", "cls"), EACH, ids=lambda x: x if isinstance(x, str) else x.__name__)
def test_every_probe_changes_the_motion(model, cls):
    """By more than 1e-8 m on a contact of 20 ms, with rounding of 1e-13; and every parameter is described."""
    still = run(model, block())
    for values in cls.probes:
        assert set(values) == set(cls.parameters) == set(cls.null)
        assert (run(model, block(), **values) - still).abs().max() > 1e-8
        for name, value in values.items():
            cls.parameters[name].check(value, cls.__name__)
    assert cls.signature and cls.separating_experiment
    for other in cls.confused_with:
        assert issubclass(getattr(effects, other, Effect), Effect)


def test_sideways_push_and_gravity_give_parabolas():
    """x = a dt^2 n (n + 1) / 2 for symplectic Euler; positions of 2 m, rounded some 50 times a substep."""
    body = uniform(block(bottom=2.0))
    path = run("elastic", body, push_x=1.5, push_z=-0.5, extra_gravity=2.0)
    n = 4 * SUBSTEPS
    fall = torch.tensor([1.5, -11.8, -0.5]).double() * DT**2 * n * (n + 1) / 2
    torch.testing.assert_close(path[-1], body.positions + fall, rtol=0, atol=1e-9)


def test_quadratic_drag_has_its_terminal_velocity_and_decay():
    """At sqrt(g / k) the fall is uniform, exactly so in discrete time, up to the lightest nodes, which are dropped;
    without gravity x = ln(1 + k v t) / k, to k v dt of the path for explicit steps.
    """
    k, terminal = 2.0, math.sqrt(9.8 / 2.0)
    body = uniform(block(bottom=2.0), (0.0, -terminal, 0.0))
    path = run("elastic", body, drag_per_length=k)
    t = 4 * SUBSTEPS * DT
    torch.testing.assert_close(path[-1, :, 1], body.positions[:, 1] - terminal * t, rtol=0, atol=1e-8)
    thrown = uniform(block(bottom=2.0), (3.0, 0.0, 0.0))
    way = (run("elastic", thrown, gravity=(0.0, 0.0, 0.0), drag_per_length=k)[-1] - thrown.positions)[:, 0]
    torch.testing.assert_close(way.mean(), torch.tensor(math.log(1 + k * 3 * t) / k).double(), rtol=k * 3 * DT, atol=0)


def test_central_force_swings_the_centre_of_mass():
    """x_c - p = x_0 cos(w t), w = sqrt(k), whatever the body does inside; symplectic Euler is late by w dt / 2."""
    k, p = 400.0, torch.tensor([0.0, 0.5, 0.0]).double()
    body = uniform(block(bottom=0.5))
    away = torch.tensor([0.05, 0.02, -0.03]).double()  # of the centre from the reference point
    push = dict(zip(("central_x", "central_y", "central_z"), (k * away).tolist(), strict=True))
    seen = centre(run("elastic", body, frames=6, gravity=(0.0, 0.0, 0.0), pull=k, **push), body) - p - away
    w, times = math.sqrt(k), torch.arange(6).double() * SUBSTEPS * DT
    torch.testing.assert_close(
        seen, seen[0] * torch.cos(w * times)[:, None], rtol=0, atol=w * DT * float(seen[0].norm())
    )
    assert float(seen[-1].norm()) < 0.9 * float(seen[0].norm()), "it has moved"


def test_kelvin_voigt_damps_a_shear_wave():
    """u = U cos(k y) e_x between free surfaces y = 0, H, k = pi / H, in a solid too soft to swing back, decays at eta
    k^2 / rho. The decay without viscosity is taken off; splines see k^2 to (k dx)^2 / 4, as in test_motion.
    """
    eta, cells = 1e3, (16, 8, 1)
    k = math.pi / (cells[1] * DX)
    body = uniform(block(cells=cells, bottom=1.0, jitter=0.0))
    wave = torch.cos(k * (body.positions[:, 1] - 1.0))
    body.velocity = torch.zeros_like(body.positions)
    body.velocity[:, 0] = 0.1 * wave
    middle = body.positions[:, 0].abs() < 2 * DX

    def amplitude(viscosity: float) -> Tensor:
        soft = {"E": 10.0, "nu": 0.0}
        path = run("elastic", body, gravity=(0.0, 0.0, 0.0), material=soft, solid_viscosity=viscosity)
        return ((path[1:] - path[:-1])[:, middle, 0] * wave[middle]).sum(1).log()

    decay = amplitude(0.0) - amplitude(eta)
    rate = float(decay[3] - decay[0]) / (3 * SUBSTEPS * DT)
    assert rate == pytest.approx(eta / 1000 * k**2, rel=(k * DX) ** 2 / 4)


def test_initial_spin_keeps_turning_at_its_rate():
    """A stiff weightless body turns by omega t: momenta are conserved, and the velocity gradient given with the
    velocities is what APIC needs to hold the angular momentum (without it I / (I + m dx^2 / 2) is left, 12 % less). The
    angle is that of the best rotation; the body widens by rho omega^2 r^2 / E = 1e-2 at most.
    """
    body, omega = uniform(block(cells=(4, 4, 4), bottom=1.0, jitter=0.0)), 10.0
    path = run("elastic", body, frames=5, gravity=(0.0, 0.0, 0.0), material={"E": 1e6}, spin_y=omega)
    start, end = (path[i] - centre(path, body)[i] for i in (0, -1))
    angle = torch.atan2((start[:, 2] * end[:, 0] - start[:, 0] * end[:, 2]).sum(), (start * end)[:, [0, 2]].sum())
    assert float(angle) == pytest.approx(omega * 4 * SUBSTEPS * DT, rel=0.01)
    torch.testing.assert_close(centre(path, body)[-1], centre(path, body)[0], rtol=0, atol=1e-9)


def test_ground_friction_slows_a_sliding_block_by_coulombs_law():
    """-mu g once the contact is settled; the settling block's bounce modulates the normal force by some per cent."""
    mu, substeps = 0.3, 240
    body = uniform(block(cells=(4, 2, 4), bottom=0.0, jitter=0.0), (2.0, 0.0, 0.0))
    path = run("elastic", body, frames=4, substeps=substeps, material={"nu": 0.0}, ground_friction=mu)
    velocity = (centre(path, body)[1:] - centre(path, body)[:-1])[:, 0] / (substeps * DT)
    assert float(velocity[0] - velocity[-1]) / (2 * substeps * DT) == pytest.approx(mu * 9.8, rel=0.1)


def test_a_body_rebounds_the_higher_the_less_it_adheres_and_the_more_is_returned():
    body = uniform(block(), (0.0, -2.0, 0.0))
    highest = [
        float(centre(run("adhesive", body, frames=7, substeps=60, **values), body)[-1, 1])
        for values in (
            {"detachment_speed": 1e3, "restitution": 0.0},
            {"detachment_speed": 0.0, "restitution": 0.0},
            {"detachment_speed": 0.0, "restitution": 0.3},
        )
    ]
    assert highest[0] + 0.005 < highest[1] < highest[2] - 0.005


def test_yielded_body_stays_deformed():
    """Thrown on the ground: flatter than the elastic one at the end, and the flatter the less it hardens."""
    body = uniform(block(), (0.0, -3.0, 0.0))

    def height(**values: float) -> float:
        y = run("elastic", body, frames=7, substeps=60, ground_friction=2.0, **values)[-1, :, 1]
        return float(y.quantile(0.95) - y.quantile(0.05))

    soft, hard = (height(yield_stress=3e3, hardening=H) for H in (0.0, 1e5))
    assert soft < hard - 0.005 < height() - 0.01


def test_drop_has_laplaces_pressure():
    """A weightless drop settles at J with kappa (J^-6 - J) = 2 gamma / r: the virial theorem with the drop's own area,
    which is known to 3 % (test_local). J is the volume's within the outermost particles. The layer that carries the
    tension is a fifth of the radius thick here, and on average at 0.84 r: the radius in the law is uncertain by that,
    and 25 % are allowed. Breathing (w = 2 pi c / 2 r = 66 / s) is critically damped.
    """
    radius, gamma, kappa = 0.4, 700.0, 1e4
    ball = block(cells=(9, 9, 9), bottom=1.0)
    x = ball.positions - torch.tensor([0.0, 1.0 + 4.5 * DX, 0.0])
    inside = x.norm(dim=1) < radius
    body = uniform(Particles(ball.positions[inside], ball.velocity[inside], ball.mass[inside], ball.stiffness[inside]))
    viscous, weightless = {"mu": 2e3}, (0.0, 0.0, 0.0)
    path = run("fluid", body, 8, weightless, substeps=60, material=viscous, surface_tension=gamma)
    outer = x[inside].norm(dim=1) > 0.9 * radius
    distance = (path - path.mean(1, keepdim=True))[:, outer].norm(dim=2).mean(1)
    J = float(1 - (1 - (distance[-1] / distance[0]) ** 3) * (distance[0] / radius) ** 3)
    pressure = kappa * (J**-6 - J)
    r = radius * J ** (1 / 3)
    assert pressure == pytest.approx(2 * gamma / r, rel=0.25)


START = {
    "elastic": {"drag": 2.0, "drag_per_length": 0.3, "push_x": 1.0, "push_z": 0.5, "extra_gravity": -0.5, "pull": 3.0,
                "magnus": 0.1, "solid_viscosity": 20.0, "yield_stress": 5e3, "hardening": 1e4, "surface_tension": 50.0,
                "softening": 2.0, "spin_x": 1.0, "spin_y": -2.0, "spin_z": 0.5, "stiffness_gradient_x": 0.5,
                "stiffness_gradient_y": -1.0, "stiffness_gradient_z": 0.3, "density_gradient_x": 0.5,
                "density_gradient_y": -1.0, "density_gradient_z": 0.3, "ground_friction": 0.3},
    "adhesive": {"detachment_speed": 0.3, "restitution": 0.2},
}  # fmt: skip


@functools.cache
def gradients(model: str) -> dict[str, Tensor]:
    """Of the probe of scenes.py, by every parameter of the effects."""
    leaves = {k: torch.tensor(v, dtype=torch.float64, requires_grad=True) for k, v in START[model].items()}
    values = torch.autograd.grad(probe(run(model, block(), **leaves)), list(leaves.values()))
    return dict(zip(leaves, values, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "name"), [(m, n) for m, values in START.items() for n in values if n != "detachment_speed"]
)
def test_gradient_equals_finite_differences(model, name):
    """Through a rollout with contact and all effects at once, float64, a step of 1e-5 of the value: truncation 1e-10 of
    the curvature, rounding of 1e-13 m over 1e-5, and few particles that start to yield in between.
    """
    value = START[model][name]
    h = 1e-5 * abs(value)
    above, below = (probe(run(model, block(), **{**START[model], name: value + s * h})) for s in (1, -1))
    expected = (above - below) / (2 * h)
    assert abs(float(expected) * value) > 1e-7, "the parameter matters"
    torch.testing.assert_close(gradients(model)[name], expected, rtol=1e-4, atol=1e-9 / abs(value))


def test_threshold_of_detachment_has_no_gradient():
    assert float(gradients("adhesive")["detachment_speed"]) == 0.0


def test_gradient_passes_through_the_history_at_frame_0():
    """The surface's normals follow from the positions; along a random direction, as above."""
    generator, body = torch.Generator().manual_seed(3), block()
    direction = torch.randn(body.positions.shape, generator=generator, dtype=torch.float64) * DX

    def at(positions: Tensor) -> Tensor:
        moved = Particles(positions, body.velocity, body.mass, body.stiffness)
        return probe(run("elastic", moved, **{**START["elastic"], "surface_tension": 2e3}))

    x = body.positions.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(at(x), x)
    h = 1e-6
    slope = (at(body.positions + h * direction) - at(body.positions - h * direction)) / (2 * h)
    torch.testing.assert_close((gradient * direction).sum(), slope, rtol=1e-4, atol=1e-8)
