"""CSV files of tracked points: long (a row for each point and time), wide (DeepLabCut, Anipose), or bare numbers.

Columns are known by their names: ``time_s``, ``x_mm``, ``height [m]``; a unit may follow a name. A column called
recording (or drop, trial, throw, take ...) numbers several recordings in one file, one called id the points of a body.
"""

import csv
import difflib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pacnerf_lpo.data.recordings.recording import UNITS
from pacnerf_lpo.data.trajectories.trajectory import AXES, Trajectory
from pacnerf_lpo.errors import UserInputError

SECONDS = {"s": 1.0, "ms": 1e-3}
NAMES = {
    "time": ("time", "t", "timestamp"),
    "frame": ("frame", "fnum"),
    **{axis: (axis,) for axis in AXES},
    "height": ("height", "h", "altitude"),
    "id": ("id", "point", "marker", "bodypart", "name"),
    "recording": ("recording", "drop", "trial", "throw", "flight", "take", "shot", "run"),
}
"""What a column may be called, without its unit."""
EXAMPLE = "time_s,x_m,y_m,z_m or time_s,height_m"
EMPTY = ("", "nan", "na", "null", "none")


@dataclass(frozen=True)
class Table:
    """Cells of a file.

    header: rows above the numbers, each as long as the widest.
    lines: numbers of the lines in the file. rows: their cells.
    """

    path: Path
    header: list[list[str]]
    lines: list[int]
    rows: list[list[str]]

    def numbers(self, column: int, called: str, needed: bool = False) -> np.ndarray:
        """A column [(n,)], NaN for empty cells; UserInputError for what is no number, or empty and ``needed``."""
        found = []
        for line, cell in zip(self.lines, self.words(column), strict=True):
            try:
                found.append(np.nan if cell.lower() in EMPTY else float(cell))
            except ValueError:
                raise UserInputError(f"{self.path}, line {line}: {called} '{cell}' is not a number; mend it") from None
            if np.isinf(found[-1]):
                raise UserInputError(f"{self.path}, line {line}: {called} is infinite; leave the cell empty")
            if needed and np.isnan(found[-1]):
                raise UserInputError(_empty(self.path, line, f"{called} is {cell or 'empty'}"))
        return np.array(found)

    def words(self, column: int, needed: str = "") -> list[str]:
        """A column as it is written. Raises UserInputError where a cell of what is ``needed`` is empty."""
        found = [row[column].strip() if column < len(row) else "" for row in self.rows]
        if needed and "" in found:
            raise UserInputError(_empty(self.path, self.lines[found.index("")], f"{needed} is empty"))
        return found


def _empty(path: Path, line: int, what: str) -> str:
    return f"{path}, line {line}: {what}; fill it in or remove the row"


def read_table(path: Path, fps: float | None = None) -> list[Trajectory]:
    """The recordings in a CSV file, see :func:`read_cells`, of ``fps`` samples a second where it counts frames and has
    no times. Raises UserInputError where it cannot be read, or its columns are not understood.
    """
    table = read_cells(path)
    if len(table.header) == 3 or (len(table.header) == 4 and table.header[1][0] == "individuals"):
        return [_deeplabcut(table, fps)]
    if not table.header and len(table.rows[0]) != 4:
        raise UserInputError(
            f"{table.path}: has no header and {len(table.rows[0])} columns; four would be time [s], x, y and z; write "
            f"a header such as {EXAMPLE}"
        )
    names = table.header[-1] if table.header else ["time", *AXES]
    if any(re.fullmatch(r".+_(x|y|z)", name) for name in names) and "x" not in {_plain(name) for name in names}:
        return [_anipose(table, names, fps)]
    return list(_long(table, names, fps))


def read_cells(path: Path, example: str = EXAMPLE) -> Table:
    """The cells of a CSV file; the delimiter is a comma, a semicolon or a tab. Raises UserInputError where it cannot be
    read, or holds no row. ``example`` is that of a header, for messages.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        reader = csv.reader(text.splitlines(), delimiter=max(",;\t", key=text.partition("\n")[0].count))
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except FileNotFoundError:
        raise UserInputError(f"{path}: there is no such file; give a CSV with {example}") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserInputError(f"{path}: cannot be read as text ({error}); save it as CSV in UTF-8") from None
    if not rows:
        raise UserInputError(f"{path}: is empty; write a header line such as {example} and one row per time")
    above = next((k for k, (_, row) in enumerate(rows) if _is_number(row[0])), 1)
    header = [[cell.strip() for cell in row] for _, row in rows[:above]]
    lines, body = [line for line, _ in rows[above:]], [row for _, row in rows[above:]]
    if not body:
        raise UserInputError(f"{path}: holds no row below its header; write one row per time")
    return Table(path, header, lines, body)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _plain(name: str) -> str:
    """A column's name without its unit, in lower case."""
    return re.sub(r"[\s_]*[\[(]?\s*\b(mm|cm|m|ms|s)\b\s*[\])]?$", "", name.replace("_", " ").lower()).strip()


def _unit(name: str, units: dict[str, float]) -> float | None:
    found = re.search(r"(?:[\s_\[(])(mm|cm|m|ms|s)[\])]?$", name.lower())
    return units.get(found[1]) if found else None


def _long(table: Table, names: Sequence[str], fps: float | None) -> Iterator[Trajectory]:
    at = {what: _place(names, what) for what in NAMES}
    places = [at[axis] for axis in AXES] if at["height"] is None else [at["x"], at["height"], at["z"]]
    if all(place is None for place in places):
        raise UserInputError(_unknown(table.path, names, "coordinate", EXAMPLE))
    units = {_unit(names[place], UNITS) for place in places if place is not None}
    if len(units) > 1:
        raise UserInputError(f"{table.path}: the coordinates have different units; write all in metres")
    none = np.full(len(table.rows), np.nan)
    positions = np.stack([none if p is None else table.numbers(p, names[p]) for p in places], axis=1)
    times = _times(table, names, fps)
    several, points = ([""] * len(times) if p is None else table.words(p) for p in (at["recording"], at["id"]))
    for name in dict.fromkeys(several):
        rows = np.array([other == name for other in several])
        called = f"{table.path.stem}_{name}" if name else table.path.stem
        own = [point for point, inside in zip(points, rows, strict=True) if inside]
        joined, where, how = _joined(times[rows], positions[rows], own)
        upward = at["height"] is not None
        yield Trajectory(called, joined, where, str(table.path), next(iter(units)), upward, how=how)


def _place(names: Sequence[str], what: str) -> int | None:
    """Number of the column with one of the names of something; None where there is none."""
    plain = [_plain(name) for name in names]
    return next((plain.index(name) for name in NAMES[what] if name in plain), None)


def _joined(times: np.ndarray, positions: np.ndarray, points: Sequence[str]) -> tuple[np.ndarray, np.ndarray, str]:
    """The mean of several points [(F,), (F, 3)] at the times at which all are seen, and what it is in words."""
    names = list(dict.fromkeys(points))
    if len(names) == 1:
        return times, positions, Trajectory.how
    of_name = np.array([names.index(point) for point in points])
    moments = np.unique(times)
    whole = np.full((len(names), len(moments), 3), np.nan)
    whole[of_name, np.searchsorted(moments, times)] = positions
    seen = np.isfinite(whole).any(2).all(0)
    return moments[seen], whole[:, seen].mean(0), f"the mean of {len(names)} tracked points that move with the body"


def _times(table: Table, names: Sequence[str], fps: float | None) -> np.ndarray:
    """[s, (n,)]"""
    time, frame = _place(names, "time"), _place(names, "frame")
    if time is not None:
        return table.numbers(time, "the time", needed=True) * (_unit(names[time], SECONDS) or 1.0)
    if fps is not None:
        return (np.arange(len(table.rows)) if frame is None else table.numbers(frame, "the frame", needed=True)) / fps
    if frame is not None:
        raise UserInputError(f"{table.path}: counts frames and has no times; give --fps")
    raise UserInputError(_unknown(table.path, names, "time", "time_s"))


def _unknown(path: Path, names: Sequence[str], what: str, example: str) -> str:
    known = [called for group in NAMES.values() for called in group]
    near = [(name, close[0]) for name in names if (close := difflib.get_close_matches(_plain(name), known, 1, 0.75))]
    hint = f"; did you mean {near[0][1]} by {near[0][0]}?" if near else ""
    return f"{path}: no column is a {what}{hint} It has {', '.join(names)}; rename them, such as {example}"


def _deeplabcut(table: Table, fps: float | None) -> Trajectory:
    """Three rows of header: scorer, bodyparts, coords, or four: with individuals; the first column counts frames."""
    parts, coords = table.header[-2], table.header[-1]
    bodies = list(dict.fromkeys(table.header[1][1:])) if len(table.header) == 4 else []
    if len(bodies) > 1:
        raise UserInputError(f"{table.path}: follows {len(bodies)} bodies ({', '.join(bodies)}); give a file for each")
    wanted = {(part, axis) for part in parts[1:] for axis in AXES}
    columns = {key: k for k, key in enumerate(zip(parts, coords, strict=False)) if key in wanted}
    names = list(dict.fromkeys(part for part, _ in columns))
    flat = [name for name in names if (name, "z") not in columns]
    if not names or flat:
        raise UserInputError(
            f"{table.path}: a DeepLabCut file of one camera, with pixels x and y; give the triangulated points in 3-D, "
            "as DeepLabCut 3D or Anipose writes them"
        )
    positions = [[table.numbers(columns[name, axis], f"{name} {axis}") for axis in AXES] for name in names]
    return _wide(table.path, names, positions, _times(table, ["frame"], fps))


def _anipose(table: Table, names: Sequence[str], fps: float | None) -> Trajectory:
    """Columns NAME_x, NAME_y, NAME_z for every point, and the frame in fnum."""
    points = [name[:-2] for name in names if name.endswith("_x")]
    missing = [f"{p}_{axis}" for p in points for axis in AXES if f"{p}_{axis}" not in names]
    if missing:
        raise UserInputError(f"{table.path}: the column {missing[0]} is missing; every point needs x, y and z")
    positions = [[table.numbers(names.index(f"{p}_{axis}"), f"{p}_{axis}") for axis in AXES] for p in points]
    return _wide(table.path, points, positions, _times(table, names, fps))


def _wide(path: Path, names: Sequence[str], positions: Sequence[Sequence[np.ndarray]], times: np.ndarray) -> Trajectory:
    whole = np.array(positions).transpose(0, 2, 1)
    seen = np.isfinite(whole).all(2).all(0)
    mean = f"the mean of {len(names)} tracked points that move with the body ({', '.join(names)})"
    how = mean if len(names) > 1 else Trajectory.how
    return Trajectory(path.stem, times[seen], whole[:, seen].mean(0), str(path), how=how)


def read_spins(path: Path) -> dict[str, tuple[float, float, float]]:
    """Measured angular velocities [rad/s] by the names of recordings: a CSV with a column for the name and three whose
    names begin or end with x, y and z, such as ``recording,spin_x,spin_y,spin_z``. Raises UserInputError where it
    cannot be read, or a column is missing.
    """
    table = read_cells(path)
    names = [name.lower() for name in (table.header[-1] if table.header else [])]
    columns = [next((k for k, n in enumerate(names) if re.search(rf"(^{a}(_|$))|(_{a}$)", n)), None) for a in AXES]
    rest = [k for k in range(len(names)) if k not in columns]
    if None in columns or not rest:
        raise UserInputError(
            f"{path}: a file of spins has a column for the recording and three for its spin in rad/s, such as "
            f"recording,spin_x,spin_y,spin_z; it has {', '.join(names) or 'no header'}"
        )
    spins = np.stack([table.numbers(k, "the spin", needed=True) for k in columns if k is not None], axis=1)
    called = [Path(name).stem if not name.isdigit() else name for name in table.words(rest[0])]
    return {name: (x, y, z) for name, (x, y, z) in zip(called, spins.tolist(), strict=True)}
