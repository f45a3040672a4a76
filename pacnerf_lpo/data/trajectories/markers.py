"""C3D files of motion capture, and folders of point clouds, as positions of one body."""

from pathlib import Path

import numpy as np

from pacnerf_lpo.data.measurements import read_ply
from pacnerf_lpo.data.trajectories.tables import UNITS
from pacnerf_lpo.data.trajectories.trajectory import Trajectory
from pacnerf_lpo.errors import UserInputError


def read_c3d(path: Path) -> Trajectory:
    """The mean of all markers at the times at which all are seen. Raises UserInputError where the library is missing,
    or the file is damaged or holds no markers.
    """
    try:
        import c3d
    except ImportError:
        raise UserInputError(f"{path}: reading C3D needs an extra: pip install 'pacnerf-lpo[recordings]'") from None
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
        said = [comment.split()[1] for comment in comments if comment.startswith("time_s ")]
        if not said and (fps is None or not digits):
            raise UserInputError(f"{path}: says no time; give --fps, and a number in the name of each file")
        times.append(float(said[0]) if said else int(digits[-1]) / float(fps or 1.0))
        places.append(points.mean(0) if len(points) else np.full(3, np.nan))
    order = np.argsort(times, kind="stable")
    whole = np.array(times)[order], np.array(places)[order]
    return Trajectory(folder.name, *whole, str(folder), how="the centroid of each cloud of points")
