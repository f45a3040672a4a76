"""What the films of the gallery show: for each material, effect and camera fault, the body without it and with it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pacnerf_lpo.data.shapes import Ball, Block, Shape
from pacnerf_lpo.mpm.effects.adhesion import Adhesion
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.effects.central_force import CentralForce
from pacnerf_lpo.mpm.effects.cohesion import Cohesion
from pacnerf_lpo.mpm.effects.density_gradient import DensityGradient
from pacnerf_lpo.mpm.effects.gravity_magnitude import GravityMagnitude
from pacnerf_lpo.mpm.effects.ground_friction import GroundFriction
from pacnerf_lpo.mpm.effects.initial_spin import InitialSpin
from pacnerf_lpo.mpm.effects.kelvin_voigt import KelvinVoigt
from pacnerf_lpo.mpm.effects.linear_drag import LinearDrag
from pacnerf_lpo.mpm.effects.magnus import Magnus
from pacnerf_lpo.mpm.effects.quadratic_drag import QuadraticDrag
from pacnerf_lpo.mpm.effects.shear_thinning import ShearThinning
from pacnerf_lpo.mpm.effects.stiffness_gradient import StiffnessGradient
from pacnerf_lpo.mpm.effects.surface_tension import SurfaceTension
from pacnerf_lpo.mpm.effects.thermal_softening import ThermalSoftening
from pacnerf_lpo.mpm.effects.uniform_force import UniformForce
from pacnerf_lpo.mpm.effects.yield_stress import YieldStress
from pacnerf_lpo.mpm.ground import Ground, Separate, Slip, Sticky
from pacnerf_lpo.mpm.materials import DruckerPrager, Material, NeoHookean, Newtonian, ViscoplasticVonMises, VonMises
from pacnerf_lpo.render.camera_faults.camera_drift import CameraDrift
from pacnerf_lpo.render.camera_faults.camera_rotation import CameraRotation
from pacnerf_lpo.render.camera_faults.camera_shift import CameraShift
from pacnerf_lpo.render.camera_faults.exposure import Exposure
from pacnerf_lpo.render.camera_faults.radial_distortion import RadialDistortion
from pacnerf_lpo.render.camera_faults.time_offset import TimeOffset

Vector = tuple[float, float, float]
RUBBER = NeoHookean(E=3e4, nu=0.3)
FIRM = NeoHookean(E=1e5, nu=0.3)


THICK = Newtonian(mu=400.0, kappa=1e5)
SYRUP = Newtonian(mu=10.0, kappa=1e5)
SAND = DruckerPrager(theta=20.0, E=3e5, nu=0.3)
BALL, BRICK, COLUMN = Ball(0.13), Block((0.28, 0.2, 0.2)), Block((0.2, 0.34, 0.2))


@dataclass(frozen=True)
class Scene:
    """One body in flight and on the ground.

    place: centre of the body at frame 0 [m];  seconds: how long it is shown.
    """

    material: Material = RUBBER
    effects: tuple[Effect, ...] = ()
    ground: Ground = field(default_factory=Separate)
    body: Shape = BALL
    place: Vector = (0.0, 0.55, 0.0)
    velocity: Vector = (0.0, -1.0, 0.0)
    seconds: float = 0.7


@dataclass(frozen=True)
class Comparison:
    """Two scenes of which only one thing differs, and what the right one has, in words."""

    left: Scene
    right: Scene
    words: str


def _with(effect: Effect, words: str, **scene: Any) -> Comparison:
    return Comparison(Scene(**scene), Scene(**{**scene, "effects": (effect,)}), words)


def _law(material: Material, beside: Material, words: str, **scene: Any) -> Comparison:
    return Comparison(Scene(beside, **scene), Scene(material, **scene), words)


THROWN: dict[str, Any] = {"place": (-0.4, 0.3, 0.0), "velocity": (1.4, 1.8, 0.0), "seconds": 0.6}
LANDING: dict[str, Any] = {"body": BRICK, "place": (-0.3, 0.35, 0.0), "velocity": (1.5, -1.0, 0.0), "ground": Sticky()}
POURED: dict[str, Any] = {"body": COLUMN, "place": (0.0, 0.25, 0.0), "velocity": (0.0, -0.5, 0.0), "ground": Sticky()}

COMPARISONS: dict[str, Comparison] = {
    "NeoHookean": _law(NeoHookean(E=2e5, nu=0.3), RUBBER, "E = 200 kPa (left: 30 kPa)"),
    "Newtonian": _law(
        Newtonian(mu=200.0, kappa=1e5), Newtonian(mu=2.0, kappa=1e5), "mu = 200 Pa s (left: 2 Pa s)", **POURED
    ),
    "VonMises": _law(
        VonMises(E=1e5, nu=0.3, tau_y=4000.0),
        NeoHookean(E=1e5, nu=0.3),
        "tau_y = 4 kPa (left: elastic)",
        ground=Sticky(),
    ),
    "ViscoplasticVonMises": _law(
        ViscoplasticVonMises(mu=1e4, kappa=1e5, tau_y=800.0, eta=1.0),
        SYRUP,
        "tau_y = 800 Pa, eta = 1 Pa s (left: a Newtonian liquid)",
        **POURED,
    ),
    "DruckerPrager": _law(
        DruckerPrager(theta=40.0, E=3e5, nu=0.3),
        DruckerPrager(theta=10.0, E=3e5, nu=0.3),
        "friction angle 40° (left: 10°)",
        **POURED,
    ),
    "LinearDrag": _with(LinearDrag(3.0), "drag = 3 1/s", **THROWN),
    "QuadraticDrag": _with(QuadraticDrag(2.0), "drag_per_length = 2 1/m", **THROWN),
    "UniformForce": _with(UniformForce(push_x=1.5), "push_x = 1.5 m/s²"),
    "CentralForce": _with(
        CentralForce(pull=30.0, central_x=0.4, central_y=0.5, central_z=0.0),
        "pull = 30 1/s², to the right",
        place=(-0.1, 0.55, 0.0),
    ),
    "GravityMagnitude": _with(GravityMagnitude(5.0), "extra_gravity = 5 m/s²"),
    "Magnus": _with(Magnus(0.03, spin=(0.0, 0.0, 100.0)), "magnus = 0.03, spin 100 rad/s", **THROWN),
    "InitialSpin": _with(InitialSpin(spin_z=-12.0), "spin_z = -12 rad/s", body=BRICK),
    "KelvinVoigt": _with(KelvinVoigt(100.0), "solid_viscosity = 100 Pa s"),
    "YieldStress": _with(YieldStress(2500.0, 0.0), "yield_stress = 2.5 kPa", ground=Sticky()),
    "Cohesion": _with(Cohesion(500.0), "cohesion = 500 Pa", material=SAND, **POURED),
    "ShearThinning": _with(
        ShearThinning(0.3, 1.0),
        "power_index = 0.3, onset_rate = 1 1/s",
        material=Newtonian(mu=400.0, kappa=1e5),
        **POURED,
    ),
    "SurfaceTension": _with(
        SurfaceTension(20.0), "surface_tension = 20 N/m", material=SYRUP, place=(0.0, 0.4, 0.0), ground=Slip()
    ),
    "ThermalSoftening": _with(ThermalSoftening(6.0), "softening = 6 1/s"),
    "Adhesion": _with(
        Adhesion(0.1, 0.5), "detachment_speed = 0.1 m/s, restitution 0.5 (left: it sticks)", ground=Sticky()
    ),
    "GroundFriction": _with(GroundFriction(0.1), "ground_friction = 0.1 (left: it sticks)", **LANDING),
    "StiffnessGradient": _with(StiffnessGradient(stiffness_gradient_x=12.0), "12 1/m along x", body=BRICK),
    "DensityGradient": _with(DensityGradient(density_gradient_x=12.0), "12 1/m along x", body=BRICK),
    "CameraShift": _with(CameraShift(shift_x=0.04, shift_y=0.0), "shift_x = 0.04 m"),
    "CameraRotation": _with(CameraRotation(tilt=0.0, pan=0.0, roll=8.0), "roll = 8°"),
    "CameraDrift": _with(CameraDrift(drift_x=0.2, drift_y=0.0), "drift_x = 0.2 m/s"),
    "TimeOffset": _with(TimeOffset(time_offset=-0.06), "time_offset = -0.06 s"),
    "Exposure": _with(Exposure(gain=0.6), "gain = 0.6"),
    "RadialDistortion": _with(RadialDistortion(k1=1.9), "k1 = 1.9", **THROWN),
}
"""By the name of the class. Effects are stronger than a recording would have them, so that one sees them."""
