"""Flights made by another integrator than the model's: small explicit steps of the textbook formulas."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

STEP = 1e-4
BALL = ("--shape", "Ball", "--size", "0.04", "--mass", "0.0027")


def flight(
    times: np.ndarray,
    start: tuple[float, float, float],
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    release: float = 0.0,
    drag: float = 0.0,
    magnus: float = 0.0,
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Positions [m, (F, 3)], y up: midpoint steps of a = g - k |v| v + S omega x v, at rest before the release [s]."""
    g, aside = np.array([0.0, -9.81, 0.0]), magnus * np.cross(spin, np.eye(3)).T  # S omega x v = aside v

    def push(v: np.ndarray) -> np.ndarray:
        return g - drag * np.sqrt(v @ v) * v + aside @ v

    x, v, at, found = np.array(start), np.array(velocity), release, []
    for time in times:
        while at < time:
            h = min(STEP, time - at)
            middle = v + 0.5 * h * push(v)
            x, v, at = x + h * middle, v + h * push(middle), at + h
        found.append(x)
    return np.array(found)


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """A CSV with these columns; NaN stays empty."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(
                [
                    value if isinstance(value, str) else "" if np.isnan(value) else repr(value)
                    for value in map(_plain, row)
                ]
            )
    return path


def _plain(value: object) -> str | float:
    return value if isinstance(value, str) else float(value)  # type: ignore[arg-type]


def write_drops(path: Path, drag: float, noise: float = 0.01, seed: int = 0) -> Path:
    """Two drops from 40 m in one file, of which only heights were measured, released late."""
    random, rows = np.random.default_rng(seed), []
    for drop, release in ((1, 0.21), (2, 0.12)):
        times = np.arange(0.0, 2.6, 1 / 15)
        heights = flight(times, (0.0, 40.0, 0.0), release=release, drag=drag)[:, 1]
        rows += [(str(drop), t, h + noise * random.standard_normal()) for t, h in zip(times, heights, strict=True)]
    drops, moments, measured = map(np.array, zip(*rows, strict=True))
    return write(path, {"drop": drops, "time_s": moments, "height_m": measured})


def write_throws(folder: Path, count: int, drag: float, magnus: float, seed: int = 0) -> Path:
    """Throws with measured spins, z up and in millimetres; the spins in spins.csv."""
    random, spins = np.random.default_rng(seed), []
    folder.mkdir()
    for number in range(count):
        times = np.arange(0.0, 0.35, 1 / 140)
        velocity, spin = random.normal((0.0, 1.0, 7.0), (1.0, 0.5, 1.5)), 120.0 * random.standard_normal(3)
        positions = flight(times, (0.0, 0.4, -0.8), tuple(velocity), drag=drag, magnus=magnus, spin=tuple(spin))
        positions = 1000 * (positions + 1e-3 * random.standard_normal(positions.shape))
        x, y, z = positions.T
        write(folder / f"{number:03d}.csv", {"t": times, "x_mm": x, "y_mm": -z, "z_mm": y})
        spins.append((f"{number:03d}", spin[0], -spin[2], spin[1]))
    names, *parts = map(np.array, zip(*spins, strict=True))
    return write(folder / "spins.csv", {"file": names, "x_spin": parts[0], "y_spin": parts[1], "z_spin": parts[2]})
