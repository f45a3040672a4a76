"""``pacnerf-lpo check``: classes of the package and of the documentation pass, broken promises are named."""

import itertools
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.mpm import effects, materials
from pacnerf_lpo.mpm.differentiation import sqrt
from pacnerf_lpo.mpm.materials import DruckerPrager, Material, NeoHookean, Newtonian
from pacnerf_lpo.mpm.own_class import check_effect, check_material
from pacnerf_lpo.mpm.parameters import Identity, Log10, Parameter, named
from pacnerf_lpo.mpm.tensors import scaled

pytestmark = pytest.mark.usefixtures("small_threads")
ROOT = Path(__file__).resolve().parents[2]


class Late(effects.LinearDrag):
    """Does not vanish at its null."""

    null = {"drag": 0.5}  # noqa: RUF012


class Silent(effects.LinearDrag):
    """Has a probe that does nothing, and says nothing of itself."""

    signature = ""
    probes = ({"drag": 0.0}, {"drag": 1.0})


class Cut(effects.InitialSpin):
    """Loses the gradient of its coefficients."""

    @staticmethod
    def apply(positions, velocity, mass, stiffness, c):
        c = SimpleNamespace(**{name: value.detach() for name, value in vars(c).items()})
        return effects.InitialSpin.apply(positions, velocity, mass, stiffness, c)

    @staticmethod
    def velocity_gradient(c):
        return None


class Motionless(effects.BodyForce):
    """Has no function."""

    parameters = effects.LinearDrag.parameters


class Misnamed(effects.LinearDrag):
    """A coefficient under another name than its own, and a probe of none."""

    parameters = {"drag": Parameter("rate", "", Identity(), (-100.0, 1000.0), "drag rate")}  # noqa: RUF012
    probes = ({"rate": 1.0},)


class Loaded(NeoHookean):
    """Has a stress without a strain, and takes E as known."""

    @staticmethod
    def coefficients(p):
        return {name: value.detach() for name, value in NeoHookean.coefficients(p).items()}

    @staticmethod
    def law(point, c):
        F, tau = NeoHookean.law(point, c)
        size = sqrt(c.mu * c.mu)
        return F, [[tau[i][j] + (0.1 * size if i == j else 0.0) for j in range(3)] for i in range(3)]


def of_law(material: Material, law: Callable) -> Material:
    """A material with another law, without a class that others would see."""
    material.law = law  # type: ignore[method-assign]
    return material


def elastic(shear: float, pressure: float = 1.0, stiffness: float | None = None) -> Material:
    """An elastic law with factors on its moduli, and with a stiffness that it takes from nobody."""

    def law(point, c):
        moduli = SimpleNamespace(mu=shear * c.mu, lam=pressure * c.lam)
        return NeoHookean.law(point if stiffness is None else replace(point, stiffness=stiffness), moduli)

    return of_law(NeoHookean(), law)


def driven(point, c):
    """A fluid whose viscosity drives its flow."""
    return Newtonian.law(point, SimpleNamespace(mu=-c.mu, kappa=c.kappa))


def undefined(point, c):
    """A stress that is divided by the rate of deformation."""
    rate = sqrt(sum(point.C[i][j] * point.C[i][j] for i in range(3) for j in range(3)))
    return point.F, scaled(point.F, c.mu * rate / rate)


class Nameless(NeoHookean):
    """Moduli whose names mean nothing, and no stress."""

    parameters = named(Parameter("a", "Pa", Log10(), (0.0, 1e9), "modulus"))

    def __init__(self, a: float = 1e4):
        super(NeoHookean, self).__init__({"a": a})

    @staticmethod
    def coefficients(p):
        return {"mu": p["a"], "lam": p["a"]}

    @staticmethod
    def law(point, c):
        return point.F, scaled(point.F, 0.0)


def failed(checks) -> list[str]:
    return [check.what for check in checks if not check.kept]


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",
    [effects.Adhesion(), effects.SurfaceTension(), effects.StiffnessGradient(), effects.CentralForce()],
    ids=lambda effect: type(effect).__name__,
)
def test_effects_of_the_package_pass(effect: effects.Effect):
    assert failed(check_effect(effect, NeoHookean())) == []


@pytest.mark.slow
def test_a_material_with_a_return_mapping_passes():
    assert failed(check_material(DruckerPrager())) == []


@pytest.mark.slow
def test_each_broken_promise_is_told():
    assert failed(check_effect(Late(), NeoHookean())) == ["nothing changes at the null"]
    assert failed(check_effect(Silent(), NeoHookean())) == ["described", "a probe is seen (drag 0)"]
    spins = failed(check_effect(Cut(), NeoHookean()))
    assert spins == [f"derivative by spin_{axis}" for axis in "xyz"]
    assert failed(check_material(Loaded())) == ["a body at rest stays at rest", "derivative by E", "derivative by nu"]
    wrong = failed(check_effect(Misnamed(), NeoHookean()))
    assert wrong == ["parameters have their name, a unit and a label", "null and probes name every coefficient"]


BULK, SHEAR = "bulk modulus at small strain", "shear modulus at small strain"
NUMBER = "stress is a number where nothing is deformed"
FOLLOWS, COSTS = "stress is half as large where point.stiffness is half", "deformation costs work"


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (elastic(2.0), [BULK, SHEAR]),
        (elastic(1.0, 1.1), [BULK]),
        (elastic(-1.0, -1.0), [BULK, SHEAR, COSTS]),
        (elastic(1.0, 1.0, stiffness=1.0), [FOLLOWS]),
        (elastic(0.0, 0.0), [BULK, SHEAR, COSTS]),
        (of_law(Newtonian(), driven), [COSTS]),
        (Nameless(), [COSTS]),
        (of_law(NeoHookean(), undefined), [NUMBER]),
    ],
    ids=["doubled", "pressure", "sign", "stiffness", "nothing", "driven", "nameless", "undefined"],
)
def test_a_wrong_stress_is_told_before_anything_moves(material: Material, expected: list[str]):
    assert failed(check_material(material)) == expected


@pytest.mark.parametrize("name", [name for name in materials.__all__ if name not in ("Auto", "Material")])
def test_stresses_of_the_package_are_what_their_parameters_mean(name: str):
    checks = list(
        itertools.takewhile(lambda check: "rest" not in check.what, check_material(getattr(materials, name)()))
    )
    assert failed(checks) == [] and len(checks) == (4 if name == "Newtonian" else 6)


def in_docs(page: str) -> str:
    """The class that a page of the documentation writes."""
    found = re.search(r'```python\n(""".*?)```', (ROOT / "docs" / page).read_text(), re.DOTALL)
    assert found is not None
    return found[1]


@pytest.mark.slow
def test_the_command_checks_the_classes_of_the_documentation(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    Path("checked_magnetic.py").write_text(in_docs("own_effect.md"))
    Path("checked_stiffening.py").write_text(in_docs("own_material.md"))
    assert main(["check", "checked_magnetic.Magnetic"]) == 0
    assert main(["check", "checked_stiffening.Stiffening", "--arguments", '{"E": 3e4}']) == 0
    said = capsys.readouterr().out.splitlines()
    assert all(line.startswith("ok ") for line in said) and len(said) == 7 + 10


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["Magnetic"],
            "of this name; a class of your own has its module before it, such as magnetic.Magnetic; did you",
        ),
        (["LinearDrga"], "did you mean LinearDrag?"),
        (["pacnerf_lpo.mpm.materials.NeoHokean"], "effect or material of this name; did you mean NeoHookean?"),
        ([f"{__name__}.Motionless"], "; write it in the class"),
        (["nowhere.Magnetic"], "check nowhere.Magnetic: No module named 'nowhere'"),
        (["NeoHookean", "--arguments", '{"e": 1}'], "give its arguments with --arguments"),
        (["TimeOffset"], "a fault of a camera"),
        (["pacnerf_lpo.mpm.materials.rigid.Rigid"], "a rigid body has no stress"),
    ],
)
def test_a_mistake_is_one_line(words: list[str], expected: str, capsys):
    assert main(["check", *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert expected in line
