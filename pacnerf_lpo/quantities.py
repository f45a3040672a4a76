"""Physical values as a person writes them: symbols, SI prefixes, few digits."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

NU, RHO = "\N{GREEK SMALL LETTER NU}", "\N{GREEK SMALL LETTER RHO}"
SYMBOLS = {
    **{"E": "E", "nu": NU, "mu": "μ", "kappa": "κ", "tau_y": "τ_Y", "eta": "η", "theta": "θ", "rho": RHO},
    "ground_height": "h",
}
PREFIXES = {-3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def symbol(name: str) -> str:
    """The usual symbol of a parameter, or its name where there is none."""
    return SYMBOLS.get(name, name)


def yaml_number(value: float, digits: int = 6) -> str:
    """As YAML reads it: a number needs a point before its exponent."""
    text = f"{value:.{digits}g}"
    return text.replace("e", ".0e", 1) if "e" in text and "." not in text else text


def yaml_list(values: Iterable[float], digits: int = 6) -> str:
    """Numbers as a list in YAML."""
    return "[" + ", ".join(yaml_number(value, digits) for value in values) + "]"


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """``103 kPa``, ``0.296``, ``39.8°``, ``9.81 m/s²``: a value with its unit.

    Pressures and viscosities take the prefix that leaves one to three digits before the point.

    Example:
        >>> quantity(103.2e3, "Pa")
        '103 kPa'
    """
    if unit == "1":
        return f"{value:.{digits}g}"
    if unit == "deg":
        return f"{value:.{digits}g}°"
    unit = unit.replace("^2", "²").replace("^3", "³")
    if not unit.startswith("Pa") or value == 0 or not math.isfinite(value):
        return f"{value:.{digits}g} {unit}"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))) / 3 + 1e-12) * 3
    exponent = min(max(exponent, min(PREFIXES)), max(PREFIXES))
    return f"{value / 10**exponent:.{digits}g} {PREFIXES[exponent]}{unit}"


def published(interval: Mapping[str, Any]) -> tuple[float, float]:
    """Ends of an interval of a result, with the errors of the solver where they are known."""
    low, high = interval.get("with_solver") or (interval["low"], interval["high"])
    return low, high


def duration(seconds: float) -> str:
    """``42 s``, ``3 min 05 s``, ``1 h 12 min``."""
    if seconds < 99.5:
        return f"{seconds:.0f} s" if seconds >= 9.95 else f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 100:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def figure(value: float, unit: str = "") -> str:
    """A number of three digits with its unit, or a dash where there is none; thousands are written out."""
    if not math.isfinite(value):
        return "\N{EN DASH}"
    return f"{value:.0f} {unit}".strip() if 1e3 <= abs(value) < 1e6 else f"{value:.3g} {unit}".strip()
