"""Positions of one body over time, as they were read."""

from dataclasses import dataclass

import numpy as np

from pacnerf_lpo.errors import UserInputError

AXES = "xyz"
LEAST_SAMPLES = 8
"""Positions that make a flight: its start, its velocity and its acceleration leave five to judge by."""


@dataclass(frozen=True)
class Trajectory:
    """One recording: where a body was.

    name: of the recording; a scene's folder is called so.
    times: [s, (F,)], increasing
    positions: of the centre, in the recording's unit and axes [(F, 3)]; NaN where a coordinate was not measured
    source: where it was read from, for messages
    unit: metres per unit; None: not said
    upward: whether the second coordinate is a height, so that y is up
    spin: angular velocity [rad/s, (3,)] in the recording's axes; None: not measured
    how: what a position is of, in words
    """

    name: str
    times: np.ndarray
    positions: np.ndarray
    source: str
    unit: float | None = None
    upward: bool = False
    spin: np.ndarray | None = None
    how: str = "one tracked point, taken for the centre of the body"

    @property
    def measured(self) -> np.ndarray:
        """Which coordinates were measured at all [(3,), bool]."""
        return np.isfinite(self.positions).any(0)


def check_trajectory(one: Trajectory) -> Trajectory:
    """The trajectory, if its times increase and there are enough of them. Raises UserInputError where times are equal
    or in disorder, no coordinate was measured, or positions are too few.
    """
    where = f"{one.source}, recording {one.name}"
    steps = np.diff(one.times)
    if (steps == 0).any():
        at = one.times[1:][steps == 0][0]
        raise UserInputError(
            f"{where}: two positions are at {at:g} s; remove one, or give each recording its own number in a column "
            "called recording"
        )
    if (steps < 0).any():
        worst = int(np.argmax(steps < 0))
        raise UserInputError(
            f"{where}: the times go back from {one.times[worst]:g} s to {one.times[worst + 1]:g} s; sort the rows by "
            "time, or number several recordings in a column called recording"
        )
    if not one.measured.any():
        raise UserInputError(f"{where}: no coordinate has a number; give x, y and z, or a height")
    seen = int(np.isfinite(one.positions).any(1).sum())
    if seen < LEAST_SAMPLES:
        raise UserInputError(f"{where}: {seen} positions; a flight needs at least {LEAST_SAMPLES}")
    return one
