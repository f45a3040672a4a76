"""How much a phase computes, counted before it starts."""

from dataclasses import dataclass

BACKWARD = 4.0
"""A rollout with its gradient costs so many plain ones: frames are simulated twice, and the adjoint takes two more."""
DRAWN = 3.0
"""A ray with its gradient costs so many plain ones."""


@dataclass(frozen=True)
class Work:
    """Counts in the units in which speed is measured.

    frames: video frames of the whole body that are simulated, at the run's spacing and without gradients.
    rays: rays that are marched and coloured, with gradients.
    images: whole images of a training view, with gradients.
    """

    frames: float = 0.0
    rays: float = 0.0
    images: float = 0.0

    def __add__(self, other: "Work") -> "Work":
        return Work(self.frames + other.frames, self.rays + other.rays, self.images + other.images)

    def __mul__(self, times: float) -> "Work":
        return Work(self.frames * times, self.rays * times, self.images * times)


def compared(frames: int, views: float, gradients: bool) -> Work:
    """A rollout over so many frames, each compared with so many views."""
    if gradients:
        return Work(frames=BACKWARD * frames, images=frames * views)
    return Work(frames=frames, images=frames * views / DRAWN)
