"""The phases of Algorithm 1; importing them makes their short names known to the command line."""

from pacnerf_lpo.phases.base import AbstractPhase
from pacnerf_lpo.phases.grid_optimization import GridOptimizationModule
from pacnerf_lpo.phases.identification_methods import GaussNewton, IdentificationMethod, PaperAdam
from pacnerf_lpo.phases.law_choice import LawChoice
from pacnerf_lpo.phases.lpo import LPOModule
from pacnerf_lpo.phases.outline_method import OutlineGaussNewton
from pacnerf_lpo.phases.physics_id import PhysicsIDModule
from pacnerf_lpo.phases.velocity import VelocityModule
