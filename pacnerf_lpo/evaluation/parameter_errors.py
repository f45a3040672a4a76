"""How far identified physical parameters are from the true ones (LPO supplement, E.4).

Absolute difference of log10 for the moduli, viscosities and yield stress, plain for Poisson's ratio, radians for the
friction angle. Truth and fit may use different elastic pairs: (E, nu) is converted to (mu, kappa) and back.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

from pacnerf_lpo.errors import UserInputError

Measure = Literal["log10", "plain", "radians"]

MEASURES: dict[str, Measure] = {
    **dict.fromkeys(("E", "kappa", "mu", "tau_y", "eta"), "log10"),
    **{"nu": "plain", "theta": "radians"},
}
TRUTH_KEYS = {
    **{"E_Pa": "E", "nu": "nu", "mu": "mu", "kappa_Pa": "kappa"},
    **{"tau_y_Pa": "tau_y", "eta_Pa_s": "eta", "friction_angle_deg": "theta"},
}


@dataclass(frozen=True)
class ParameterError:
    """``found`` and ``true`` value in SI units (degrees for theta), and the ``error`` in ``measure``."""

    found: float
    true: float
    error: float
    measure: Measure


@dataclass(frozen=True)
class Truth:
    """What a truth.json holds: parameters by this project's names (SI, degrees) and the initial velocity [m/s].

    ``fluid`` says that ``mu`` is a viscosity [Pa s] and not a shear modulus [Pa].
    """

    parameters: dict[str, float]
    fluid: bool
    velocity: tuple[float, ...] | None
    hidden_effects: dict[str, dict]


def read_truth(path: str | Path) -> Truth:
    """Read a truth.json. Raises UserInputError where it is absent, no JSON object, or names an unknown parameter."""
    path = Path(path)
    if not path.is_file():
        raise UserInputError(f"{path}: no such file; --truth wants the truth.json of the scene")
    try:
        content = json.loads(path.read_text())
        given = content["parameters"]
        parameters = {_truth_name(key, path): float(value) for key, value in given.items()}
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise UserInputError(f"{path}: not readable as JSON ({error})") from None
    except (KeyError, TypeError, AttributeError):
        raise UserInputError(f'{path}: wants an object with "parameters": {{"E_Pa": 1e6, ...}}') from None
    velocity = content.get("initial_velocity_m_s")
    return Truth(
        parameters=parameters,
        fluid=content.get("material") == "newtonian",
        velocity=tuple(map(float, velocity)) if velocity else None,
        hidden_effects=content.get("hidden_effects", {}),
    )


def parameter_errors(found: Mapping[str, float], truth: Truth, fluid: bool = False) -> dict[str, ParameterError]:
    """The error of every fitted parameter [SI, theta in degrees] whose true value is known or follows from the truth's
    elastic pair. Raises UserInputError where a true parameter has no error measure.

    The ``mu`` of a ``fluid``, a viscosity [Pa s], is never compared with a solid's, and a true value of 0 has no
    logarithm: such pairs are left out.
    """
    true = truth.parameters if truth.fluid else complete_elastic_pair(truth.parameters)
    incomparable = {"mu", "E", "nu"} if fluid != truth.fluid else set()
    errors = {}
    for name in found:
        if name not in true or name in incomparable:
            continue
        if name not in MEASURES:
            raise UserInputError(f"no error measure for the parameter {name!r}; known are {', '.join(MEASURES)}")
        measure = MEASURES[name]
        if true[name] > 0 or measure != "log10":
            scale = {"log10": math.log10, "radians": math.radians, "plain": float}[measure]
            errors[name] = ParameterError(found[name], true[name], abs(scale(found[name]) - scale(true[name])), measure)
    return errors


def complete_elastic_pair(parameters: Mapping[str, float]) -> dict[str, float]:
    """Add mu [Pa] and kappa [Pa] where E and nu are given, and E and nu where the other two are.

    mu = E / (2 (1 + nu)), kappa = E / (3 (1 - 2 nu)), and the inverse.
    """
    given = dict(parameters)
    if {"E", "nu"} <= given.keys():
        mu, kappa = moduli(given["E"], given["nu"])
        return {"mu": mu, "kappa": kappa} | given
    if {"mu", "kappa"} <= given.keys():
        young, poisson = young_and_poisson(given["mu"], given["kappa"])
        return {"E": young, "nu": poisson} | given
    return given


def moduli(young: float, poisson: float) -> tuple[float, float]:
    """Shear modulus mu and bulk modulus kappa [Pa] of Young's modulus [Pa] and Poisson's ratio."""
    return young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))


def young_and_poisson(mu: float, kappa: float) -> tuple[float, float]:
    """Young's modulus [Pa] and Poisson's ratio of shear modulus mu and bulk modulus kappa [Pa]."""
    return 9 * kappa * mu / (3 * kappa + mu), (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))


def _truth_name(key: str, path: Path) -> str:
    name = TRUTH_KEYS.get(key)
    if name is None:
        near = get_close_matches(key, TRUTH_KEYS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(TRUTH_KEYS)}"
        raise UserInputError(f"{path}: unknown parameter {key!r}; {hint}")
    return name
