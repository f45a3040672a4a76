"""Whether an effect or a material of one's own keeps what its class promises: a small block, some rollouts in 64 bits.

The adjoint of a law is derived. But plain torch (``coefficients``, ``apply``) may cut a gradient, and an effect may not
vanish at what its class calls the null.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.materials.base import Material
from pacnerf_lpo.mpm.one_particle import one_particle
from pacnerf_lpo.mpm.parameters import Parameter
from pacnerf_lpo.mpm.simulator import Simulator

DX, SUBSTEPS, FRAMES, STEP_RATE = 0.1, 12, 5, 2400
"""Node spacing [m], substeps of a frame, frames, and substeps per second: a throw of 20 ms that ends on the ground."""
STEP = 1e-2
"""Of a noticeable change: the error of a central difference is the square of that, and nodes that are too light to
count, which the engine drops, make the positions jump by some 1e-8 m between its ends.
"""
AGREE = 1e-2
"""Relative to the derivative: both errors together are 1e-4 of it, and particles of a sand that begin to yield between
the ends make half a per cent; a gradient that is cut is another number.
"""
SAME, SEEN = 1e-12, 1e-8
"""Metres: positions of 1 m in 64 bits, rounded some times a substep; and what is far above that."""
NONE = 1e-6
"""Relative to the bulk modulus: a shear modulus or a viscosity that only rounding leaves."""
EYE = torch.eye(3, dtype=torch.float64)
SHEAR = torch.tensor([[2.0, 1.0, -2.0], [1.0, -3.0, 1.5], [-2.0, 1.5, 1.0]], dtype=torch.float64)
"""In all directions, without a change of volume."""
SQUEEZED, SHEARED = 1e-6, 1e-8
"""Strains far below any yield; sand carries a shear under a much larger pressure only."""


@dataclass(frozen=True)
class Check:
    """One promise: what it is, what was found, and whether it is kept."""

    what: str
    found: str
    kept: bool


def check_effect(effect: Effect, material: Material) -> Iterator[Check]:
    """Checks of an effect on the motion or the state at frame 0 of a material. Raises UserInputError where the effect
    has no meaning for the material, or its function cannot be compiled, and SimulationError where the motion is
    unstable at a probe.
    """
    names = set(effect.parameters)
    missing = [name for name in ("signature", "separating_experiment") if not getattr(effect, name, "")]
    yield Check("described", ", ".join(missing) or "signature and separating experiment", not missing)
    yield _described(effect.parameters)
    odd = [key for values in (effect.null, *effect.probes) for key in set(values) ^ names]
    found, kept = ", ".join(sorted(set(odd))) or f"{len(effect.probes)} probes", bool(effect.probes) and not odd
    yield Check("null and probes name every coefficient", found, kept)
    if not kept:
        return
    for values in (effect.null, *effect.probes):
        for name, value in values.items():
            effect.parameters[name].check(value, type(effect).__name__)
    without, withit = _block(material, []), _block(material, [effect])
    still, thrown = without({}), f"in a throw of {1000 * (FRAMES - 1) * SUBSTEPS / STEP_RATE:g} ms"
    change = float((withit(effect.null) - still).abs().max())
    yield Check("nothing changes at the null", f"{change:.1e} m", change <= SAME)
    moved = 0.0
    for probe in effect.probes:
        moved = float((withit(probe) - still).abs().max())
        said = ", ".join(f"{name} {value:g}" for name, value in probe.items())
        later = "" if moved > SEEN else "; what begins later is seen with arguments by which it begins sooner"
        yield Check(f"a probe is seen ({said})", f"{moved:.1e} m {thrown}{later}", moved > SEEN)
    if moved > SEEN:  # derivatives at the last probe are 0 else, and so are differences
        yield from _gradients(withit, effect.parameters, effect.probes[-1])


def check_material(material: Material) -> Iterator[Check]:
    """Checks of a constitutive law at its guess; raises as :func:`check_effect`."""
    yield _described(material.parameters)
    small = list(_small_strains(material))
    yield from small
    if not all(check.kept for check in small):  # such a body hardly moves as one
        return
    moved = _block(material, [], at_rest=True)({})
    away = float((moved - moved[:1]).abs().max())
    yield Check("a body at rest stays at rest", f"{away:.1e} m", away <= SAME)
    yield from _gradients(_block(material, []), material.parameters, material.guess)


def _described(parameters: Mapping[str, Parameter]) -> Check:
    bad = [name for name, one in parameters.items() if name != one.name or not one.unit or not one.label]
    return Check("parameters have their name, a unit and a label", ", ".join(bad) or ", ".join(parameters), not bad)


def _small_strains(material: Material) -> Iterator[Check]:
    """The moduli, where parameters mean some; whether they follow the stiffness; and the sign of the stress."""
    law, pressed = one_particle(material), (1 - SQUEEZED) * EYE
    at_rest = law(EYE, 0 * EYE)[1]
    finite = bool(at_rest.isfinite().all())
    yield Check("stress is a number where nothing is deformed", f"{float(at_rest.abs().max()):.3g} Pa", finite)
    if not finite:
        return

    def answer(change: Tensor, F: Tensor = EYE, flows: bool = False, stiffness: float = 1.0) -> tuple[float, Tensor]:
        """Of the stress to a strain, or a rate of it, from a state F: along that change over its square; all [Pa]."""
        before, after = ((F, 0 * EYE), (F, change)) if flows else ((F, 0 * EYE), (F + change, 0 * EYE))
        stress = law(*after, stiffness=stiffness)[1] - law(*before, stiffness=stiffness)[1]
        return float((stress * change).sum() / (change * change).sum()), stress

    trials = {"bulk": (-SQUEEZED * EYE, EYE, 3), "shear": (SHEARED * SHEAR, pressed, 2)}
    found = {name: answer(change, F) for name, (change, F, _) in trials.items()}
    for name, modulus in _meant_moduli(material).items():
        (work, stress), (change, _, share) = found[name], trials[name]
        off = float((stress / (share * modulus) - change).norm() / change.norm())
        said = f"{work / share:.5g} Pa, the parameters mean {modulus:.5g} Pa; stress off by {100 * off:.2g} %"
        yield Check(f"{name} modulus at small strain", said, off <= AGREE)
    costs = {name: work / trials[name][2] for name, (work, _) in found.items()}
    halves = {name: answer(change, F, stiffness=0.5)[0] / share for name, (change, F, share) in trials.items()}
    least = -NONE * abs(costs["bulk"])
    follows = all(abs(halves[name] - work / 2) <= AGREE * abs(work) - least for name, work in costs.items())
    said = ", ".join(f"{name} {costs[name]:.3g} and {half:.3g} Pa" for name, half in halves.items())
    yield Check("stress is half as large where point.stiffness is half", said, follows)
    costs |= {"expansion": answer(SQUEEZED * EYE)[0] / 3}
    solid = ", ".join(f"{name} {work:.3g}" for name, work in costs.items())
    flows = {"flow": answer(SHEAR, flows=True)[0] / 2, "flow inwards": answer(-EYE, flows=True)[0] / 3}
    said = f"moduli: {solid} Pa; viscosities: " + ", ".join(f"{name} {work:.3g}" for name, work in flows.items())
    costs |= flows
    positive = costs["bulk"] > 0 and all(work >= least for work in costs.values())
    yield Check("deformation costs work", f"{said} Pa s", positive)


def _meant_moduli(material: Material) -> dict[str, float]:
    """Bulk and shear modulus [Pa] that the parameters mean; none where their names and units do not say it."""
    given = {(name, one.unit): material.guess[name] for name, one in material.parameters.items()}
    E, nu, mu, kappa = map(given.get, (("E", "Pa"), ("nu", "1"), ("mu", "Pa"), ("kappa", "Pa")))
    if E is not None and nu is not None:
        return {"bulk": E / (3 * (1 - 2 * nu)), "shear": E / (2 * (1 + nu))}
    return {} if mu is None or kappa is None else {"bulk": kappa, "shear": mu}


def _gradients(move: Callable[[Mapping], Tensor], parameters: Mapping[str, Parameter], at: Mapping) -> Iterator[Check]:
    """The derivative of a sum over all positions by each free coordinate, against central differences."""

    def total(values: Mapping) -> Tensor:
        path = move(values)
        weights = torch.randn(path.shape, generator=torch.Generator().manual_seed(0), dtype=path.dtype)
        return (weights * (path - path[:1])).sum()

    for name, parameter in parameters.items():
        free = torch.tensor(parameter.transform.to_free(at[name]), dtype=torch.float64, requires_grad=True)
        moved = total({**at, name: parameter.transform.to_physical(free)})
        exact = torch.autograd.grad(moved, free, allow_unused=True)[0] if moved.requires_grad else None
        step = STEP * parameter.scale
        ends = [total({**at, name: parameter.physical(free.item() + side * step)}) for side in (-1, 1)]
        expected, found = float(ends[1] - ends[0]) / (2 * step), 0.0 if exact is None else float(exact)
        close = abs(found - expected) <= AGREE * abs(expected) + SAME
        yield Check(f"derivative by {name}", f"{found:.6g}, by differences {expected:.6g}", close)


def _block(material: Material, effects: list[Effect], at_rest: bool = False) -> Callable[[Mapping], Tensor]:
    """Positions [m, (F, N, 3)] of a block that is thrown on the ground, sheared and squeezed, or that rests in the air,
    as a function of values of parameters [SI].
    """
    gravity = (0.0, 0.0, 0.0) if at_rest else (0.0, -9.8, 0.0)
    simulator = Simulator(
        material, dx=DX, substeps=SUBSTEPS, frame_dt=SUBSTEPS / STEP_RATE, gravity=gravity, effects=effects, dtype="f64"
    )
    generator = torch.Generator().manual_seed(1)
    axes = [(torch.arange(count, dtype=torch.float64) + 0.5) * DX / 2 for count in (4, 6, 4)]
    lattice = torch.cartesian_prod(*axes)
    noise = torch.rand(lattice.shape, generator=generator, dtype=torch.float64) - 0.5
    positions = lattice + torch.tensor([0.0, 1.0 if at_rest else 0.04, 0.0]) + 0.15 * DX * noise
    gradient = torch.tensor([[-3.0, 2.0, 1.0], [0.0, -4.0, 2.0], [1.0, -1.0, 2.0]], dtype=torch.float64)
    thrown = torch.tensor([0.6, -2.0, -0.3]) + (positions - positions.mean(0)) @ gradient.T
    velocity = torch.zeros_like(positions) if at_rest else thrown
    mass = torch.full((len(positions),), 1000 * (DX / 2) ** 3, dtype=torch.float64)

    def move(values: Mapping) -> Tensor:
        own = {name: torch.as_tensor(values.get(name, material.guess[name])).double() for name in material.guess}
        others = {name: torch.as_tensor(v).double() for name, v in values.items() if name not in own}
        return simulator(positions, velocity, mass, torch.ones_like(mass), own, FRAMES, others)

    return move
