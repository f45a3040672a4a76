"""Parameter errors: measures, conversions, and the messages for a truth file that cannot be used."""

import json
import math

import pytest

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.parameter_errors import (
    Truth,
    moduli,
    parameter_errors,
    read_truth,
    young_and_poisson,
)


def truth(fluid: bool = False, **parameters: float) -> Truth:
    return Truth(parameters, fluid=fluid, velocity=None, hidden_effects={})


@pytest.mark.parametrize(
    ("name", "found", "true", "expected"),
    [
        ("E", 1e5, 1e6, 1.0),
        ("kappa", 2e4, 1e4, math.log10(2)),
        ("mu", 1e3, 1e5, 2.0),
        ("tau_y", 5e3, 5e3, 0.0),
        ("eta", 100.0, 1.0, 2.0),
        ("nu", 0.25, 0.30, 0.05),
        ("theta", 30.0, 40.0, math.pi / 18),
    ],
)
def test_each_parameter_has_its_measure(name, found, true, expected):
    errors = parameter_errors({name: found}, truth(**{name: true}))
    assert errors[name].error == pytest.approx(expected, abs=1e-12)


def test_moduli_and_back():
    # steel-like closed form: E = 210, nu = 0.25 -> mu = 84, kappa = 140
    assert moduli(210.0, 0.25) == pytest.approx((84.0, 140.0), rel=1e-14)
    assert young_and_poisson(84.0, 140.0) == pytest.approx((210.0, 0.25), rel=1e-14)


def test_truth_in_the_other_elastic_pair_is_converted():
    errors = parameter_errors({"mu": 84e3, "kappa": 140e4, "tau_y": 1e3}, truth(E=210e3, nu=0.25, tau_y=1e3))
    assert errors["mu"].error == pytest.approx(0.0, abs=1e-12)
    assert errors["kappa"].error == pytest.approx(1.0, rel=1e-12)
    errors = parameter_errors({"E": 210e3, "nu": 0.3}, truth(mu=84e3, kappa=140e3))
    assert errors["E"].error == pytest.approx(0.0, abs=1e-12)
    assert errors["nu"].error == pytest.approx(0.05, rel=1e-12)


def test_a_viscosity_is_never_compared_with_a_shear_modulus():
    assert parameter_errors({"E": 1e5, "nu": 0.3}, truth(fluid=True, mu=200.0, kappa=1e5)) == {}
    fluid = parameter_errors({"mu": 200.0, "kappa": 1e5}, truth(mu=1e4, kappa=1e5), fluid=True)
    assert set(fluid) == {"kappa"}


def test_a_parameter_whose_true_value_is_unknown_or_zero_is_left_out():
    assert set(parameter_errors({"E": 1e5, "eta": 3.0}, truth(E=1e5, eta=0.0))) == {"E"}
    assert parameter_errors({"tau_y": 1e5, "ground_height": 0.01}, truth(E=1e5)) == {}


def test_a_parameter_without_a_measure_is_refused():
    with pytest.raises(UserInputError, match="no error measure for the parameter 'hardness'"):
        parameter_errors({"hardness": 1.0}, truth(hardness=1.0))


def test_reading_a_truth_file(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(
        json.dumps(
            {
                "material": "newtonian",
                "parameters": {"mu": 200, "kappa_Pa": 1e5},
                "initial_velocity_m_s": [0, -0.5, 0],
                "hidden_effects": {"linear_drag": {"c_per_s": 1.5}},
            }
        )
    )
    assert read_truth(path) == Truth(
        {"mu": 200.0, "kappa": 1e5}, True, (0.0, -0.5, 0.0), {"linear_drag": {"c_per_s": 1.5}}
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not readable as JSON"),
        ('{"E_Pa": 1}', 'wants an object with "parameters"'),
        ('{"parameters": {"E_pa": 1}}', "unknown parameter 'E_pa'; did you mean 'E_Pa'"),
        ('{"parameters": {"E_Pa": null}}', 'wants an object with "parameters"'),
    ],
)
def test_an_unusable_truth_file_is_one_clear_line(tmp_path, content, message):
    path = tmp_path / "truth.json"
    path.write_text(content)
    with pytest.raises(UserInputError, match=message) as caught:
        read_truth(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_an_absent_truth_file_is_named(tmp_path):
    with pytest.raises(UserInputError, match="no such file"):
        read_truth(tmp_path / "truth.json")
