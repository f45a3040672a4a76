"""What a camera fault is. Add one by adding one file like ``exposure.py``."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.effects.base import Effect


class Observation(Effect):
    """An effect on what the cameras see: it changes no motion, and never enters the engine. All methods are the
    identity unless overridden; plain torch, differentiable in the coefficients.

    Two cameras may be wrong in the same way, so the parameters of an effect on one view carry its id: ``gain`` becomes
    ``gain_view3``. The methods receive the coefficients by the short names.

    Args:
        guess: value of every parameter [SI], by its short name.
        view: file id of the one camera that is concerned; None: all of them.
    """

    of_recording = True
    acts_on_motion = False

    def __init__(self, guess: Mapping[str, float], view: int | None = None):
        kind, self.view, self._suffix = type(self), view, "" if view is None else f"_view{view}"
        of_view = "" if view is None else f" of view {view}"
        self.parameters = {
            self.full_name(name): replace(parameter, name=self.full_name(name), label=parameter.label + of_view)
            for name, parameter in kind.parameters.items()
        }
        self.null = self._renamed(kind.null)
        self.probes = tuple(map(self._renamed, kind.probes))
        super().__init__(self._renamed(guess))

    def full_name(self, name: str) -> str:
        """The unique name of a parameter, from its short one."""
        return name + self._suffix

    def coefficients(self, values: Mapping[str, Tensor]) -> SimpleNamespace:
        """What the methods receive, from the values of all parameters by their unique names."""
        return SimpleNamespace(**{name: values[self.full_name(name)] for name in type(self).parameters})

    def at(self, view: int) -> "Observation":
        """The same fault of another camera (file id)."""
        short = {name: self.guess[self.full_name(name)] for name in type(self).parameters}
        moved = copy(self)
        Observation.__init__(moved, short, view)
        return moved

    def concerns(self, view: int) -> bool:
        """Whether this camera (file id) is concerned."""
        return self.view is None or self.view == view

    def time(self, t: Tensor, c: SimpleNamespace) -> Tensor:
        """Time [s] at which the world is seen in the frame stamped ``t`` [s], both since frame 0."""
        return t

    def camera(self, view: int, c2w: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        """Pose of camera ``view`` at time ``t`` [s], given the believed one [(3, 4), to world, OpenGL axes, m]."""
        return c2w

    def image_plane(self, view: int, uv: Tensor, c: SimpleNamespace) -> Tensor:
        """Observed image coordinates, from the ideal ones of a pinhole [x / z and y / z, (..., 2)]."""
        return uv

    def colour(self, view: int, colour: Tensor, t: float, c: SimpleNamespace) -> Tensor:
        """Observed colour, from the true one [0..1, (..., 3)], at time ``t`` [s]."""
        return colour

    def _renamed(self, values: Mapping[str, float]) -> dict[str, float]:
        return {self.full_name(name): float(value) for name, value in values.items()}


def faults_of(effects: Sequence[Effect]) -> tuple[Observation, ...]:
    """The effects of a model that act on its cameras, in order."""
    return tuple(effect for effect in effects if isinstance(effect, Observation))
