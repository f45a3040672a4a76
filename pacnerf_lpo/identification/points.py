"""Tracked points and point clouds as further rows of the measurements, behind those of the views."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from torch import Tensor

from pacnerf_lpo.data.measurements import PointClouds, TrackedPoints
from pacnerf_lpo.data.point_residuals import CLOUD_KINDS, attach, cloud_residuals, cloud_sigma, track_residuals
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.identification.silhouette_moments import KINDS

COLUMNS = len(KINDS) + 1
CLOUD_COLUMNS = 8
CLOUD_ROWS = -(-len(CLOUD_KINDS) // CLOUD_COLUMNS)
TRACK_KINDS = ("point x", "point y", "point z")
HELD_EVERY = 3
"""Every third tracked point is held out."""
MOST_TRACKS = 60
"""Of more points so many are used: neighbours say the same."""


@dataclass(frozen=True)
class Points:
    """Measured points compared with a model's motion: one row for each tracked point, two for the clouds.

    Entries are in pixels that a camera would see at the body, so that they weigh like outlines, and count from what was
    measured: a model that agrees predicts 0. Sightings are taken together by the frame that is nearest.

    Args:
        tracks, clouds: the measurements; None where there are none.
        times: of the frames [s, (F,)]
        pixel: size of a pixel at the body [m]
        body: particles at frame 0 [m, (N, 3)]
        from_first_sight: whether a row counts from where it was first seen.

    Raises:
        UserInputError: a point that is seen at frame 0 is away from the body.
    """

    tracks: TrackedPoints | None
    clouds: PointClouds | None
    times: np.ndarray
    pixel: float
    body: np.ndarray
    from_first_sight: ClassVar[bool] = True

    @classmethod
    def of(cls, data: VideoData, body: Tensor) -> "Points | None":
        """The points of a video; None where it has none. ``body``: particles at frame 0 [m, (N, 3)]."""
        if data.tracked_points is None and data.point_clouds is None:
            return None
        video = data.video
        eyes = video.camera_to_world[..., 3]
        pixels = (eyes - body.mean(0)).norm(dim=-1) / video.intrinsics[:, 0, 0]
        tracks = None if data.tracked_points is None else data.tracked_points.thinned(MOST_TRACKS)
        positions = body.numpy().astype(float)
        if tracks is not None:
            attach(tracks.seen_until(float(video.times[0])), positions[None], video.times[:1].numpy())
        times = video.times.numpy().astype(float)
        return cls(tracks, data.point_clouds, times, float(pixels.median()), positions)

    @property
    def names(self) -> list[str]:
        """Of the rows [R]."""
        tracked = [] if self.tracks is None else [f"point {name}" for name in np.unique(self.tracks.ids)]
        return tracked + [f"clouds {part + 1}" for part in range(CLOUD_ROWS if self.clouds is not None else 0)]

    @property
    def kinds(self) -> np.ndarray:
        """Names of the entries [(R, 11), str]."""
        found = np.full((len(self.names), COLUMNS), "", dtype=object)
        count = len(self.names) - (CLOUD_ROWS if self.clouds is not None else 0)
        found[:count, : len(TRACK_KINDS)] = TRACK_KINDS
        if self.clouds is not None:
            found[count:, :CLOUD_COLUMNS] = np.array(CLOUD_KINDS).reshape(CLOUD_ROWS, CLOUD_COLUMNS)
        return found

    @property
    def fitted(self) -> np.ndarray:
        """False for every third tracked point [(R,), bool]."""
        tracked = 0 if self.tracks is None else len(np.unique(self.tracks.ids))
        return np.array([row >= tracked or row % HELD_EVERY != HELD_EVERY - 1 for row in range(len(self.names))])

    @property
    def measured(self) -> np.ndarray:
        """0 where something was measured, else NaN [(R, F, 11)]."""
        return np.where(np.isfinite(self.sensor), 0.0, np.nan)

    @property
    def sensor(self) -> np.ndarray:
        """Standard deviation of the noise [pixels, (R, F, 11)]; NaN where nothing was measured."""
        rows = []
        if self.tracks is not None:
            names, row = np.unique(self.tracks.ids, return_inverse=True)
            counts, squares = np.zeros((2, len(names), len(self.times)))
            np.add.at(counts, (row, self._frames(self.tracks.times)), 1)
            np.add.at(squares, (row, self._frames(self.tracks.times)), self.tracks.sigma**2)
            sigma = np.where(counts > 0, np.sqrt(squares) / np.maximum(counts, 1), np.nan)
            rows.append(_padded(np.repeat(sigma[..., None], len(TRACK_KINDS), axis=-1)))
        if self.clouds is not None:
            rows.append(self._cloud_rows(cloud_sigma(self.clouds, self.body), self.clouds.times))
        return np.concatenate(rows) / self.pixel

    def predict(self, path: Tensor) -> np.ndarray:
        """How far a motion [m, (F, N, 3)] is from what was measured [pixels, (R, F, 11)]; NaN where nothing was."""
        trajectory, rows = path.numpy().astype(float), []
        if self.tracks is not None:
            attachment = attach(self.tracks, trajectory, self.times, np.inf)
            found = track_residuals(self.tracks, attachment, trajectory, self.times)
            total = np.zeros((len(attachment.names), len(self.times), len(TRACK_KINDS)))
            counts = np.zeros(total.shape[:2])
            np.add.at(total, (np.searchsorted(attachment.names, found.ids), self._frames(found.times)), -found.residual)
            every = np.searchsorted(attachment.names, self.tracks.ids), self._frames(self.tracks.times)
            np.add.at(counts, every, 1)  # the first sighting's residual is 0
            rows.append(_padded(np.where(counts[..., None] > 0, total / np.maximum(counts, 1)[..., None], np.nan)))
        if self.clouds is not None:
            deviations = -cloud_residuals(self.clouds, trajectory, self.times)
            rows.append(self._cloud_rows(deviations, self.clouds.times))
        return np.concatenate(rows) / self.pixel

    @property
    def fingerprint(self) -> bytes:
        """Differs where the measurements do."""
        arrays = [] if self.tracks is None else [self.tracks.times, self.tracks.positions, self.tracks.sigma]
        arrays += [] if self.clouds is None else [self.clouds.times, self.clouds.sigma, *self.clouds.points]
        return b"".join([*(array.tobytes() for array in arrays), "".join(self.names).encode()])

    def _frames(self, when: np.ndarray) -> np.ndarray:
        """Index of the nearest frame of times [s, (M,)]."""
        return np.abs(when[:, None] - self.times).argmin(1)

    def _cloud_rows(self, statistics: np.ndarray, when: np.ndarray) -> np.ndarray:
        """Statistics of clouds (C, 16) at times (C,) as rows (2, F, 11); of several in one frame the last counts."""
        rows = np.full((CLOUD_ROWS, len(self.times), CLOUD_COLUMNS), np.nan)
        parts = statistics.reshape(len(statistics), CLOUD_ROWS, CLOUD_COLUMNS)
        rows[:, self._frames(when)] = parts.transpose(1, 0, 2)
        return _padded(rows)


def _padded(rows: np.ndarray) -> np.ndarray:
    """Rows [(R, F, n)] of 11 entries, NaN behind."""
    return np.pad(rows, ((0, 0), (0, 0), (0, COLUMNS - rows.shape[-1])), constant_values=np.nan)
