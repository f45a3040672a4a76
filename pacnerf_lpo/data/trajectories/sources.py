"""From files of positions to scenes of measured flights: what ``init`` does where there are no cameras."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path
from typing import TypeVar

import numpy as np

from pacnerf_lpo.data.measurements import commented, read_ply
from pacnerf_lpo.data.recordings.media import library
from pacnerf_lpo.data.trajectories.flight import find_direction, investigate, noises, outlying
from pacnerf_lpo.data.trajectories.scene import Solid, check_solid, write_scene
from pacnerf_lpo.data.trajectories.tables import UNITS, read_spins, read_table
from pacnerf_lpo.data.trajectories.trajectory import Trajectory, check_trajectory
from pacnerf_lpo.errors import UserInputError

TABLES = (".csv", ".tsv")
NOTES = ".txt"
"""A table where it is the source itself; in a folder, what somebody has noted next to the tables."""
MARKERS = ".c3d"
Result = TypeVar("Result")


def holds_positions(source: Path) -> bool:
    """Whether a source is a file of positions, or a folder of nothing else."""
    if source.is_file():
        return source.suffix.lower() in (*TABLES, NOTES, MARKERS)
    inside = [path for path in source.iterdir() if not path.name.startswith(".")] if source.is_dir() else []
    kinds = {path.suffix.lower() for path in inside if path.is_file()} - {NOTES}
    alone = bool(kinds) and all(path.is_file() for path in inside)
    return alone and (kinds <= {*TABLES, MARKERS} or kinds == {".ply"})


def read_source(source: Path, fps: float | None, spins: Path | None) -> list[Trajectory]:
    """All recordings of a CSV or C3D file, of all such files in a folder, or of a folder of PLY clouds, of ``fps``
    samples a second where they count frames, with the measured ``spins`` of a CSV. Raises UserInputError where a file
    cannot be read, or its positions cannot be used.
    """
    if not source.exists():
        raise UserInputError(f"{source}: there is no such file or folder; give the one with the positions")
    if source.is_dir() and any(source.glob("*.ply")):
        found = [read_clouds(source, fps)]
    else:
        paths = [source] if source.is_file() else sorted(source.iterdir())
        paths = [p for p in paths if spins is None or p.resolve() != spins.resolve()]
        paths = [p for p in paths if source.is_file() or p.suffix.lower() in (*TABLES, MARKERS)]
        if not paths:
            raise UserInputError(f"{source}: holds no CSV, C3D or PLY file with positions")
        found = [one for p in paths for one in ([read_c3d(p)] if p.suffix.lower() == MARKERS else read_table(p, fps))]
    return found if spins is None else list(_turning(found, spins))


def _turning(found: Sequence[Trajectory], path: Path) -> Iterator[Trajectory]:
    """The recordings with the spins of a file: by their names, or by the numbers in them."""
    spins = read_spins(path)
    numbered = {int(name): spin for name, spin in spins.items() if name.isdigit()}
    for one in found:
        spin = spins.get(one.name, numbered.get(int(one.name)) if one.name.isdigit() else None)
        if spin is None:
            raise UserInputError(
                f"{path}: has no row for the recording {one.name}; it has {', '.join(list(spins)[:5])} ..."
            )
        yield replace(one, spin=np.array(spin))


def _each(step: Callable[[Trajectory], Result], recordings: Sequence[Trajectory]) -> tuple[list[Result], list[str]]:
    """A step for every recording, and what is said against those for which it failed; an error where that is all."""
    found, against = [], []
    for one in recordings:
        try:
            found.append(step(one))
        except UserInputError as error:
            against.append(f"left out: {error}")
    if not found:
        raise UserInputError(against[0].removeprefix("left out: "))
    return found, against


def make_scenes(
    recordings: Sequence[Trajectory], folder: Path, solid: Solid, up: str | None, unit: str | None, start: str | None
) -> tuple[list[Path], list[str]]:
    """Write a scene for every recording: into the folder itself, or into one of its own for each of several. Of
    several, those that cannot be used are left out. Returns the folders, and a sentence for each that was left out.
    Raises UserInputError where the body cannot be, or direction, unit or flight are not those of the recordings.
    """
    check_solid(solid, "init")
    usable, left_out = _each(check_trajectory, recordings)
    direction = find_direction(usable, up, unit)
    found, short = _each(lambda one: investigate(one, direction, start), usable)
    left_out += short
    odd = outlying(found)
    left_out += [f"left out: {one.one.name} is no smooth path, unlike the others" for one in compress(found, odd)]
    found = [flight for flight, is_odd in zip(found, odd, strict=True) if not is_odd]
    noise = list(noises(found))
    folders = [folder / flight.one.name if len(recordings) > 1 else folder for flight in found]
    for path, flight in zip(folders, found, strict=True):
        write_scene(path, flight, solid, noise, direction)
    return folders, left_out


def read_c3d(path: Path) -> Trajectory:
    """The mean of all markers at the times at which all are seen. Raises UserInputError where the library is missing,
    or the file is damaged or holds no markers.
    """
    c3d = library("c3d", f"{path}: reading C3D")
    try:
        with path.open("rb") as file:
            reader = c3d.Reader(file)
            rate, first = float(reader.point_rate), reader.first_frame
            names = [label.strip() for label in reader.point_labels]
            frames = [(number, points) for number, points, _ in reader.read_frames(copy=True)]
            said = reader.get("POINT:UNITS")
            unit = said.string_value.strip().lower() if said is not None else ""
    except (OSError, ValueError, AssertionError, KeyError, TypeError, IndexError, AttributeError, EOFError) as error:
        raise UserInputError(f"{path}: is no readable C3D file ({' '.join(str(error).split()) or 'damaged'})") from None
    if not frames or not names or not rate > 0:
        raise UserInputError(f"{path}: holds no markers with a frame rate; export the trajectories again")
    if unit and unit not in UNITS:
        raise UserInputError(f"{path}: its unit {unit} is not known; export it in {', '.join(UNITS)}")
    times = np.array([(number - first) / rate for number, _ in frames])
    whole = np.array([points[:, :3] for _, points in frames], float)
    lost = np.array([points[:, 3] < 0 for _, points in frames])
    seen = ~lost.any(1) & np.isfinite(whole).all((1, 2))
    how = f"the mean of {len(names)} markers that move with the body" if len(names) > 1 else f"the marker {names[0]}"
    return Trajectory(path.stem, times[seen], whole[seen].mean(1), str(path), UNITS.get(unit), how=how)


def read_clouds(folder: Path, fps: float | None) -> Trajectory:
    """The centroids of the clouds in a folder, one PLY for each frame, by the number in their names, or at the time
    that a header says in a comment line ``comment time_s 0.125``. Raises UserInputError where a file cannot be read, or
    there is neither a time nor a frame rate.
    """
    times, places = [], []
    for path in sorted(folder.glob("*.ply")):
        points, comments = read_ply(path)
        points = points[np.isfinite(points).all(1)]
        digits = "".join(c if c.isdigit() else " " for c in path.stem).split()
        time = commented(path, comments, "time_s", np.nan)
        if np.isnan(time):
            if not (fps and digits):
                raise UserInputError(f"{path}: says no time; give --fps, and a number in the name of each file")
            time = int(digits[-1]) / fps
        times.append(time)
        places.append(points.mean(0) if len(points) else np.full(3, np.nan))
    order = np.argsort(times, kind="stable")
    whole = np.array(times)[order], np.array(places)[order]
    return Trajectory(folder.name, *whole, str(folder), how="the centroid of each cloud of points")
