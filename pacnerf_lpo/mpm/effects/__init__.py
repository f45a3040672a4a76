"""Physical effects in addition to material, ground and gravity, one per file."""

from pacnerf_lpo.mpm.effects.adhesion import Adhesion
from pacnerf_lpo.mpm.effects.base import BodyForce, Effect, GroundEffect, InitialState, LawEffect, Softening
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
