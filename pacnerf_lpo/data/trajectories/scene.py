"""The scene of a measured flight: ``scene.yaml`` and ``track.csv`` in a folder, and a folder of such folders.

``track.csv`` has the columns time_s, x_m, y_m and z_m, y up; what was not measured is empty.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.recordings.files import read_values
from pacnerf_lpo.data.recordings.recording import GRAVITY
from pacnerf_lpo.data.shapes import Shape, named_shape
from pacnerf_lpo.data.trajectories.flight import Direction, Findings
from pacnerf_lpo.data.trajectories.noise import Noise
from pacnerf_lpo.data.trajectories.tables import read_table
from pacnerf_lpo.data.trajectories.trajectory import AXES, Trajectory, check_trajectory
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.quantities import yaml_list, yaml_number

NAME, TRACK = "scene.yaml", "track.csv"
SECTION = "flight"


@dataclass(frozen=True)
class Solid:
    """The body as the user described it.

    shape: class of a shape, or a mesh file.
    size: extents [m], see :func:`~pacnerf_lpo.data.shapes.named_shape`.
    mass: [kg]
    """

    shape: str
    size: tuple[float, ...]
    mass: float

    @staticmethod
    def stated(source: str, shape: str | None, size: Sequence[float] | None, mass: float | None) -> "Solid":
        """What the user said of the body. Raises UserInputError where something is missing."""
        given = {"--shape": shape, "--size": size or Path(shape or "").suffix, "--mass": mass}
        missing = [name for name, value in given.items() if value is None or value == ""]
        if missing:
            raise UserInputError(
                f"{source}: positions without a video need the body: {', '.join(missing)} missing, for example --shape "
                "Ball --size 0.04 --mass 0.0027 (metres and kilograms)"
            )
        return Solid(str(shape), tuple(size or ()), float(mass or 0.0))

    def make(self) -> Shape:
        return named_shape(self.shape, self.size)


@dataclass(frozen=True)
class Scene:
    """A scene as it was read.

    one: the flight in metres, y up, from 0 s on.
    held: whether it is held at first.
    noise: of every coordinate, None where it was not measured.
    guess: start, velocity and release [SI]
    gravity: [m/s^2, (3,)]
    """

    one: Trajectory
    solid: Solid
    held: bool
    noise: tuple[Noise | None, ...]
    guess: dict[str, float]
    gravity: tuple[float, float, float]


def scenes_in(folder: Path) -> list[Path]:
    """The scene in a folder, or those in its folders; none where it is something else."""
    inside = sorted(folder.iterdir()) if folder.is_dir() else []
    scenes = [path for path in (folder, *inside) if (path / NAME).is_file() and (path / TRACK).is_file()]
    return [folder] if folder in scenes else scenes


def write_scene(
    folder: Path, found: Findings, solid: Solid, noise: Sequence[Noise | None], direction: Direction
) -> None:
    """Write ``scene.yaml`` and ``track.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    one = found.one
    with (folder / TRACK).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", *(f"{axis}_m" for axis in AXES)])
        for time, position in zip(one.times, one.positions, strict=True):
            writer.writerow([f"{time:.6f}", *("" if math.isnan(x) else f"{x:.6f}" for x in position)])
    spin, spin_why = "null", "not measured; give it with --spins"
    if one.spin is not None:
        spin, spin_why = yaml_list(one.spin.tolist()), "measured, in the axes of this scene"
    errors = {axis: one for axis, one in zip(AXES, noise, strict=True) if one is not None}
    written = {axis: map(yaml_number, (one.white, one.slow, one.lasting)) for axis, one in errors.items()}
    noises = "\n".join(
        f"    {axis}: {{white: {white}, slow: {slow}, lasting: {lasting}}}"
        for axis, (white, slow, lasting) in written.items()
    )
    guess = "\n".join(f"    {name}: {yaml_number(value)}" for name, value in found.guess.items())
    (folder / NAME).write_text(
        f"""\
# Written by pacnerf-lpo init from {one.source}, recording {one.name}.
# Every value can be changed. Positions in {TRACK} are in metres and seconds, y up: {one.how}.
# up: {direction.why}
# scale: 1 unit of the recording = {direction.scale:g} m, {direction.scale_why}
# measured: {", ".join(errors)} in {len(one.times)} samples until {found.end.value:.4g} s; {found.end.why}
{SECTION}:
  shape: {solid.shape} # stated
  size: {yaml_list(solid.size)} # m, stated
  mass: {solid.mass:g} # kg, stated
  held: {str(found.held[0]).lower()} # whether it is held at first and let go later; {found.held[1]}
  spin: {spin} # rad/s; {spin_why}
  noise: # m, s: what is new in a sample, what lasts, and how long; estimated from all recordings of the source
{noises}
  guess: # m, m/s and s; where the fit starts, from the samples themselves
{guess}
physics:
  gravity: [0.0, {-GRAVITY}, 0.0] # m/s^2; assumed
  effects: [] # forces that the model has from the beginning, such as {{class_path: QuadraticDrag}}
"""
    )


def read_scene(folder: Path) -> Scene:
    """What :func:`write_scene` has written, with what a person has changed in it. Raises UserInputError where a value
    is missing or cannot be used.
    """
    path = folder / NAME
    content = read_values(path)
    section = content.get(SECTION) if isinstance(content, dict) else None
    if not isinstance(section, dict):
        raise UserInputError(f"{path}: has no section {SECTION}; make the scene again with pacnerf-lpo init")
    try:
        solid = Solid(str(section["shape"]), tuple(float(x) for x in section["size"]), float(section["mass"]))
        spin = None if section.get("spin") is None else np.array(section["spin"], float).reshape(3)
        said = [section["noise"].get(axis) for axis in AXES]
        names = ("white", "slow", "lasting")
        noise = tuple(None if one is None else Noise(*(float(one[name]) for name in names)) for one in said)
        guess = {name: float(value) for name, value in section["guess"].items()}
        gravity = tuple(float(x) for x in content["physics"]["gravity"])
        held = bool(section["held"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UserInputError(f"{path}: {SECTION} cannot be read ({error}); mend it as init has written it") from None
    (one,) = read_table(folder / TRACK)
    check_solid(solid, str(path))
    named = Trajectory(folder.name, one.times, one.positions, str(folder / TRACK), 1.0, True, spin)
    return Scene(check_trajectory(named), solid, held, noise, guess, gravity)  # type: ignore[arg-type]


def check_solid(solid: Solid, where: str) -> None:
    """Raise UserInputError for a body that cannot be."""
    if not (math.isfinite(solid.mass) and solid.mass > 0):
        raise UserInputError(f"{where}: mass = {solid.mass:g} kg; give the body's weight in kilograms")
    if not all(math.isfinite(x) and x > 0 for x in solid.size):
        raise UserInputError(f"{where}: size = {yaml_list(solid.size)}; give positive lengths in metres")
    solid.make()
