"""What a material is: named parameters, and one local law. Add one by adding one file like those next to this one."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import ClassVar

from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.parameters import Parameter, check_declared
from pacnerf_lpo.mpm.point import Point
from pacnerf_lpo.mpm.tensors import Tensor3


class Material(ABC):
    """A constitutive law with the initial guess of its parameters.

    Subclasses list ``parameters`` and give :meth:`law`, and :meth:`coefficients` where the law uses others than these;
    no adjoint is to be written. Where it does not deform (``deforms``), only forces on the body act on it.

    Args:
        guess: initial value of every parameter [SI].
        known: names of parameters that are not identified.
    Raises:
        UserInputError: a value outside its bounds, or an unknown name in ``known``.
    """

    parameters: ClassVar[dict[str, Parameter]]
    family: ClassVar[str] = ""
    """How a person calls a material of this kind, such as elastic."""
    deforms: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__ and not inspect.isabstract(cls):
            check_declared(cls, probed=False)

    def __init__(self, guess: Mapping[str, float], known: Sequence[str] = ()):
        where = type(self).__name__
        self.guess = {name: self.parameters[name].check(float(value), where) for name, value in guess.items()}
        for name in known:
            if name not in self.parameters:
                raise UserInputError(
                    f"{where}.known: {name!r} is no parameter of it; choose from {', '.join(self.parameters)}"
                )
        self.known = tuple(known)

    @property
    def free_names(self) -> list[str]:
        """Names of the parameters that are identified."""
        return [name for name in self.parameters if name not in self.known]

    def guessed(self, values: Mapping[str, float | None]) -> "Material":
        """The same law with another guess of some parameters [SI]; those of value None keep theirs."""
        given = {name: value for name, value in values.items() if value is not None}
        return type(self)(**{**self.guess, **given}, known=self.known)  # type: ignore[arg-type]

    @staticmethod
    def coefficients(p: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """What the law uses, from the parameters [SI, scalars], unless it is those; once per simulation, in torch."""
        return dict(p)

    @staticmethod
    @abstractmethod
    def law(point: Point, c: SimpleNamespace) -> tuple[Tensor3, Tensor3]:
        """New deformation gradient and Kirchhoff stress [Pa] of one particle, from the trial state and the
        coefficients.

        Plain arithmetic with the functions of ``mpm.differentiation`` and ``mpm.tensors``; moduli times
        ``point.stiffness``.
        """


def lame(E: Tensor, nu: Tensor) -> dict[str, Tensor]:
    """Lamé coefficients mu and lambda [Pa] from Young's modulus [Pa] and Poisson's ratio."""
    return {"mu": E / (2 * (1 + nu)), "lam": E * nu / ((1 + nu) * (1 - 2 * nu))}
