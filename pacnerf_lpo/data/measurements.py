"""Measurements other than images: tracked points (CSV) and point clouds (one PLY per frame), read and checked.

Every reader raises UserInputError, one line: what is wrong, in which file and row, and how to mend it.
"""

import difflib
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyParseError

from pacnerf_lpo.data.trajectories.tables import Table, read_cells
from pacnerf_lpo.errors import UserInputError

COLUMNS = ("time_s", "id", "x_m", "y_m", "z_m")
SIGMA = "sigma_m"
FARTHEST = 100.0
"""Coordinates beyond this [m] are taken for millimetres."""
TIME_TOLERANCE = 1e-3
"""Times may lie outside the video by this much [s]: they are often written with three digits."""
LEAST_SIGMA = 1e-5
CLOUD_NAME = re.compile(r"cloud_(\d+)\.ply$")
LEAST_POINTS = 20


@dataclass(frozen=True)
class TrackedPoints:
    """Points of the body's material, followed over time. Rows are sorted by time.

    times: [s, (M,)]
    ids: which point it is [(M,), str]
    positions: [m, (M, 3)]
    sigma: standard deviation of every coordinate [m, (M,)]
    source: where they were read from, for messages
    """

    times: np.ndarray
    ids: np.ndarray
    positions: np.ndarray
    sigma: np.ndarray
    source: str = ""

    def thinned(self, most: int) -> "TrackedPoints":
        """At most so many of the points, evenly spread over their names."""
        names = np.unique(self.ids)
        return self._where(np.isin(self.ids, names[:: -(-len(names) // most)]))

    def seen_until(self, time: float) -> "TrackedPoints":
        """The points that are first seen until then [s], with all of their rows."""
        early = self.ids[self.times <= time + TIME_TOLERANCE]
        return self._where(np.isin(self.ids, early))

    def _where(self, rows: np.ndarray) -> "TrackedPoints":
        return TrackedPoints(self.times[rows], self.ids[rows], self.positions[rows], self.sigma[rows], self.source)


@dataclass(frozen=True)
class PointClouds:
    """Points on the body's surface or within it, at some times, without identity.

    times: [s, (C,)], increasing
    points: one array per time [m, (n, 3)]
    sigma: standard deviation of the coordinates of each cloud [m, (C,)]; 0 where unknown
    source: where they were read from, for messages
    """

    times: np.ndarray
    points: list[np.ndarray]
    sigma: np.ndarray
    source: str = ""


def read_tracked_points(path: str | Path, video_times: Sequence[float]) -> TrackedPoints:
    """Read a CSV with the columns time_s, id, x_m, y_m, z_m and, if known, sigma_m, at any times between those of the
    frames that the model is simulated for, ``video_times`` [s, (F,)].

    Without sigma_m, the noise is estimated from the roughness of the tracks.
    """
    table = read_cells(Path(path), ",".join(COLUMNS))
    header = table.header[-1] if table.header else []
    columns = {name: _column(table.path, header, name) for name in COLUMNS}
    if SIGMA in header:
        columns[SIGMA] = header.index(SIGMA)
    ids = table.words(columns.pop("id"), "id")
    numbers = {name: table.numbers(column, name, needed=True) for name, column in columns.items()}
    positions = np.stack([numbers[name] for name in ("x_m", "y_m", "z_m")], axis=1)
    _check_rows(table, ids, numbers, positions, video_times)
    order = np.argsort(numbers["time_s"], kind="stable")
    times, names, positions = numbers["time_s"][order], np.array(ids)[order], positions[order]
    sigma = numbers[SIGMA][order] if SIGMA in numbers else np.full(len(times), track_noise(times, names, positions))
    return TrackedPoints(times, names, positions, sigma, str(table.path))


def track_noise(times: np.ndarray, ids: np.ndarray, positions: np.ndarray) -> float:
    """Standard deviation of the noise of tracks [m], from the departure of points from their neighbours in time, by
    sorted times [s, (M,)], ids (M,) and positions [m, (M, 3)].

    A point is compared with the parabola through the two before and the one after it (third differences, which smooth
    motion leaves small); the median makes a few impacts harmless. Tracks of fewer than four points say nothing.
    """
    departures = []
    for name in np.unique(ids):
        t, x = times[ids == name], positions[ids == name]
        for i in range(len(t) - 3):
            nodes = t[i : i + 4]
            weights = 1 / np.array([np.prod(node - np.delete(nodes, k)) for k, node in enumerate(nodes)])
            departures.append(weights @ x[i : i + 4] / np.linalg.norm(weights))
    if not departures:
        return 1e-3
    return max(1.4826 * float(np.median(np.abs(departures))), LEAST_SIGMA)


def read_point_clouds(folder: str | Path, video_times: Sequence[float]) -> PointClouds:
    """Read ``cloud_000.ply`` and so on: the number is that of the video's frame, of those that the model is simulated
    for [s, (F,)].

    A header may say otherwise, in comment lines: ``comment time_s 0.125`` and ``comment sigma_m 0.002``.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserInputError(f"{folder}: there is no such folder; give one with cloud_000.ply and so on")
    paths = sorted(path for path in folder.glob("*.ply") if CLOUD_NAME.search(path.name))
    if not paths:
        raise UserInputError(f"{folder}: holds no cloud_000.ply; name the files cloud_<frame>.ply")
    found = sorted(((*_read_cloud(path, video_times), path) for path in paths), key=lambda cloud: cloud[0])
    for (before, *_, earlier), (time, *_, path) in itertools.pairwise(found):
        if time == before:
            raise UserInputError(f"{path}: taken at {time:g} s, as {earlier.name}; remove one")
    times, clouds, sigmas, _ = zip(*found, strict=True)
    return PointClouds(np.array(times), list(clouds), np.array(sigmas), str(folder))


def _column(path: Path, header: list[str], name: str) -> int:
    if name in header:
        return header.index(name)
    others = [other for other in header if other not in (*COLUMNS, SIGMA)]
    near = difflib.get_close_matches(name, others, n=1, cutoff=0.3)
    mend = f"rename '{near[0]}' if that is meant" if near else f"the header must read {','.join(COLUMNS)}"
    raise UserInputError(f"{path}, line 1: the column {name} is missing; {mend}")


def _check_rows(
    table: Table, ids: list[str], numbers: dict[str, np.ndarray], positions: np.ndarray, video_times: Sequence[float]
) -> None:
    seen: dict[tuple[str, float], int] = {}
    for index, (line, name, time) in enumerate(zip(table.lines, ids, numbers["time_s"].tolist(), strict=True)):
        where = f"{table.path}, line {line}"
        _check_time(where, time, video_times)
        _check_near(where, positions[index])
        if SIGMA in numbers and numbers[SIGMA][index] <= 0:
            raise UserInputError(f"{where}: {SIGMA} {numbers[SIGMA][index]:g} must be positive; write metres")
        if (name, time) in seen:
            raise UserInputError(f"{where}: id {name} at {time:g} s is also in line {seen[name, time]}; remove one")
        seen[name, time] = line
    if len(set(ids)) == len(ids):
        raise UserInputError(
            f"{table.path}: no id occurs twice, so nothing is followed; give a point the same id at all times"
        )


def _check_time(where: str, time: float, video_times: Sequence[float]) -> None:
    if not video_times[0] - TIME_TOLERANCE <= time <= video_times[-1] + TIME_TOLERANCE:
        raise UserInputError(
            f"{where}: time {time:g} s lies outside the video, {video_times[0]:g} to {video_times[-1]:g} s; "
            "shift the clock, write seconds, or remove the row"
        )


def _check_near(where: str, point: np.ndarray) -> None:
    if (far := float(np.abs(point).max())) > FARTHEST:
        raise UserInputError(f"{where}: a coordinate of {far:g} m is no scene of this kind; divide millimetres by 1000")


def read_ply(path: Path) -> tuple[np.ndarray, list[str]]:
    """Vertices [(N, 3)] and comments of a PLY file. Raises UserInputError where it is damaged or has none."""
    try:
        data = PlyData.read(str(path))
        vertex = data["vertex"]
    except (PlyParseError, KeyError, ValueError, EOFError) as error:
        raise UserInputError(
            f"{path}: no PLY with vertices ({' '.join(str(error).split())}); export it again"
        ) from None
    names = [part.name for part in vertex.properties]
    for axis in "xyz":
        if axis not in names:
            raise UserInputError(f"{path}: vertices have no '{axis}', but {', '.join(names)}; export x, y, z in metres")
    return np.stack([np.asarray(vertex[axis], float) for axis in "xyz"], axis=1), list(data.comments)


def _read_cloud(path: Path, video_times: Sequence[float]) -> tuple[float, np.ndarray, float]:
    """Time [s], points [m, (n, 3)] and standard deviation [m] of a cloud."""
    points, comments = read_ply(path)
    if len(points) < LEAST_POINTS:
        raise UserInputError(
            f"{path}: holds {len(points)} points; at least {LEAST_POINTS} make a cloud, remove the file"
        )
    bad = np.flatnonzero(~np.isfinite(points).all(1))
    if len(bad):
        raise UserInputError(f"{path}: vertex {bad[0]} holds NaN or infinity; remove such points before export")
    worst = int(np.abs(points).max(1).argmax())
    _check_near(f"{path}, vertex {worst}", points[worst])
    number = int(CLOUD_NAME.findall(path.name)[0])
    default = video_times[number] if number < len(video_times) else np.inf
    time = commented(path, comments, "time_s", default)
    if np.isinf(time):
        raise UserInputError(
            f"{path}: the video has frames 0 to {len(video_times) - 1}; renumber the file, or write 'comment time_s' "
            "in its header"
        )
    _check_time(str(path), time, video_times)
    sigma = commented(path, comments, SIGMA, 0.0)
    if sigma < 0:
        raise UserInputError(f"{path}: {SIGMA} {sigma:g} is negative; write the standard deviation in metres")
    return time, points, sigma


def commented(path: Path, comments: list[str], key: str, default: float) -> float:
    """The number that a comment line of a PLY file gives for a key. Raises UserInputError where it is no number."""
    for comment in comments:
        name, _, value = comment.strip().partition(" ")
        try:
            if name == key:
                return float(value)
        except ValueError:
            raise UserInputError(
                f"{path}: 'comment {comment}' does not read 'comment {key} <number>'; mend it"
            ) from None
    return default
