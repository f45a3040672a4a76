"""A physical parameter: its name, its SI unit, its range, and the coordinate in which it is optimised."""

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError

OF = "@"
"""Between the name of a parameter and that of the recording that has it for itself."""
GUESSED_WITHIN = 1.0
"""Decades: standard deviation of a guessed modulus, which people know to a factor of ten."""
GUESSED_SCALES = 10.0
"""Noticeable changes: standard deviation of any other guess, so wide that any video outvotes it."""


class Transform:
    """A smooth bijection between a physical value and an unconstrained coordinate; the identity unless overridden."""

    def to_free(self, value: float) -> float:
        """The coordinate of a value."""
        return value

    def to_physical(self, free: Tensor) -> Tensor:
        """The value at a coordinate."""
        return free

    def lattice(self, start: float, decades: float) -> list[float]:
        """Free coordinates worth trying before a local search, ``start`` among them."""
        return [start]


@dataclass(frozen=True)
class Log10(Transform):
    """value = 10**free, for positive quantities spanning decades (moduli, viscosities)."""

    def to_free(self, value: float) -> float:
        return math.log10(value) if value > 0 else -math.inf

    def to_physical(self, free: Tensor) -> Tensor:
        return 10.0**free

    def lattice(self, start: float, decades: float) -> list[float]:
        count = round(2 * decades)
        return [start + 0.5 * k for k in range(-count, count + 1)]


@dataclass(frozen=True)
class Saturated(Transform):
    """value = limit * tanh(free / limit): Poisson's ratio stays inside (-limit, limit)."""

    limit: float = 0.45

    def to_free(self, value: float) -> float:
        return self.limit * math.atanh(value / self.limit)

    def to_physical(self, free: Tensor) -> Tensor:
        return self.limit * torch.tanh(free / self.limit)

    def lattice(self, start: float, decades: float) -> list[float]:
        return [start, *(self.to_free(fraction * self.limit) for fraction in (0.0, 0.25, 0.5, 0.7, 0.85))]


@dataclass(frozen=True)
class Identity(Transform):
    """value = free, for angles and effect coefficients."""


@dataclass(frozen=True)
class Parameter:
    """One named physical parameter.

    Args:
        name: key used everywhere (configs, results, TensorBoard).
        unit: SI unit as printed, ``"1"`` when dimensionless, ``"deg"`` for angles.
        transform: coordinate in which it is optimised.
        bounds: open interval of admissible values.
        label: how a person calls it.
        scale: a noticeable change of the free coordinate (0.1 is a quarter, for Log10): sensitivities are probed at a
            fraction of it, and one Gauss-Newton step moves at most a few of them.
        prior_value: mean and standard deviation of the value where nothing is known, for a parameter that some videos
            hardly determine; None: the user's guess is all that is known.
        spread: standard deviation of the free coordinate around the user's guess; None: :data:`GUESSED_WITHIN` for a
            logarithm, :data:`GUESSED_SCALES` scales for the others.
        impact: of a modulus or a viscosity, the middle of the decades in which an impact shows it, in units of the
            impact's pressure, or of that times the time in which the body passes its own size: below, nothing resists;
            above, nothing deforms. None: no such unit.
        rate: learning rate of the free coordinate in PAC-NeRF's Adam.
    """

    name: str
    unit: str
    transform: Transform
    bounds: tuple[float, float]
    label: str
    scale: float = 0.1
    prior_value: tuple[float, float] | None = None
    spread: float | None = None
    impact: float | None = None
    rate: float = 0.1

    def physical(self, free: float) -> float:
        """The value at a free coordinate [SI; degrees for angles]."""
        return float(self.transform.to_physical(torch.tensor(float(free), dtype=torch.float64)))

    def typical(self, pressure: float, time: float) -> float | None:
        """Value that shows best in an impact, from :attr:`impact` [SI]; None: unknown.

        Args:
            pressure: of the impact, density times the square of its speed [Pa]
            time: that the body takes to pass its own size [s]
        """
        if self.impact is None:
            return None
        return self.impact * pressure * (time if self.unit == "Pa s" else 1.0)

    def prior(self, guess: float) -> tuple[float, float]:
        """Mean and standard deviation of the free coordinate, before anything is measured, given the user's guess."""
        if self.prior_value is not None:
            mean, deviation = self.prior_value
            low, high = (self.transform.to_free(mean + half) for half in (-deviation / 2, deviation / 2))
            return self.transform.to_free(mean), high - low
        if self.spread is not None:
            return self.transform.to_free(guess), self.spread
        logarithm = isinstance(self.transform, Log10)
        return self.transform.to_free(guess), GUESSED_WITHIN if logarithm else GUESSED_SCALES * self.scale

    def check(self, value: float, where: str) -> float:
        """Return ``value``; raise UserInputError when it is NaN or outside the bounds."""
        low, high = self.bounds
        if not low < value < high:
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise UserInputError(
                f"{where}: {self.name} = {value:g}{unit} is not a possible {self.label}; "
                f"give a value above {low:g} and below {high:g}{unit}"
            )
        return value

    def show(self, value: float) -> str:
        """The value with its unit, as a person reads it."""
        return f"{value:.4g}" if self.unit == "1" else f"{value:.4g} {self.unit}"

    def of_recording(self, recording: str) -> "Parameter":
        """The parameter as one recording of several has it."""
        return replace(self, name=name_in(self.name, recording), label=f"{self.label} in {recording}")


def check_declared(kind: type, probed: bool) -> None:
    """Raise UserInputError where a class of a material or an effect lacks ``parameters`` or, if it is ``probed``,
    ``probes``, or has them in another form.
    """
    parameters, probes = getattr(kind, "parameters", None), getattr(kind, "probes", None)
    if not (isinstance(parameters, Mapping) and all(isinstance(v, Parameter) for v in parameters.values())):
        lacks = "parameters = named(Parameter(...), ...)"
    elif probed and not (isinstance(probes, Sequence) and all(isinstance(v, Mapping) for v in probes)):
        lacks = 'probes = ({"NAME": VALUE}, {"NAME": VALUE}), a tuple of values of all coefficients'
    else:
        return
    file = getattr(sys.modules.get(kind.__module__), "__file__", kind.__module__)
    raise UserInputError(f"{file}, class {kind.__name__}: {lacks.split()[0]} of this form are missing; write {lacks}")


def name_in(name: str, recording: str) -> str:
    """Name of a parameter that every recording has for itself, such as ``v_x@low``."""
    return f"{name}{OF}{recording}"


def own_name(name: str) -> str:
    """The name of a parameter without that of a recording."""
    return name.partition(OF)[0]


def named(*parameters: Parameter) -> dict[str, Parameter]:
    """Parameters by name, in order."""
    return {p.name: p for p in parameters}


def by_axis(
    stem: str, unit: str, bounds: tuple[float, float], label: str, scale: float = 0.1, axes: str = "xyz"
) -> dict[str, Parameter]:
    """A parameter for each axis by name, such as ``spin_x``; without a transform."""
    return named(*(Parameter(f"{stem}_{a}", unit, Identity(), bounds, f"{label} {a}", scale) for a in axes))
