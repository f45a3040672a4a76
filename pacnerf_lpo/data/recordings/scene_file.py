"""``scene.yaml``: what is special about a scene, every value with where it comes from and how sure it is."""

import json
import math
from collections import Counter
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.recordings.conversion import Scene
from pacnerf_lpo.data.recordings.recording import WATER
from pacnerf_lpo.data.recordings.written_scene import NEXT
from pacnerf_lpo.quantities import yaml_list
from pacnerf_lpo.scene_folder import SCENE_FILE

MARGIN = 0.06
"""Free room around the outlines' box, relative to its longest edge."""
SPACING = 0.25
"""Coarsest voxel relative to the longest edge of the body: two halvings leave sixteen voxels along it."""
RATE = 300.0
"""Substeps per second times the coarsest voxel [m/s]: bodies of up to 1 MPa stay stable after two halvings."""


def write_scene_file(scene: Scene) -> Path:
    """Write ``scene.yaml`` next to the images; returns its path.

    Lengths are those of the body: the box from the outlines of frame 0, the voxels a quarter of its longest edge, the
    substeps so many that an elastic wave crosses less than a voxel in each.
    """
    found = scene.findings
    size = float((found.upper - found.lower).max())
    lower = found.lower - MARGIN * size
    lower[1] = max(0.0, lower[1])
    spacing = voxel_for(size)
    frame_rate = float(f"{1.0 / float(np.diff(scene.times).mean()):.6g}")
    substep_rate = steps_for(spacing, frame_rate)
    by = "--fps" if "--fps" in scene.recording.options else "the times of the recording"
    clock = f"{scene.times[-1]:.4g} s by {by}"
    stated = scene.recording.density
    how = "by --density" if stated is not None else "assumed: water, as nobody stated it; --density states it"
    # cameras that are out of step see the body at different places at frame 0
    velocity = f"  velocity: {_corner(found.velocity)} # m/s, from free fall; lines the cameras up at frame 0\n"
    error = f"  ground_error: {found.ground_error:.2g} # m; so far from y = 0 the ground may be, as it was measured\n"
    path = scene.folder / SCENE_FILE
    path.write_text(
        f"""\
# Written by pacnerf-lpo init from {scene.recording.source}, layout {scene.recording.layout}.
# Every value can be changed; the images and poses next to this file are in metres, y up, the ground at y = 0.
# cameras: {_cameras(scene)}
# mattes: {_mattes(scene)}
# clocks: {NEXT.join((scene.clocks, *scene.mended))}
# up: {found.up_why}
# scale: 1 unit of the calibration = {found.scale:.6g} m: {found.scale_why}
# ground: {found.ground.why}
data:
  root: {json.dumps(str(scene.folder.resolve()), ensure_ascii=False)} # this folder; change it when the folder is moved
  box_lower: {_corner(lower)} # m; the outlines of all views at frame 0, and {100 * MARGIN:.0f} % of free room
  box_upper: {_corner(found.upper + MARGIN * size)}
{velocity if scene.offsets.any() else ""}physics:
{error if found.ground_error else ""}\
  gravity: {_corner(found.gravity)} # m/s^2; 9.81 unless --gravity says otherwise, its direction is that of up
  rho: {stated or WATER:g} # kg/m^3; {how}; moduli, stresses and viscosities are proportional to it
  material: auto # elastic, viscous, granular, plastic and viscoplastic laws compete; a law that you know goes here
  #   class_path: NeoHookean # Newtonian, DruckerPrager, VonMises or ViscoplasticVonMises
  #   init_args: {{E: 1.0e+5, nu: 0.3}} # where identification starts, SI units; a factor of ten off is fine
  frame_rate: {frame_rate:g} # 1/s; {len(scene.times)} frames, {clock}
  substep_rate: {substep_rate:.1f} # 1/s; {RATE:g} m/s divided by base_spacing, in whole steps per frame
phases:
  static:
    class_path: StaticGridModule
    init_args:
      base_spacing: {spacing:g} # m; coarsest voxel, a quarter of the body's longest edge, {size:.2g} m
      entropy_weight: 1.0e-3 # the papers' value for elastic scenes
      surface_weight: 1.0e-3 # the papers' value for elastic scenes
  velocity:
    class_path: VelocityModule
    init_args:
      hit_frame: {found.hit_frame.value:.0f} # first frame on the ground; {found.hit_frame.why}
"""
    )
    return path


def voxel_for(size: float) -> float:
    """Coarsest voxel of a body whose longest edge is ``size`` [m]."""
    return float(f"{SPACING * size:.2g}")


def steps_for(spacing: float, frame_rate: float) -> float:
    """Integration steps per second for a coarsest voxel [m], a whole number for each of ``frame_rate`` frames [1/s]."""
    return frame_rate * math.ceil(RATE / spacing / frame_rate)


def _cameras(scene: Scene) -> str:
    cameras = scene.recording.cameras
    bent = sum(camera.lens.distorts for camera in cameras)
    names = ", ".join(f"{number} {camera.name}" for number, camera in enumerate(cameras))
    return f"{names}; {f'{bent} of them undistorted' if bent else 'no lens distortion stated'}"


def _mattes(scene: Scene) -> str:
    counted = Counter(scene.mattes)
    how = ", ".join(f"by {way} in {count} cameras" for way, count in counted.items())
    if len(counted) == 1:
        how = f"by {scene.mattes[0]}, in all cameras"
    worst = int(np.argmin(scene.overlaps))
    if scene.overlaps[worst] == 1.0:
        return how
    sure = f"overlap (IoU) expected with the truth {np.mean(scene.overlaps):.2f}"
    sure += f", in the worst camera, {scene.recording.cameras[worst].name}, {scene.overlaps[worst]:.2f}"
    return f"{how}; {sure}, if their colours tell object and background apart; a common error of all views is not in it"


def _corner(corner: np.ndarray) -> str:
    return yaml_list((corner.round(6) + 0.0).tolist(), digits=4)
