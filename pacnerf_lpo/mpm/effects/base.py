"""What a physical effect is. Add one by adding one file like ``linear_drag.py``."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, ClassVar

from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.mpm.point import Point


class Effect(ABC):
    """Physics beside material, ground and gravity, with named coefficients that can be identified.

    Subclasses are one of the kinds below (where the effect acts), list their ``parameters`` and ``null``, the value
    of each at which the effect vanishes; ``Parameter.scale`` is the size at which it becomes noticeable.

    Args:
        guess: value of every parameter [SI].
    """

    parameters: ClassVar[dict[str, Parameter]]
    null: ClassVar[dict[str, float]]

    def __init__(self, guess: Mapping[str, float]):
        where = type(self).__name__
        self.guess = {name: self.parameters[name].check(float(value), where) for name, value in guess.items()}


class BodyForce(Effect):
    """An effect that accelerates particles."""

    @staticmethod
    @abstractmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        """Acceleration of one particle [m/s^2, (3,)] from its state and the coefficients (the parameters by name).

        Plain arithmetic with the functions of ``mpm.differentiation``; no adjoint is to be written.
        """
