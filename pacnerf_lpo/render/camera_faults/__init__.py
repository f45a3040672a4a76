"""What may be wrong with a camera, one fault per file; they stand in ``physics.effects`` among those of the engine."""

from pacnerf_lpo.render.camera_faults.base import Observation
from pacnerf_lpo.render.camera_faults.camera_drift import CameraDrift
from pacnerf_lpo.render.camera_faults.camera_rotation import CameraRotation
from pacnerf_lpo.render.camera_faults.camera_shift import CameraShift
from pacnerf_lpo.render.camera_faults.exposure import Exposure
from pacnerf_lpo.render.camera_faults.radial_distortion import RadialDistortion
from pacnerf_lpo.render.camera_faults.time_offset import TimeOffset
