"""The background of a camera that stands still, from its own video, and the object before it.

A pixel shows the background whenever the object is elsewhere, lit or in the object's shadow. Which of its colours is
the background is decided by two things: where nothing moves while something moves far away, there is background; and
the object has everywhere the colours that it has where it is sure. Otherwise a body that falls and then stays would
become background where it rests, as in a median of the video.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.images import large_pieces
from pacnerf_lpo.data.matting import RIM, SHADE_RANGE
from pacnerf_lpo.data.recordings.colours import FINEST, Colours, log_of_background, noise_of, smoothed
from pacnerf_lpo.data.recordings.footage import Footage, factor_of
from pacnerf_lpo.data.recordings.media import library
from pacnerf_lpo.data.recordings.other_views import Expectation

WITHOUT_PLATES = "mattes from a video without plates"
ROUNDS = 2
"""How often background, object and its colours are found from each other."""
MOVED = 9.0
"""Half the squared change, in standard deviations, from which on a pixel has changed: once in a million of noise."""
LINK = 0.05
"""Gaps in what moves that are closed, relative to the image's width: an even body changes at its rim alone."""
FAR = 0.3
"""How far from all motion a pixel must be to show background, relative to the size of what moves."""
NEAR = 0.05
"""Weight of a frame in which motion is near, so that only pixels near motion in all frames are decided by these."""
COVERED, FREE = 0.5, 0.03
"""Probability of the object near motion and far from it."""
TOGETHER = 1.0
"""Standard deviation of the window in which pixels decide together [coarse pixels]."""
DARKENED = 1.0 / SHADE_RANGE[0]
"""How much lighter a pixel may become, where the frame that stands for its background shows it in a shadow."""
BRIGHT = 3.0
"""Frames that are darker than the brightest by more than so many standard deviations are in a shadow."""
STRONGEST = 6.0
"""Log odds up to which one pixel counts, so that a wrong one is outvoted by its neighbours."""
SMOOTH = 3.0
"""Log odds of a pixel for each pixel of outline: what a straight outline through noise saves."""
ROOM = 8
"""Pixels around everything that may be the object, within which outlines are made short."""
PIECE = 0.02
"""Pieces smaller than this part of the largest one are no part of the object."""
AROUND = 0.06
"""Standard deviation of the window from which never seen background is continued, relative to the image's width."""
STEPS = 60
"""Of the dual; then no sign changes any more, even where the odds of a pixel are half noise."""


@dataclass(frozen=True)
class Background:
    """What lies behind the object of a camera.

    plate: lit, without the object's shadow [0..1, (H, W, 3)]
    noise: standard deviation of a smoothed image's difference from it [0..1, (H, W)]
    known: where it was seen [(H, W), bool]; elsewhere it is continued from around, and ``noise`` says how surely
    colours: of the object
    shows: in which of the chosen frames each pixel shows it, lit [(K, h, w), bool, reduced]
    brightest: how much lighter than the plate the background may be
    """

    plate: np.ndarray
    noise: np.ndarray
    known: np.ndarray
    colours: Colours
    shows: np.ndarray
    brightest: float = SHADE_RANGE[1]

    def at_full_size(self, footage: Footage) -> "Background":
        """The same at all pixels of the frames."""
        return _composed(footage.full_size(), self.shows, self.colours)

    def denoised_odds(self, image: np.ndarray, expected: np.ndarray | float = 0.0) -> np.ndarray:
        """Log odds of the object in an image [0..1, (H, W, 3)] with those of the neighbourhood [(H, W)].

        Where they are positive is the object: their sum in it, less SMOOTH times the length of its outline, is largest
        (Chan, Esedoglu, Nikolova 2006), as the total variation is what is held down (Chambolle 2004). ``expected`` are
        log odds before the colours are looked at [(H, W)].
        """
        even, plate = smoothed(image), smoothed(self.plate)
        odds = self.colours.log_of(even) - log_of_background(even, plate, self.noise, self.brightest)
        odds = np.clip(odds, -STRONGEST, STRONGEST) + expected
        around = smoothed(odds, SMOOTH)
        rows, columns = (np.flatnonzero((around > 0.0).any(axis=axis)) for axis in (1, 0))
        if len(rows):
            window = tuple(slice(max(at[0] - ROOM, 0), at[-1] + ROOM + 1) for at in (rows, columns))
            denoised = library("skimage.restoration", WITHOUT_PLATES).denoise_tv_chambolle
            around[window] = denoised(odds[window].astype(np.float32), SMOOTH, eps=0.0, max_num_iter=STEPS)
        return around


def solid_part(odds: np.ndarray) -> np.ndarray:
    """Where log odds [(H, W)] say that the object is, without specks [(H, W), bool]."""
    return large_pieces(odds > 0.0, PIECE)


def expected_overlap(odds: np.ndarray, solid: np.ndarray) -> float:
    """Intersection over union that a matte [(H, W), bool] has with the truth, if the log odds of the object [(H, W)]
    are right: the figure of how sure it is.

    It is an upper bound: what all views take for the object, such as a contact shadow in its colours, is not in it.
    """
    chance = 1.0 / (1.0 + np.exp(-odds))
    near = ndimage.binary_dilation(solid, iterations=2 * RIM) & ~solid
    return float(chance[solid].sum() / max(solid.sum() + chance[near].sum(), 1.0))


def still_background(footage: Footage) -> Background | None:
    """What lies behind an object that moves before a camera that stands still, reduced; None where nothing moves."""
    frames = footage.decisive()
    views = np.stack([smoothed(frame) for frame in frames])
    noise = np.sqrt(2.0) * noise_of(views)
    seen = np.stack([[log_of_background(now, plate, noise, DARKENED) for now in views] for plate in views])
    far = _far_from_motion(seen, noise)
    if far is None:
        return None
    colours, chance, weight = Colours.unknown(), np.where(far, FREE, COVERED), np.where(far, 1.0, NEAR)
    for _ in range(ROUNDS):
        # of each pixel the colour that, lit or in a shadow, explains all frames best as background
        as_object = np.log(chance) + colours.log_of(views)
        scores = [(weight * np.logaddexp(np.log(1.0 - chance) + one, as_object)).sum(axis=0) for one in seen]
        best = np.argmax([smoothed(score, TOGETHER) for score in scores], axis=0)[None]
        alike = -1.5 * np.log(2.0 * np.pi * noise**2) - np.take_along_axis(seen, best[None], axis=0)[0] < MOVED
        shows = _lit(views, alike, noise)
        plate = (shows[..., None] * views).sum(axis=0) / shows.sum(axis=0)[..., None]
        background = Background(plate, noise, np.ones(noise.shape, bool), colours, far, DARKENED)
        for _ in range(ROUNDS):
            solid = np.stack([solid_part(background.denoised_odds(image)) for image in frames])
            colours = Colours.of(views[np.stack([ndimage.binary_erosion(one) for one in solid])])
            found = _composed(frames, _lit(views, _outside(solid), noise), colours)
            background = replace(found, brightest=DARKENED)
    return found


def colours_by_views(footage: Footage, expected: Expectation, masks: np.ndarray) -> Colours:
    """The object's colours where other views see it, too, and this camera by its masks [(F, h, w), bool, reduced]."""
    inside = masks[footage.chosen] & (expected.depth[footage.chosen] > 1.0)
    views = np.stack([smoothed(frame) for frame in footage.decisive()])
    return Colours.of(views[np.stack([ndimage.binary_erosion(one) for one in inside])])


def background_by_views(footage: Footage, expected: Expectation, masks: np.ndarray, colours: Colours) -> Background:
    """The background where other views say which frames show it; first where they are sure, then wherever these
    backgrounds, perhaps in a shadow then, say so too. Masks are as for :func:`colours_by_views`, colours the object's.
    """
    frames, chosen = footage.decisive(), footage.chosen
    views = np.stack([smoothed(frame) for frame in frames])
    noise = np.sqrt(2.0) * noise_of(views)
    free = np.stack([expected.free(number) for number in chosen])
    shows = np.where(free.any(axis=0), free, _outside(masks[chosen]))
    found = replace(_composed(frames, _lit(views, shows, noise), colours), brightest=DARKENED)
    odds = [found.denoised_odds(*pair) for pair in zip(frames, map(expected.log_odds, chosen), strict=True)]
    shows = free | _outside(np.stack([solid_part(one) for one in odds]))
    return _composed(frames, _lit(views, shows, noise), colours)


def _far_from_motion(seen: np.ndarray, noise: np.ndarray) -> np.ndarray | None:
    """Where each frame is far from everything that moves then [(F, H, W), bool]; None where nothing moves.

    Frames are compared with the next ones before and after in which enough has moved, so that a slow body counts.
    ``seen`` is the log density of each frame, if another one shows the background (F, F, H, W).
    """
    half_square = -np.maximum(seen, seen.swapaxes(0, 1)) - 1.5 * np.log(2.0 * np.pi * noise**2)
    count, width = len(seen), noise.shape[1]
    changed = {(a, b): ndimage.binary_opening(half_square[a, b] > MOVED) for a, b in np.ndindex(count, count) if a < b}
    areas = {pair: int(one.sum()) for pair, one in changed.items()}
    steps = sorted(areas[t, t + 1] for t in range(count - 1))
    enough = steps[-max(1, count // 4)]
    if not max(areas.values()):
        return None
    convex_hull_object = library("skimage.morphology", WITHOUT_PLATES).convex_hull_object
    reach = max(2, round(LINK * width))
    disc = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    moving = np.zeros((count, *noise.shape), bool)
    for t in range(count):
        for others in (range(t - 1, -1, -1), range(t + 1, count)):
            pairs = ((min(t, other), max(t, other)) for other in others)
            pair = next((pair for pair in pairs if areas[pair] > max(enough, 1)), None)
            if pair is not None:
                moving[t] |= changed[pair]
        closed = ndimage.binary_closing(np.pad(moving[t], reach), disc)[reach:-reach, reach:-reach]
        moving[t] = convex_hull_object(large_pieces(closed, 0.1))
    away = FAR * np.sqrt(np.median(moving.sum(axis=(1, 2))))
    return np.stack([(ndimage.distance_transform_edt(~one) > away) & one.any() for one in moving])


def _lit(views: np.ndarray, shows: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Which of the frames that show the background, ``shows``, show it without a shadow [(F, H, W), bool]."""
    light = np.where(shows, views.mean(axis=-1), -np.inf)
    return shows & (light > light.max(axis=0) - BRIGHT * noise)


def _outside(solid: np.ndarray) -> np.ndarray:
    """Outside of objects [(F, H, W), bool], of their holes and of their rims, which are mixed with them."""
    rim = ndimage.generate_binary_structure(2, 1)
    filled = (ndimage.binary_dilation(ndimage.binary_fill_holes(one), rim, iterations=RIM) for one in solid)
    return ~np.stack(list(filled))


def _composed(frames: np.ndarray, shows: np.ndarray, colours: Colours) -> Background:
    """The background from the frames [0..1 or bytes, (F, H, W, 3)] in which each pixel ``shows`` it [(F, H, W), or
    reduced]; around pixels that never do, it is continued. The colours are the object's.
    """
    factor, (height, width), reduced = factor_of(frames.shape[1:]), frames.shape[1:3], shows
    shows = shows.repeat(factor, axis=1).repeat(factor, axis=2)[:, :height, :width]
    scale = np.float32(255.0 if frames.dtype == np.uint8 else 1.0)
    count, known = shows.sum(axis=0), np.asarray(shows.any(axis=0))
    total, squares = np.zeros(frames.shape[1:], np.float32), np.zeros(known.shape)
    for frame, shown in zip(frames, shows, strict=True):
        total += shown[..., None] * (frame / scale)
    mean = total / np.maximum(count, 1)[..., None]
    around = AROUND * known.shape[1]
    plate = np.where(known[..., None], mean, _continued(mean, known, around))
    even = smoothed(plate)
    for frame, shown in zip(frames, shows, strict=True):
        squares += shown * ((smoothed(frame / scale) - even) ** 2).mean(-1)
    variance = _continued((squares / np.maximum(count, 1))[..., None], known, around)[..., 0]
    guessed = _continued(((mean - _continued(mean, known, around)) ** 2).mean(-1, keepdims=True), known, around)[..., 0]
    noise = np.sqrt(np.where(known, variance, variance + guessed))
    return Background(plate, np.maximum(noise, FINEST), known, colours, reduced)


def _continued(values: np.ndarray, known: np.ndarray, width: float) -> np.ndarray:
    """Values [(H, W, C)] averaged in a Gaussian window over ``known`` pixels; the nearest where there are none near."""
    weight = smoothed(known.astype(np.float64), width)[..., None]
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    averaged = smoothed(np.where(known[..., None], values, 0.0), width) / np.maximum(weight, 1e-9)
    return np.where(weight > 1e-3, averaged, values[tuple(nearest)]) if known.any() else values
