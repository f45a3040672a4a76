"""What each entry of a residual vector is: which view, which frame, which summary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

AT_REST = -10_000
"""Frame of entries that compare views with each other, far from those that compare a frame with the first one: errors
of the one say nothing of the size of the others.
"""


@dataclass(frozen=True)
class Layout:
    """Names the D entries of a residual vector.

    view: index of the view; negative for what no camera sees, another number for each tracked point [(D,), int]
    frame: index of the frame, :data:`AT_REST` for outlines at frame 0 [(D,), int]
    kind: name of the summary, such as ``x`` or ``area`` [(D,), str]
    """

    view: np.ndarray
    frame: np.ndarray
    kind: np.ndarray

    def __len__(self) -> int:
        return len(self.view)
