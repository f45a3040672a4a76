"""Frames that a camera has repeated or left out, from how the object moves in its image. Pure NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FROZEN = 0.1
"""A frame that moves, and changes, less than this part of its neighbours repeats the one before."""
LEAST = 1.0
"""Motion between frames below which a repeated frame is none [pixels]: it would be right to a pixel anyway."""
JUMP = 1.6
"""A motion so many times larger than those before and after it spans a missing frame: a body under gravity or in contact
never moves faster in one frame than in both neighbours by this much."""
ALONG = 0.7
"""Cosine between the motions before, in and after such a jump."""


@dataclass(frozen=True)
class Mended:
    """kept: numbers of the frames that show something new. times: of these [s]. said: what was found, in words."""

    kept: np.ndarray
    times: np.ndarray
    said: tuple[str, ...] = ()


def mend_dropouts(centres: np.ndarray, changes: np.ndarray, times: np.ndarray) -> Mended:
    """Leave repeated frames out, and move the times after an inserted or a missing frame.

    A frame that repeats the one before is a missing one that was filled up where the next motion is twice as long, and
    an inserted one where it is not: then all later frames are late.

    Args:
        centres: the object's centre in each frame, NaN where it is not whole [pixels, (F, 2)].
        changes: mean change of its pixels since the frame before [0..1, (F,)].
        times: as stamped [s, (F,)].
    """
    step, said = float(np.median(np.diff(times))), []
    kept, times = list(range(len(times))), times.astype(float).copy()
    for frame in range(2, len(times) - 2):
        before, now, after, later = (np.diff(centres[frame - 2 : frame + 3], axis=0)[k] for k in range(4))
        expected = float(np.linalg.norm(0.5 * (before + after)))
        still = np.linalg.norm(now) < FROZEN * expected and changes[frame] < FROZEN * min(changes[[frame - 1, frame + 1]])
        if expected > LEAST and still:
            kept.remove(frame)
            inserted = np.linalg.norm(after) < 1.5 * 0.5 * (np.linalg.norm(before) + np.linalg.norm(later))
            times[frame:] -= step if inserted else 0.0
            said.append(f"frame {frame} repeats frame {frame - 1}{', and all later ones are late' * bool(inserted)}")
    chosen = np.array(kept)
    centres, times = centres[chosen], times[chosen]
    motion = np.diff(centres, axis=0) / np.diff(times)[:, None] * step
    speed = np.linalg.norm(motion, axis=1)
    for place in range(1, len(motion) - 1):
        usual = max(speed[place - 1], speed[place + 1])
        aligned = min(motion[place] @ motion[place + side] for side in (-1, 1)) > ALONG * speed[place] * usual / JUMP
        if aligned and speed[place] > JUMP * usual and speed[place] - usual > LEAST:
            missing = max(1, round(float(speed[place] / (0.5 * (speed[place - 1] + speed[place + 1])))) - 1)
            times[place + 1 :] += missing * step
            said.append(f"{missing} frame{'s' * (missing > 1)} missing before frame {chosen[place + 1]}")
    return Mended(chosen, times, tuple(said))
