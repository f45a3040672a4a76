"""Frames that a camera has repeated, from how the object moves in its image. Pure NumPy."""

import numpy as np

FROZEN = 0.1
"""A frame that moves, and changes, less than this part of its neighbours repeats the one before."""
LEAST = 1.0
"""Motion between frames below which a repeated frame is none [pixels]: it would be right to a pixel anyway."""


def mend_dropouts(
    centres: np.ndarray, changes: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Leave repeated frames out, and move the times after an inserted frame.

    A frame that repeats the one before is a missing one that was filled up where the next motion is twice as long, and
    an inserted one where it is not: then all later frames are late.

    Args:
        centres: the object's centre in each frame, NaN where it is not whole [pixels, (F, 2)].
        changes: mean change of its pixels since the frame before [0..1, (F,)].
        times: as stamped [s, (F,)].

    Returns:
        Numbers of the frames that show something new, their times [s], and what was found, in words.
    """
    step, said = float(np.median(np.diff(times))), []
    kept, times = list(range(len(times))), times.astype(float).copy()
    for frame in range(2, len(times) - 2):
        before, now, after, later = np.diff(centres[frame - 2 : frame + 3], axis=0)
        expected = float(np.linalg.norm(0.5 * (before + after)))
        near = min(changes[[frame - 1, frame + 1]])
        still = np.linalg.norm(now) < FROZEN * expected and changes[frame] < FROZEN * near
        if expected > LEAST and still:
            kept.remove(frame)
            inserted = np.linalg.norm(after) < 1.5 * 0.5 * (np.linalg.norm(before) + np.linalg.norm(later))
            times[frame:] -= step if inserted else 0.0
            said.append(f"frame {frame} repeats frame {frame - 1}{', and all later ones are late' * bool(inserted)}")
    chosen = np.array(kept)
    return chosen, times[chosen], tuple(said)
