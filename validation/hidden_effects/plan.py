"""Which scene has which number: the family of a scene follows from its seed, so that any range is a fair sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Family = Literal["null", "single", "camera", "pair", "outside"]
DEVELOPMENT, SCORED = range(0, 1000), range(1000, 7000)
"""Seeds to tune the method with, and seeds that it is judged by; they never meet."""
CYCLE: tuple[tuple[Family, float], ...] = (
    ("null", 0.0),
    ("single", 20.0),
    ("null", 0.0),
    ("single", 20.0),
    ("camera", 20.0),
    ("null", 0.0),
    ("outside", 20.0),
    ("single", 20.0),
    ("single", 7.0),
    ("pair", 20.0),
    ("null", 0.0),
    ("single", 20.0),
    ("null", 0.0),
    ("single", 20.0),
    ("camera", 20.0),
    ("null", 0.0),
    ("outside", 20.0),
    ("single", 20.0),
    ("single", 7.0),
    ("single", 3.0),
)
"""Family and signal-to-noise ratio; 200 seeds hold 60 nulls and 60 single effects at 20."""
PHYSICS = (
    "LinearDrag",
    "GroundFriction",
    "UniformForce",
    "KelvinVoigt",
    "InitialSpin",
    "YieldStress",
    "GravityMagnitude",
    "StiffnessGradient",
    "QuadraticDrag",
    "ShearThinning",
    "CentralForce",
    "Adhesion",
    "ThermalSoftening",
    "DensityGradient",
    "SurfaceTension",
    "Cohesion",
)
CAMERAS = ("CameraShift", "TimeOffset", "CameraDrift", "Exposure", "CameraRotation", "RadialDistortion")
OUTSIDE = ("Gust", "Belt", "Vortex", "Fibres")


@dataclass(frozen=True)
class Plan:
    """What is hidden in a scene.

    seed: of all its random choices.
    family: what kind of scene it is.
    snr: signal-to-noise ratio of each hidden effect, as strength.py measures it; of an effect outside the catalogue,
        what the best imitation by a known effect leaves.
    effects: names of the classes to take; more than one in pairs.
    """

    seed: int
    family: Family
    snr: float
    effects: tuple[str, ...]


def plan(seed: int) -> Plan:
    """The plan of a seed; effects take turns within every family and strength."""
    cycle, place = divmod(seed, len(CYCLE))
    family, snr = CYCLE[place]
    alike = [other for other, entry in enumerate(CYCLE) if entry == (family, snr)]
    turn = cycle * len(alike) + alike.index(place)
    if family == "null":
        return Plan(seed, family, snr, ())
    if family == "pair":
        apart = 1 + (3 + turn // len(PHYSICS)) % (len(PHYSICS) - 1)
        first, second = (PHYSICS[(turn + step) % len(PHYSICS)] for step in (0, apart))
        return Plan(seed, family, snr, (first, second))
    names = {"single": PHYSICS, "camera": CAMERAS, "outside": OUTSIDE}[family]
    return Plan(seed, family, snr, (names[turn % len(names)],))
