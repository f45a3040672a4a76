"""What a physical effect is. Add one by adding one file like ``linear_drag.py``."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.parameters import Parameter, check_declared
from pacnerf_lpo.mpm.point import Law, Point

FAR = 10.0
"""A null so many times larger than any probe stands for infinity: a ground that always holds, a yield never reached."""
LEAST_FACTOR = 0.05
"""A gradient leaves at least this part of mass and stiffness."""
Initial = tuple[Tensor, Tensor, Tensor]
"""Velocity [m/s, (N, 3)], mass [kg, (N,)] and stiffness [1, (N,)] at frame 0."""


class Effect(ABC):
    """Physics in addition to material, ground and gravity, with named coefficients that can be identified.

    Subclasses are one of the kinds below (where the effect acts) and fill in what the kind is known by:

    Attributes:
        parameters: every coefficient; ``Parameter.scale`` is the size at which it becomes noticeable.
        null: the value of each at which the effect vanishes; 0 unless said.
        signature: one sentence: what a video shows of it.
        confused_with: names of the classes that leave nearly the same signature, for whoever reads of the effect.
        separating_experiment: one sentence: which other recording would separate it from those.
        one_sided: whether the null lies on the boundary of what is physically possible.
        of_recording: whether it belongs to one recording and not to the object: of several, each has its own.
        constants_of_recording: whether its constants were measured in one recording: of several, each keeps its own.
        acts_on_motion: False for an effect on the cameras alone, which never enters the engine.
        of_medium: whether the air or liquid around a body exerts it: nothing else reaches a rigid body in free flight.
        materials, excluded: classes of those that suit it, and of those among them that do not.
        unsuited: what is wrong with any other, after its name.
        probes: two or three sets of values [SI] at which a diagnosis tries it (a threshold has no gradient at its
            null).

    Args:
        guess: value of every parameter [SI].
        constants: further numbers that its functions find among their coefficients, and that are never identified.

    A subclass without a constructor takes its coefficients one by one, each where it vanishes unless given. An argument
    of a subclass that is no coefficient is kept as an attribute of the same name.

    Raises:
        UserInputError: a value outside its bounds.
    """

    parameters: dict[str, Parameter]
    null: dict[str, float]
    signature: ClassVar[str]
    probes: tuple[dict[str, float], ...]
    confused_with: ClassVar[tuple[str, ...]] = ()
    separating_experiment: ClassVar[str] = ""
    one_sided: ClassVar[bool] = False
    of_recording: ClassVar[bool] = False
    constants_of_recording: ClassVar[bool] = False
    acts_on_motion: ClassVar[bool] = True
    of_medium: ClassVar[bool] = False
    materials: ClassVar[tuple[type[Material], ...]] = (Material,)
    excluded: ClassVar[tuple[type[Material], ...]] = ()
    unsuited: ClassVar[str] = ""
    reach: float = 20.0
    """Standard deviation of a coefficient in units of the farthest probe: a probe stands out by a few standard
    deviations of the noise, and an effect that stands out by a hundred is as many times stronger."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if {Effect, ABC}.isdisjoint(cls.__bases__) and not inspect.isabstract(cls):
            check_declared(cls, probed=True)
        if "parameters" in vars(cls) and "null" not in vars(cls):
            cls.null = dict.fromkeys(cls.parameters, 0.0)
        written = getattr(cls.__init__, "written", cls.__init__)  # by hand; what was made for a base fits that alone
        if "parameters" in vars(cls) and "guess" in inspect.signature(written).parameters:
            cls.__init__ = _constructor(cls, written)  # type: ignore[method-assign]

    def __init__(self, guess: Mapping[str, float], constants: Mapping[str, float] | None = None):
        where = type(self).__name__
        self.guess = {name: self.parameters[name].check(float(value), where) for name, value in guess.items()}
        self.constants = {name: float(value) for name, value in (constants or {}).items()}

    def prior(self, name: str) -> tuple[float, float]:
        """Mean and standard deviation of the free coordinate of a coefficient, before anything is measured: around its
        null, or around the probes where the null is far from them all (a yield stress that is never reached).
        """
        parameter = self.parameters[name]
        tried, null = np.array([probe[name] for probe in self.probes]), self.null[name]
        free = np.array([parameter.transform.to_free(float(value)) for value in tried])
        mean = free.mean() if self.null_is_far(name) else parameter.transform.to_free(null)
        return float(mean), max(self.reach * float(np.abs(free - mean).max()), parameter.prior(null)[1])

    def side(self, name: str) -> tuple[float, float]:
        """Between which values a coefficient may lie [SI]: a one-sided effect does not cross its null."""
        if not self.one_sided:
            return -np.inf, np.inf
        null = self.null[name]
        return (null, np.inf) if sum(probe[name] - null for probe in self.probes) > 0 else (-np.inf, null)

    def null_is_far(self, name: str) -> bool:
        """Whether the null of a coefficient stands for infinity."""
        null = abs(self.null[name])
        return null > 0 and null > FAR * max(abs(probe[name]) for probe in self.probes)

    @property
    def discrete(self) -> bool:
        """Whether it is non-local: no small change of a coefficient leads from its null to it."""
        return any(map(self.null_is_far, self.null))

    @classmethod
    def suits(cls, material: Material) -> bool:
        """Whether the effect has a meaning for this material."""
        return isinstance(material, cls.materials) and not isinstance(material, cls.excluded)

    @classmethod
    def check_material(cls, material: Material) -> None:
        """Raise UserInputError, in one line, where the effect has no meaning for this material."""
        if not cls.suits(material):
            raise UserInputError(f"effect {cls.__name__}: {type(material).__name__} {cls.unsuited}")


def _constructor(kind: type[Effect], base: Callable[..., None]) -> Callable[..., None]:
    """A constructor that takes the coefficients of a class one by one, and what its base takes besides ``guess``."""
    one = inspect.Parameter.POSITIONAL_OR_KEYWORD
    own, _, *more = inspect.signature(base).parameters.values()
    coefficients = [inspect.Parameter(name, one, default=kind.null[name], annotation=float) for name in kind.parameters]
    signature = inspect.Signature([own, *coefficients, *(p for p in more if p.name != "constants")])

    def __init__(self: Effect, *args: Any, **named: Any) -> None:
        given = signature.bind(self, *args, **named)
        given.apply_defaults()
        values = {name: value for name, value in given.arguments.items() if name != own.name}
        base(self, {name: values.pop(name) for name in kind.parameters}, **values)

    __init__.__signature__, __init__.written = signature, base  # type: ignore[attr-defined]
    return __init__


class BodyForce(Effect):
    """An effect that accelerates particles."""

    @staticmethod
    @abstractmethod
    def acceleration(point: Point, c: SimpleNamespace) -> list[Any]:
        """Acceleration of one particle [m/s^2, (3,)] from its state and the coefficients (the parameters by name).

        Plain arithmetic with the functions of ``mpm.differentiation``; no adjoint is to be written.
        """


class Softening(Effect):
    """An effect that multiplies the stiffness of a particle, and so all its moduli, before any law sees it."""

    @staticmethod
    @abstractmethod
    def factor(point: Point, c: SimpleNamespace) -> Any:
        """Factor on the stiffness of one particle; plain arithmetic as for a body force."""


class LawEffect(Effect):
    """An effect on the constitutive law. Several are nested: the first that is listed sees the particle first.

    history: how many numbers it keeps per particle from substep to substep, 0 unless said.
    """

    history: ClassVar[int] = 0

    @staticmethod
    @abstractmethod
    def law(inner: Law, point: Point, c: SimpleNamespace) -> tuple:
        """New deformation gradient and Kirchhoff stress [Pa], as of a material's law; then, where a history is kept,
        the new one (a list; the old one is ``point.history``).

        Plain arithmetic as for a material. ``inner(point, c)`` is the law inside: the material's or the next effect's.
        A changed particle is ``dataclasses.replace(point, ...)``, changed coefficients ``SimpleNamespace(**{**vars(c),
        ...})``.
        """

    @classmethod
    def initial_history(cls, positions: Tensor, mass: Tensor, dx: float) -> Tensor:
        """History at frame 0 [(N, history)], of positions [m, (N, 3)], mass [kg, (N,)] and node spacing [m]; torch."""
        return positions.new_zeros(len(positions), cls.history)


class GroundEffect(Effect):
    """Another ground in the place of the sticky one, which it is at its null. A model has at most one."""

    discrete = True

    @staticmethod
    @abstractmethod
    def velocity(u: list[Any], c: SimpleNamespace) -> list[Any]:
        """As :meth:`pacnerf_lpo.mpm.ground.Ground.velocity`."""


class InitialState(Effect):
    """An effect on what the body is at frame 0."""

    @staticmethod
    @abstractmethod
    def apply(positions: Tensor, velocity: Tensor, mass: Tensor, stiffness: Tensor, c: SimpleNamespace) -> Initial:
        """The body at frame 0, from positions [m, (N, 3)], what the others would be without it, and the coefficients
        (scalars). Plain torch.
        """

    @staticmethod
    def velocity_gradient(c: SimpleNamespace) -> Tensor | None:
        """What it adds to the velocity gradient of every particle [1/s, (3, 3)]; None: nothing. Torch."""
        return None


def one_at_a_time(**sizes: float) -> tuple[dict[str, float], ...]:
    """Probes that each set one coefficient to its size [SI], and all others to 0."""
    return tuple({name: size if name == moved else 0.0 for name in sizes} for moved, size in sizes.items())


def from_centre(positions: Tensor, mass: Tensor) -> Tensor:
    """Positions relative to the centre of mass [m, (N, 3)]."""
    return positions - (mass[:, None] * positions).sum(0) / mass.sum()


def linear_factor(positions: Tensor, mass: Tensor, c: SimpleNamespace, name: str) -> Tensor:
    """max(1 + k . (X - X_c), 0.05), with the centre of mass X_c and the gradient k, whose components [1/m] are the
    coefficients of that name with ``_x``, ``_y`` and ``_z`` [(N,)].
    """
    gradient = torch.stack([getattr(c, f"{name}_{axis}") for axis in "xyz"])
    return (1.0 + from_centre(positions, mass) @ gradient.to(mass)).clamp_min(LEAST_FACTOR)
