"""What a physical effect is. Add one by adding one file like ``linear_drag.py``."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, ClassVar

from torch import Tensor

from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.mpm.point import Point


class Effect(ABC):
    """Physics beside material, ground and gravity, with named coefficients that can be identified.

    Subclasses are one of the kinds below (where the effect acts) and fill in what the kind is known by:

    parameters: every coefficient; ``Parameter.scale`` is the size at which it becomes noticeable.
    null: the value of each at which the effect vanishes.
    signature: one sentence: what a video shows of it.
    confused_with: names of the classes that leave nearly the same signature.
    separating_experiment: one sentence: which other recording would separate it from those.
    one_sided: whether the null lies on the boundary of what is physically possible.
    probes: two or three sets of values [SI] at which a diagnosis tries it (a threshold has no gradient at its null).

    Args:
        guess: value of every parameter [SI].
    """

    parameters: ClassVar[dict[str, Parameter]]
    null: ClassVar[dict[str, float]]
    signature: ClassVar[str]
    probes: ClassVar[tuple[dict[str, float], ...]]
    confused_with: ClassVar[tuple[str, ...]] = ()
    separating_experiment: ClassVar[str] = ""
    one_sided: ClassVar[bool] = False

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


class Observation(Effect):
    """An effect on what the cameras see: it changes no motion, and never enters the engine. All methods are the identity
    unless overridden; plain torch, differentiable in the coefficients.

    Args:
        guess: value of every parameter [SI].
        view: file id of the one camera that is concerned; None: all of them.
    """

    def __init__(self, guess: Mapping[str, float], view: int | None = None):
        super().__init__(guess)
        self.view = view

    def concerns(self, view: int) -> bool:
        """Whether this camera (file id) is concerned."""
        return self.view is None or self.view == view

    def time(self, t: Tensor, c: SimpleNamespace) -> Tensor:
        """Time [s] at which the world is seen in the frame stamped ``t`` [s], both since frame 0."""
        return t

    def camera(self, view: int, c2w: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        """Pose [(3, 4), camera to world, OpenGL axes, m] of camera ``view`` at time ``t`` [s], given the believed one."""
        return c2w

    def image_plane(self, view: int, uv: Tensor, c: SimpleNamespace) -> Tensor:
        """Observed image coordinates, from the ideal ones of a pinhole [x / z and y / z, (..., 2)]."""
        return uv

    def colour(self, view: int, colour: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        """Observed colour, from the true one [0..1, (..., 3)], at time ``t`` [s]."""
        return colour
