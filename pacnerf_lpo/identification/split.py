"""What the diagnosis may look at, and what it is judged by."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import UserInputError

HELD_VIEWS = 3
HELD_FRAMES = 2
LEAST_FRAMES = 5


@dataclass(frozen=True)
class Split:
    """Which views, frames and rows of points are fitted; the others are held out.

    views: True where a view is fitted [(V,), bool]
    frames: True where a frame is fitted [(F,), bool]; where that differs from row to row [(V + R, F), bool]
    points: True where a row of points is fitted [(R,), bool]
    """

    views: np.ndarray
    frames: np.ndarray
    points: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    @property
    def fitted(self) -> np.ndarray:
        """[(V + R, F), bool]"""
        return np.concatenate((self.views, self.points))[:, None] & self.frames

    @property
    def last_fitted(self) -> int:
        """Number of the last frame of which something is fitted."""
        return int(np.nonzero(np.atleast_2d(self.frames).any(0))[0][-1])

    @property
    def held(self) -> np.ndarray:
        """Rows that were not fitted, in all frames, and the last frames of all rows [(V + R, F), bool]."""
        return ~self.fitted


def split(data: VideoData) -> Split:
    """Hold out the test views of the run, or three of its training views when it has fewer than two, and the last two
    frames.

    Raises:
        UserInputError: too few views or frames to hold any out.
    """
    views, frames = data.video.images.shape[:2]
    if views < HELD_VIEWS or frames < LEAST_FRAMES:
        raise UserInputError(
            f"{data.video.source}: {views} views and {frames} frames; a diagnosis holds some out to judge by and "
            f"needs at least {HELD_VIEWS} views and {LEAST_FRAMES} frames"
        )
    held = np.isin(np.arange(views), held_views(views, data.test))
    late = np.arange(frames) >= frames - HELD_FRAMES
    return Split(~held, ~late)


def held_views(views: int, test: Sequence[int]) -> list[int]:
    """Which of so many views are held out: those of the test, or three of all when it has fewer than two."""
    if len(test) >= 2:
        return sorted(test)
    return np.linspace(1, views - 1, min(HELD_VIEWS, views - 1)).round().astype(int).tolist()
