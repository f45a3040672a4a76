"""Every frame of a camera once: its matted image kept, its outline measured; and the images at the common times."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage
from tqdm import tqdm

from pacnerf_lpo.data.images import read_png
from pacnerf_lpo.data.recordings.clocks import Clocks, Sighting, find_clocks, find_missing, resampled
from pacnerf_lpo.data.recordings.mattes import Mattes
from pacnerf_lpo.data.recordings.tangents import Planes, outline_points, outline_tangents, tangent_planes
from pacnerf_lpo.errors import UserInputError

LEAST_OBJECT = 20
"""Pixels of the object at the first frame, below which its matte has failed."""
AT_STAMP = 0.02
"""Times this near to a frame, relative to a step, are that frame's."""
FROZEN = 0.1
"""A frame that moves, and changes, less than this part of its neighbours repeats the one before."""
LEAST = 1.0
"""Motion between frames below which a repeated frame is none [pixels]: it would be right to a pixel anyway."""


@dataclass(frozen=True)
class Shots:
    """What one camera shows, without repeated frames.

    sighting: outlines, with times as mended [s]
    tangents: how far each outline reaches (F, D), NaN where the image cuts it off or nothing is seen
    centres: of the object, NaN where it is not whole [pixels, (F, 2)]
    areas: of the object [pixels, (F,)]
    images: the matted images, with transparency
    frames: their numbers in the recording
    said: repeated and missing frames, in words
    """

    sighting: Sighting
    tangents: np.ndarray
    centres: np.ndarray
    areas: np.ndarray
    images: tuple[Path, ...]
    frames: np.ndarray
    said: tuple[str, ...]

    def planes(self, offset: float, times: np.ndarray) -> list[Planes]:
        """Tangent planes at times [s], if the frames were taken so much later than stamped [s]."""
        stamps = self.sighting.times + offset
        nearest = stamps[np.abs(stamps[None] - times[:, None]).argmin(axis=1)]
        wanted = np.where(np.abs(nearest - times) < AT_STAMP * (times[1] - times[0]), nearest, times)
        return [tangent_planes(row, self.sighting.pose) for row in resampled(self.tangents, stamps, wanted)]

    @property
    def cut_off(self) -> np.ndarray:
        """Frames in which the object is seen but not whole (their numbers in the recording)."""
        return self.frames[(self.areas > 0) & np.isnan(self.tangents).any(axis=1)]


def look(folder: Path, view: int, mattes: Mattes, times: np.ndarray, size: tuple[int, int]) -> Shots:
    """Matte all frames of a camera, stamped with times [s, (F,)], keep the images in a folder, extended to a size
    (width, height), and find repeated ones. Raises UserInputError where there is no object in any frame.
    """
    camera, outlines, centres, areas, changes = mattes.camera, [], [], [], [0.0]
    images: list[Path] = []
    last: np.ndarray | None = None
    for pixels in tqdm(mattes, total=len(camera.frames), desc=f"camera {camera.name}", delay=2.0, leave=False):
        images.append(folder / f"own_{view}_{len(images)}.png")
        save(images[-1], pixels, size)
        points, inside = outline_points(pixels[..., 3], camera.intrinsic, mattes.lens.valid)
        outlines.append((points, inside))
        solid = pixels[..., 3] > 0.5
        whole = len(points) > 0 and inside.all()
        centres.append(np.array(ndimage.center_of_mass(pixels[..., 3]))[::-1] if whole else np.full(2, np.nan))
        areas.append(int(solid.sum()))
        if last is not None:
            either = solid | (last[..., 3] > 0.5)
            changes.append(float(np.abs(pixels - last)[either].mean()) if either.any() else 0.0)
        last = pixels
    if max(areas) < LEAST_OBJECT:
        raise no_object(mattes, 0)
    kept, mended, said = mend_dropouts(np.array(centres), np.array(changes), times)
    shown, insides = zip(*(outlines[k] for k in kept), strict=True)
    tangents = np.array([outline_tangents(*outlines[k]) for k in kept])
    sighting = Sighting(camera.pose, float(camera.intrinsic[0, 0]), mended, shown, insides)
    files = tuple(images[k] for k in kept)
    return Shots(sighting, tangents, np.array(centres)[kept], np.array(areas)[kept], files, kept, said)


def synchronised(shots: Sequence[Shots]) -> tuple[list[Shots], Clocks]:
    """The clocks of all cameras; where one has left out frames, its later ones are moved."""
    shots = list(shots)
    clocks = find_clocks([shot.sighting for shot in shots])
    missing = list(find_missing([shot.sighting for shot in shots], clocks))
    for camera, frame, count in missing:
        shot = shots[camera]
        times = shot.sighting.times + count * clocks.step * (np.arange(len(shot.frames)) >= frame)
        said = f"{count} frame{'s' * (count > 1)} missing before frame {shot.frames[frame]}"
        shots[camera] = replace(shot, sighting=replace(shot.sighting, times=times), said=(*shot.said, said))
    return shots, find_clocks([shot.sighting for shot in shots]) if missing else clocks


def no_object(mattes: Mattes, frame: int) -> UserInputError:
    """The error that a frame of a camera shows no object."""
    camera = mattes.camera
    return UserInputError(
        f"{camera.frames[frame].file}: no object is found in camera {camera.name} by its {mattes.way}; give masks, or "
        f"an image of the empty background, or --leave_out {camera.name} where the object is not in view at first"
    )


def image_at(shots: Shots, place: float) -> np.ndarray:
    """The image at a fractional frame number [0..1, (H, W, 4)]: its neighbours, each moved as the object is, merged."""
    begin = int(np.floor(place))
    if place == begin:
        return read_png(shots.images[begin])
    times = shots.sighting.times
    now = np.interp(place, np.arange(len(times)), times)
    centre = resampled(shots.centres, times, np.array([now]))[0]
    merged = np.zeros((1, 1, 4))
    for frame, weight in ((begin, 1.0 - place + begin), (begin + 1, place - begin)):
        pixels = read_png(shots.images[frame]).astype(np.float64)
        pixels[..., :3] *= pixels[..., 3:]
        moved = centre - shots.centres[frame]
        if np.isfinite(moved).all():
            pixels = ndimage.shift(pixels, (moved[1], moved[0], 0), order=1)
        merged = merged + weight * pixels
    merged[..., :3] /= np.maximum(merged[..., 3:], 1e-6)
    return np.clip(merged, 0.0, 1.0)


def save(path: Path, pixels: np.ndarray, size: tuple[int, int]) -> None:
    """Save colour and opacity [0..1, (H, W, 4)], extended by transparency to a size (width, height)."""
    padded = np.zeros((size[1], size[0], 4))
    padded[: pixels.shape[0], : pixels.shape[1]] = pixels
    Image.fromarray(np.round(255.0 * padded).astype(np.uint8)).save(path)


def mend_dropouts(
    centres: np.ndarray, changes: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Numbers of the frames that show something new, their mended times [s], and what was found, in words.

    A frame that repeats the one before is a missing one that was filled up where the next motion is twice as long, and
    an inserted one where it is not: then all later frames are late. Of each frame: the object's ``centres``, NaN where
    it is not whole [pixels, (F, 2)], mean ``changes`` of its pixels since the frame before [0..1, (F,)], and ``times``
    as stamped [s, (F,)].
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
