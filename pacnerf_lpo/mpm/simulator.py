"""Differentiable MLS-MPM: particles in, their positions at every video frame out."""

# mypy: disable-error-code="type-abstract"

import difflib
import functools
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, TypeVar

import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm import runtime, taichi_calls
from pacnerf_lpo.mpm.effects.base import BodyForce, Effect, GroundEffect, InitialState, LawEffect, Softening
from pacnerf_lpo.mpm.ground import Ground, Sticky
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.point import LocalLaws, Point
from pacnerf_lpo.mpm.rollout import Engine, Rollout

E = TypeVar("E", bound=Effect)
NUMBER, VECTOR, TENSOR = "x", "(x, x, x)", "((x, x, x), (x, x, x), (x, x, x))"


class Simulator:
    """Explicit MLS-MPM (APIC, quadratic B-splines; Hu et al. 2018) over the ground y = 0, differentiable in all it is
    given.

    Per substep: F <- (I + dt C) F and the material's stress and return mapping, P2G, gravity and ground on the nodes,
    G2P.

    Args:
        material: constitutive law; its parameters are given at each call.
        ground: boundary condition at y = 0.
        dx: node spacing [m]; a particle has the volume (dx/2)^3.
        substeps: per frame.
        frame_dt: time between frames [s].
        gravity: [m/s^2].
        effects: further physics; those on the cameras change nothing here.
        device: ``"cpu"`` or ``"cuda"``; None: that of the process, see :func:`runtime.device`. Tensors may be anywhere.
        dtype: precision inside the engine, ``"f32"`` or ``"f64"``.
        memory: for keeping substeps from forward to backward instead of recomputing them [bytes]; None: 768 MB on the
            CPU, a quarter of what is free on CUDA.

    Raises:
        UserInputError: a setting that cannot be used.

    Example, the height of a falling elastic block and its derivative by the initial velocity:

        >>> import torch
        >>> from pacnerf_lpo.mpm.materials import NeoHookean
        >>> simulator = Simulator(NeoHookean(), dx=0.1, substeps=100)
        >>> axis = torch.arange(6) * 0.05
        >>> positions = torch.cartesian_prod(axis, axis + 1.0, axis)
        >>> velocity = torch.zeros_like(positions).requires_grad_()
        >>> ones = torch.ones(len(positions))
        >>> stiff = {"E": torch.tensor(1e5), "nu": torch.tensor(0.3)}
        >>> path = simulator(positions, velocity, 0.125 * ones, ones, stiff, frames=3)
        >>> path.shape
        torch.Size([3, 216, 3])
        >>> path[-1, :, 1].mean().backward()
        >>> round(float(velocity.grad[:, 1].sum()), 3)  # two frames of 1/24 s
        0.083
    """

    def __init__(
        self,
        material: Material,
        ground: Ground | None = None,
        *,
        dx: float,
        substeps: int,
        frame_dt: float = 1 / 24,
        gravity: Sequence[float] = (0.0, -9.8, 0.0),
        effects: Sequence[Effect] = (),
        device: str | None = None,
        dtype: str = "f32",
        memory: float | None = None,
    ):
        if len(gravity) != 3:
            raise UserInputError(f"Simulator: gravity {gravity}; give three numbers")
        for name, value in (("dx", dx), ("substeps", substeps), ("frame_dt", frame_dt)):
            if not value > 0:
                raise UserInputError(f"Simulator: {name} = {value}; give a positive number")
        if dtype not in taichi_calls.REAL:
            raise UserInputError(f"Simulator: dtype {dtype!r}; choose from {', '.join(taichi_calls.REAL)}")
        self.material, self.ground, self.effects = material, ground or Sticky(), tuple(effects)
        self._device = runtime.device() if device is None else torch.device(device)
        self._real = taichi_calls.TORCH_REAL[dtype]
        check_model("Simulator", material, self.ground, self.effects)
        laws, self._coefficient_values = local_laws(material, self.ground, self.effects)
        moving = [effect for effect in self.effects if effect.acts_on_motion]
        self._effect_values = {name: value for effect in moving for name, value in effect.guess.items()}
        threads, cuda = runtime.start(self._device.type), self._device.type == "cuda"
        if memory is None:
            memory = runtime.free_memory(self._device) / 4 if cuda else 768e6
        self._engine = Engine(laws, dx, substeps, frame_dt, tuple(gravity), dtype, threads, cuda, memory)

    def __call__(
        self,
        positions: Tensor,
        velocity: Tensor,
        mass: Tensor,
        stiffness: Tensor,
        parameters: Mapping[str, Tensor],
        frames: int,
        effect_parameters: Mapping[str, Tensor] | None = None,
    ) -> Tensor:
        """Simulate; differentiable in every tensor.

        Args:
            positions: at frame 0 [m, (N, 3)]
            velocity: at frame 0 [m/s, (N, 3)]
            mass: [kg, (N,)]
            stiffness: factor on the moduli [1, (N,)]
            parameters: every parameter of the material [SI, scalars]; also of the ground, by default the ground's own
                values.
            frames: number of frames, the first included.
            effect_parameters: of the effects, by default the effects' own values [SI, scalars].

        Returns:
            Positions at every frame, frame 0 first [m, (frames, N, 3)].

        Raises:
            UserInputError: shapes that do not agree, NaN, mass not positive, missing or unknown parameters.
            SimulationError: NaN, a particle faster than dx / dt, or out of any reasonable grid, with frame and substep.
        """
        particle_inputs = {"positions": positions, "velocity": velocity, "mass": mass, "stiffness": stiffness}
        self._check_particles(particle_inputs, frames)
        values = self._values({**parameters}, {**(effect_parameters or {})})
        x, v, m, stiff = (t.to(self._device, self._real) for t in particle_inputs.values())
        state, constants = self._start(x, v, m, stiff, values)
        of_material = self.material.coefficients({name: values[name] for name in self.material.parameters})
        others = (values[name] for name in self._coefficient_values)
        coefficients = torch.stack([*of_material.values(), *others]).to(self._device, self._real)
        recording = torch.is_grad_enabled() and any(t.requires_grad for t in (state, constants, coefficients))
        order = self._order(x.detach())
        inverse = torch.argsort(order)
        out = Rollout.apply(self._engine, frames, recording, state[order], constants[order], coefficients)
        return out[:, inverse].to(positions.device, positions.dtype)

    def _values(self, parameters: dict[str, Tensor], effect_parameters: dict[str, Tensor]) -> dict[str, Tensor]:
        """Every parameter as a checked float64 scalar: as given, else the ground's and the effects' own."""
        own = self.material.parameters
        _check_names("parameters", parameters, {**own, **self.ground.guess}, required=own)
        _check_names("effect_parameters", effect_parameters, self._effect_values, required={})
        values = {**self._coefficient_values, **self._effect_values, **parameters, **effect_parameters}
        tensors = {name: torch.as_tensor(value, dtype=torch.float64).reshape(()) for name, value in values.items()}
        for name, value in tensors.items():
            if not torch.isfinite(value):
                raise UserInputError(f"simulator: parameter {name} is {float(value)}; give a finite number")
        return tensors

    def _start(
        self, x: Tensor, v: Tensor, mass: Tensor, stiffness: Tensor, values: dict[str, Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Particle states at frame 0 and their constants, as :class:`Rollout` takes them."""
        histories = [effect.initial_history(x, mass, self._engine.dx) for effect in of_kind(self.effects, LawEffect)]
        C = x.new_zeros(3, 3)
        for effect in of_kind(self.effects, InitialState):
            given = {name: values[name].to(x) for name in effect.parameters}
            given |= {name: x.new_tensor(value) for name, value in effect.constants.items()}
            c = SimpleNamespace(**given)
            v, mass, stiffness = effect.apply(x, v, mass, stiffness, c)
            gradient = effect.velocity_gradient(c)
            C = C if gradient is None else C + gradient
        flat = torch.cat([C.reshape(9), torch.eye(3).reshape(9).to(x)]).expand(len(x), 18)
        return torch.cat([x, v, flat, *histories], 1), torch.cat([mass[:, None], stiffness[:, None], x], 1)

    def _order(self, positions: Tensor) -> Tensor:
        """Particles by the first node of their stencil, in the order of the nodes in memory."""
        cell = torch.floor(positions / self._engine.dx - 0.5).long()
        cell -= cell.amin(0)
        extent = cell.amax(0) + 1
        return torch.argsort((cell[:, 0] * extent[1] + cell[:, 1]) * extent[2] + cell[:, 2], stable=True)

    def _check_particles(self, tensors: dict[str, Tensor], frames: int) -> None:
        count = len(tensors["positions"])
        if frames < 1 or count == 0:
            raise UserInputError(f"simulator: {frames} frames of {count} particles; give at least one of each")
        for name, tensor in tensors.items():
            shape = (count, 3) if name in ("positions", "velocity") else (count,)
            if tuple(tensor.shape) != shape:
                raise UserInputError(f"simulator: {name} has shape {tuple(tensor.shape)}; expected {shape}")
            if not torch.isfinite(tensor).all():
                bad = int((~torch.isfinite(tensor.detach()).reshape(count, -1).all(1)).nonzero()[0])
                raise UserInputError(f"simulator: {name} of particle {bad} is not finite")
        if not (tensors["mass"] > 0).all():
            raise UserInputError(f"simulator: mass of particle {int(tensors['mass'].argmin())} is not positive")


def _check_names(where: str, given: Mapping, known: Mapping, required: Mapping) -> None:
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"choose from {', '.join(known) or 'none'}"
            raise UserInputError(f"simulator: {where} has no {name!r}; {hint}")
    missing = [name for name in required if name not in given]
    if missing:
        raise UserInputError(f"simulator: {where} lacks {', '.join(missing)}")


def of_kind(effects: Sequence[Effect], kind: type[E]) -> list[E]:
    """The effects of a kind, in order."""
    return [effect for effect in effects if isinstance(effect, kind)]


def check_model(where: str, material: Material, ground: Ground, effects: Sequence[Effect]) -> None:
    """Raise UserInputError when two of them use one name, two effects bring a ground, or one does not suit the
    material, or a function returns another form than it should.
    """
    grounds = of_kind(effects, GroundEffect)
    if len(grounds) > 1:
        both = " and ".join(type(effect).__name__ for effect in grounds)
        raise UserInputError(f"{where}: the effects {both} each replace the ground; keep one")
    if grounds and not isinstance(ground, Sticky):
        raise UserInputError(
            f"{where}: the effect {type(grounds[0]).__name__} replaces a ground that is Sticky, but it is "
            f"{type(ground).__name__}; set ground to Sticky, or leave the effect out"
        )
    for effect in effects:
        effect.check_material(material)
    own = [*{**material.parameters, **dict.fromkeys(_coefficients(material))}]
    names = [*own, *ground.parameters, *(name for e in effects for name in (*e.parameters, *e.constants))]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UserInputError(f"{where}: material, ground and effects have two parameters {twice[0]!r}; keep one")
    if material.deforms:
        laws, others = local_laws(material, ground, effects)
        _try_out(laws, {**_coefficients(material), **others})
    two = torch.ones(2, 3), torch.ones(2, 3), torch.ones(2), torch.ones(2)
    for effect in of_kind(effects, InitialState):
        given = {**effect.guess, **effect.constants}
        found = effect.apply(*two, SimpleNamespace(**{name: torch.tensor(value) for name, value in given.items()}))
        if not isinstance(found, tuple) or [getattr(x, "shape", None) for x in found] != [x.shape for x in two[1:]]:
            raise _mistake(effect.apply, "has to return the tuple of velocity (N, 3), mass (N,) and stiffness (N,)")


def _try_out(laws: LocalLaws, values: Mapping[str, Any]) -> None:
    """Raise UserInputError where a law returns another form than it should, as far as floats show it: some laws compute
    in a kernel only, which says it then.
    """
    c, some = SimpleNamespace(**{name: float(value) for name, value in values.items()}), [0.1, 0.2, 0.3]
    F, C = [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.9]], [[0.1, 0.2, 0.3], [0.2, 0.1, 0.0], some]
    point = Point(F, C, some, some, some, 0.1, 1e-3, 1.0, 1e-3, 1.0, [0.1] * laws.history)
    tried: list[tuple[Callable, Any]] = [(laws.stress, point), (laws.ground, some)]
    for law, seen in [*tried, *((law, point) for law in laws.accelerations)]:
        try:
            law(seen, c)
        except UserInputError:
            raise
        except Exception:
            continue


def _mistake(function: Any, said: str) -> UserInputError:
    """What a function of somebody's class does wrong, with its name and place."""
    code = function.__code__
    return UserInputError(f"{code.co_filename}, line {code.co_firstlineno}: {function.__qualname__} {said}")


@functools.cache
def _checked(law: Any, form: str) -> Callable[..., Any]:
    """A law that raises UserInputError where it returns another form."""

    def form_of(part: Any) -> str:
        form = f"({', '.join(map(form_of, part))})" if hasattr(part, "__len__") else NUMBER
        return "tensor" if form == TENSOR else form

    def checked(*seen: Any) -> Any:
        found = law(*seen)
        if form_of(found) != form:
            said = f"has to return {form}; it returns {form_of(found)}"
            raise _mistake(law, f"{said} (x is a number, a tensor three rows of three numbers)")
        return found

    return checked


def _with_history(kept: int) -> str:
    history = f", ({', '.join([NUMBER] * kept)})" if kept else ""
    return f"(tensor, tensor{history})"


def local_laws(material: Material, ground: Ground, effects: Sequence[Effect]) -> tuple[LocalLaws, dict[str, float]]:
    """What the kernels of a checked model are compiled from, and the coefficients that follow those of the material."""
    grounds = of_kind(effects, GroundEffect)
    inside = [effect for effect in effects if effect.acts_on_motion and not isinstance(effect, InitialState)]
    own = {} if grounds else ground.guess
    values = {**own, **{k: v for effect in inside for k, v in (*effect.guess.items(), *effect.constants.items())}}
    laws = LocalLaws(
        _checked(material.law, _with_history(0)),
        tuple(_checked(effect.acceleration, VECTOR) for effect in of_kind(effects, BodyForce)),
        _checked(grounds[0].velocity if grounds else ground.velocity, VECTOR),
        (*_coefficients(material), *values),
        tuple((_checked(e.law, _with_history(e.history)), e.history) for e in of_kind(effects, LawEffect)),
        tuple(_checked(effect.factor, NUMBER) for effect in of_kind(effects, Softening)),
    )
    return laws, values


def _coefficients(material: Material) -> dict[str, torch.Tensor]:
    return material.coefficients({name: torch.tensor(value) for name, value in material.guess.items()})
