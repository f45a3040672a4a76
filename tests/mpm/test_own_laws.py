"""A law of somebody's own: what is written as in any Python function works or is refused with its file and line."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import effects
from pacnerf_lpo.mpm.differentiation import exp, log, maximum, where
from pacnerf_lpo.mpm.effects import LinearDrag
from pacnerf_lpo.mpm.materials import Material, NeoHookean, VonMises
from pacnerf_lpo.mpm.one_particle import one_particle
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.mpm.point import Point

VELOCITY = (0.3, -2.0, 0.1)  # m/s
REFUSED = {
    "if": lambda point, c: [-c.drag * v if point.v[1] > 0 else 0.0 for v in point.v],
    "max": lambda point, c: [0.0, c.drag * max(-point.v[1], 0.0), 0.0],
    "and": lambda point, c: [where(point.v[1] > 0 and point.v[0] > 0, c.drag, 0.0)] * 3,
    "math": lambda point, c: [-c.drag * math.sqrt(abs(v)) for v in point.v],
    "numpy": lambda point, c: [-c.drag * np.sqrt(v) for v in point.v],
    "attribute": lambda point, c: [-c.drag * point.speed * v for v in point.v],
}


def motion(law: Any, drag: torch.Tensor) -> torch.Tensor:
    """Centre of a cube that falls under a law after two frames [m, (3,)]."""
    effect = type("Own", (LinearDrag,), {"acceleration": staticmethod(law)})(0.5)
    physics = Physics(NeoHookean(E=1e5, nu=0.3), effects=[effect], substep_rate=480.0)
    values = {**{name: torch.tensor(value) for name, value in physics.guess.items()}, "drag": drag}
    edge = 0.05 * torch.arange(3)
    cube = torch.cartesian_prod(edge, edge + 0.6, edge)
    full = torch.ones(len(cube))
    path = physics.motion(cube, torch.tensor(VELOCITY).expand_as(cube).clone(), full, full, values, 0.1, 3)
    return path[-1].mean(0)


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_kernel_cannot_compute_is_one_line_with_its_place(name: str):
    with pytest.raises(UserInputError) as refused:
        motion(REFUSED[name], torch.tensor(0.5))
    line = REFUSED[name].__code__.co_firstlineno
    assert str(refused.value).startswith(f"{__file__}, line {line}: ") and "\n" not in str(refused.value)
    if name in ("if", "max", "and"):
        assert "use where, maximum, minimum" in str(refused.value)


class Spin(effects.InitialSpin):
    """Returns a part of the state only."""

    @staticmethod
    def apply(positions, velocity, mass, stiffness, c):
        return velocity


def own(kind: type, **functions: Any) -> Any:
    """A material or an effect with other functions, without a class that others would see."""
    made = kind()
    vars(made).update(functions)
    return made


@pytest.mark.parametrize(
    ("made", "returns"),
    [
        (
            lambda: own(LinearDrag, acceleration=lambda point, c: [0.0, c.drag]),
            "has to return (x, x, x); it returns (x, x) ",
        ),
        (lambda: own(LinearDrag, acceleration=lambda point, c: c.drag), "it returns x (x is a number"),
        (lambda: own(effects.ThermalSoftening, factor=lambda point, c: [1.0]), "has to return x; it returns (x)"),
        (
            lambda: own(effects.KelvinVoigt, law=lambda inner, point, c: inner(point, c)[1]),
            "(tensor, tensor); it returns tensor",
        ),
        (lambda: own(effects.GroundFriction, velocity=lambda u, c: u[:2]), "it returns (x, x)"),
        (Spin, "Spin.apply has to return the tuple of velocity"),
        (
            lambda: own(NeoHookean, law=lambda point, c: NeoHookean.law(point, c)[1]),
            "(tensor, tensor); it returns tensor",
        ),
    ],
)
def test_what_returns_another_form_is_refused_when_the_model_is_made(made: Any, returns: str):
    found = made()
    with pytest.raises(UserInputError) as refused:
        Physics(found) if isinstance(found, NeoHookean) else Physics(NeoHookean(), effects=[found])
    assert str(refused.value).startswith(f"{__file__}, line ") and returns in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_only_a_kernel_computes_is_refused_there():
    """A law in principal space cannot be tried out with floats."""
    material = own(VonMises, law=lambda point, c: VonMises.law(point, c)[1])
    Physics(material)
    with pytest.raises(
        UserInputError, match=r"test_own_laws.py, line \d+: .* has to return \(tensor, tensor\); it returns tensor"
    ):
        one_particle(material)(torch.eye(3).double(), torch.zeros(3, 3).double())


@pytest.mark.parametrize(
    ("kind", "body", "lacks"),
    [
        (effects.BodyForce, {"probes": ({"k": 1.0},)}, "parameters = named(Parameter(...), ...)"),
        (effects.BodyForce, {"parameters": LinearDrag.parameters}, "probes = ("),
        (effects.BodyForce, {"parameters": LinearDrag.parameters, "probes": {"drag": 1.0}}, "probes = ("),
        (Material, {"coefficients": staticmethod(lambda p: {})}, "parameters = named(Parameter(...), ...)"),
    ],
)
def test_a_class_that_lacks_what_it_declares_is_refused_where_it_is_written(kind: type, body: dict, lacks: str):
    functions = {"acceleration": LinearDrag.acceleration, "law": NeoHookean.law}
    with pytest.raises(UserInputError) as refused:
        type("Own", (kind,), {**functions, **body, "__module__": __name__})
    assert str(refused.value).startswith(f"{__file__}, class Own: ") and f"write {lacks}" in str(refused.value)


def powers(point: Point, c: SimpleNamespace) -> list[Any]:
    """Drag by the speed to the power of 0.7, and what vanishes: powers and absolute values with two names each."""
    squared = sum(v * v for v in point.v)
    nothing = point.v[0] ** 0 - 1.0 + abs(point.v[1]) - maximum(point.v[1], -point.v[1]) + 2.0 ** point.v[2]
    return [-c.drag * squared**0.35 * v + nothing - exp(math.log(2.0) * point.v[2]) for v in point.v]


def test_powers_and_absolute_values_are_what_they_are_elsewhere():
    def plain(point: Point, c: SimpleNamespace) -> list[Any]:
        return [-c.drag * exp(0.35 * log(sum(v * v for v in point.v))) * v for v in point.v]

    found = []
    for law in (powers, plain):
        drag = torch.tensor(0.5, requires_grad=True)
        moved = motion(law, drag)
        found.append((moved.detach(), torch.autograd.grad(moved[1], drag)[0]))
    torch.testing.assert_close(found[0][0], found[1][0], rtol=0, atol=1e-6)
    torch.testing.assert_close(found[0][1], found[1][1], rtol=1e-4, atol=0)
    assert found[0][1] > 1e-3


def test_conditions_are_combined():
    def both(point: Point, c: SimpleNamespace) -> list[Any]:
        falls = (point.v[1] < 0) & ((point.v[0] > 1e3) | (point.v[2] > 0))
        return [where(falls, -c.drag * v, 0.0) for v in point.v]

    drag = torch.tensor(0.5)
    torch.testing.assert_close(motion(both, drag), motion(LinearDrag.acceleration, drag), rtol=0, atol=1e-6)


def test_an_effect_on_the_initial_state_finds_its_constants():
    """A body that is thrown faster by a constant gets as far as one that had that velocity."""
    thrown = own(
        effects.InitialSpin,
        constants={"faster": 0.4},
        apply=lambda positions, velocity, mass, stiffness, c: (velocity + c.faster, mass, stiffness),
    )
    edge = 0.05 * torch.arange(3)
    cube = torch.cartesian_prod(edge, edge + 0.6, edge)
    full = torch.ones(len(cube))

    def end(made: list[Any], speed: float) -> torch.Tensor:
        physics = Physics(NeoHookean(E=1e5, nu=0.3), effects=made, substep_rate=480.0)
        values = {name: torch.tensor(value) for name, value in physics.guess.items()}
        return physics.motion(cube, torch.full_like(cube, speed), full, full, values, 0.1, 3)[-1]

    assert torch.allclose(end([thrown], 0.1), end([], 0.5), atol=1e-6)
