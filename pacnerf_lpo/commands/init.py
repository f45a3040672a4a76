"""``pacnerf-lpo init``: from any common recording to a scene that can be fitted."""

from pathlib import Path
from typing import Literal

from pacnerf_lpo.data.index import check_unused
from pacnerf_lpo.data.recordings.conversion import convert, forget_mattes
from pacnerf_lpo.data.recordings.layouts import Format, read_recording
from pacnerf_lpo.data.recordings.look import examine
from pacnerf_lpo.data.recordings.recording import GRAVITY
from pacnerf_lpo.data.recordings.scene_file import write_scene_file
from pacnerf_lpo.data.recordings.scene_warnings import scene_warnings
from pacnerf_lpo.data.trajectories.scene import Solid
from pacnerf_lpo.data.trajectories.sources import holds_positions, make_scenes, read_source
from pacnerf_lpo.heartbeat import doing


def run(
    source: str,
    scene: str,
    format: Format | None = None,
    unit: str | None = None,
    up: str | None = None,
    ground: float | None = None,
    ground_normal: list[float] | None = None,
    gravity: float = GRAVITY,
    density: float | None = None,
    fps: float | None = None,
    leave_out: list[str] | None = None,
    shape: str | None = None,
    size: list[float] | None = None,
    mass: float | None = None,
    spins: str | None = None,
    start: Literal["held", "flying"] | None = None,
) -> None:
    """Read a recording in any common layout and write a scene: scene.yaml, ready for fit, and scene.html to look at.

    Images are undistorted and matted, lengths become metres, y points up and the ground is y = 0. The box, the ground,
    the first contact, how far cameras are out of step and, where the layout does not say them, the up direction and the
    scale are measured: from the outlines, and from free fall at 9.81 m/s^2. What cannot be measured is asked.

    Positions without a video (CSV, C3D, a folder of either or of PLY clouds) become the flight of a known body, or a
    folder of several, ready for diagnose: until it first touches something, in metres, y up.

    example: pacnerf-lpo init recordings/drop scenes/drop --unit mm

    example: pacnerf-lpo init drops.csv scenes/drops --shape Ball --size 0.067 --mass 0.058

    Args:
        source: folder with the recording; a calibration, and videos or images of cameras that stand still; or
            positions.
        scene: folder to write, absent or empty.
        format: layout of the recording; recognised when not given.
        unit: of the calibration's lengths: m, cm, mm, or how many metres one unit is.
        up: axis of the calibration that points up (x, -z), or three numbers, or fall: as the object falls.
        ground: height of the ground along that axis, or along its normal, in the calibration's unit.
        ground_normal: direction at a right angle to a ground that is not level, in the calibration's axes.
        gravity: its strength [m/s^2]; 0 for none.
        density: of the body in a video [kg/m^3]; that of water when not given. Moduli are proportional to it.
        fps: frames per second of the videos, instead of what their files say.
        leave_out: names of cameras not to be used.
        shape: of positions, the body: Ball, Block, Torus, or a mesh file.
        size: of it in metres: diameter of a ball, edges of a block, outer diameter and thickness of a torus, longest
            extent of a mesh that is not in metres.
        mass: of it in kilograms.
        spins: CSV of the spins that were measured: recording, spin_x, spin_y, spin_z in rad/s.
        start: whether the body is held at first and let go, or flying already; measured when not given.
    """
    if shape is not None or holds_positions(Path(source)):
        solid = Solid.stated(source, shape, size, mass)
        check_unused(Path(scene))
        doing("reading the recordings")
        flights = read_source(Path(source), fps, None if spins is None else Path(spins))
        print(f"{source}: {len(flights)} recordings of positions", flush=True)
        folders, left_out = make_scenes(flights, Path(scene), solid, up, unit, start)
        print("\n".join([*left_out, f"{folders[0] / 'scene.yaml'}: every value with where it comes from"]))
        print(f"{len(folders)} flights; look through that, then\npacnerf-lpo diagnose {scene}")
        return
    doing("reading the recording")
    forget_mattes(Path(scene))
    recording = read_recording(Path(source), format)
    if fps is not None:
        recording = recording.with_frame_rate(fps)
    if unit is not None:
        recording = recording.with_unit(unit)
    if up is not None:
        recording = recording.with_up(up)
    recording = recording.with_ground(ground, ground_normal).with_gravity(gravity).with_density(density)
    if leave_out:
        recording = recording.without(leave_out)
    print(f"{source}: layout {recording.layout}, {len(recording.cameras)} cameras", flush=True)
    doing("finding outlines, clocks, up, scale and ground")
    written = convert(recording, Path(scene))
    path, found = write_scene_file(written), written.findings
    print("\n".join((f"clocks: {written.clocks}", *written.mended)))
    print(f"up: {found.up_why}\nscale: {found.scale:.6g} m per unit, {found.scale_why}\nground: {found.ground.why}")
    print(f"contact: frame {found.hit_frame.value:.0f} of {len(written.times)}, {found.hit_frame.why}")
    if recording.density is None:
        print("density: that of water is assumed; moduli, stresses and viscosities are proportional to it: --density")
    page = look_at(Path(scene))
    print(f"{page}: whether all of it is right; {path}: every value with where it comes from")
    print(
        f"look at both (after a change, pacnerf-lpo report {scene} draws the page again), then\npacnerf-lpo fit {scene}"
    )


def look_at(scene: Path) -> Path:
    """Draw the page of a scene as its scene.yaml is now, and print what is doubtful; returns the page's path."""
    from pacnerf_lpo.report.scene_page import write_scene_page

    doing("looking at the scene")
    look = examine(scene)
    warnings = scene_warnings(look)
    for warning in warnings:
        print(f"warning: {warning}", flush=True)
    doing("drawing the page")
    return write_scene_page(look, warnings)
