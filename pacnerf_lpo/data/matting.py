"""Matting of a raw image by its difference from the background plate of the same camera.

A shadow scales the plate without changing its hue, so a pixel belongs to the object where no scaling within a shadow's
range explains it. Along the rim the opacity a solves the compositing equation I = a F + (1 - a) B, with F from the
object's inside and B the shaded plate from just outside. Where the object was found by other means, its lower rim may
stand in its contact shadow, which goes from light to black within a few pixels: there, the light on F and B is unknown.
"""

import numpy as np
from scipy import ndimage

from pacnerf_lpo.data.images import fill_small_holes, large_pieces

SHADE_RANGE = (0.25, 1.1)
"""What a shadow (or light thrown back by the object) multiplies the plate with."""
SMOOTHING = 0.8
"""Standard deviation of the filter that holds pixel noise down before the threshold [pixels]."""
NOISE_FACTOR = 8.0
"""The threshold in multiples of the image's own median residual, at least THRESHOLD_FLOOR."""
THRESHOLD_FLOOR = 0.05
RIM = 2
"""Half-width of the band around an outline where pixels are mixed and opacity is estimated [pixels]."""
RIM_SMOOTHING = 1.0
"""Standard deviation of the filter of opacity where the background comes from noisy frames [pixels]: an outline is
smoother than that, and moves by a hundredth of a pixel where it is as round as fifty pixels."""
NOISE_MARGIN = 0.15
"""Opacities this close to 0 or 1 count as 0 or 1."""
REACH = 2.0
"""Standard deviation of the window that carries colours into the rim [pixels]."""
OPACITIES = np.linspace(0.0, 1.0, 11)
"""Those that are compared: an outline is placed to a tenth of a pixel."""
PIXEL_NOISE = 0.03
"""Standard deviation of a pixel in a compressed video, with what colours differ by within the window [0..1]."""
OBJECT_LIGHT, SHADOW_LIGHT = 0.15, 0.5
"""Standard deviations of the light along the rim, relative to that of the window: on a surface that curves within tens
of pixels, and on a ground which is anything between lit and black next to what it touches."""
PIECE_FRACTION = 0.01
"""Pieces smaller than this fraction of the largest one are noise."""
HOLE_FRACTION = 0.002
"""Enclosed gaps smaller than this fraction of the object are misses, larger ones are holes."""


def matte(image: np.ndarray, background: np.ndarray, solid: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The object on white [0..1, (H, W, 3)] and its opacity [0..1, (H, W)]. ``solid`` is where it is, within RIM
    [(H, W), bool]; None: found from the difference to the background.
    """
    ratio = (image * background).sum(-1) / np.maximum((background**2).sum(-1), 1e-6)  # explains each pixel best
    shade = np.clip(ratio, *SHADE_RANGE)
    estimate, width = (rim_opacity, 0.0) if solid is None else (rim_opacity_in_shadow, RIM_SMOOTHING)
    if solid is None:  # what no shading of the plate explains, without specks and small gaps
        residual = ndimage.gaussian_filter(image - background * shade[..., None], (SMOOTHING, SMOOTHING, 0))
        distance = np.linalg.norm(residual, axis=-1)
        solid = distance > max(THRESHOLD_FLOOR, NOISE_FACTOR * float(np.median(distance)))
        solid = fill_small_holes(large_pieces(solid, PIECE_FRACTION), HOLE_FRACTION)
    inside, outside = ndimage.binary_erosion(solid, iterations=RIM), ~ndimage.binary_dilation(solid, iterations=RIM)
    plate = background * spread(shade[..., None], ~ndimage.binary_dilation(solid))
    alpha, rim = inside.astype(np.float32), ~(inside | outside)
    estimated = estimate(image[rim], plate[rim], spread(image, inside)[rim])
    alpha[rim] = np.clip((estimated - NOISE_MARGIN) / (1.0 - 2.0 * NOISE_MARGIN), 0.0, 1.0)
    alpha = ndimage.gaussian_filter(alpha, width)
    opacity = alpha[..., None]
    on_white = np.clip(image + (1.0 - opacity) * (1.0 - plate), 0.0, 1.0)  # I - (1 - a) B + (1 - a)
    return np.where(opacity > 0.0, on_white, 1.0), alpha  # pure white where a = 0


def spread(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (H, W, C) continued from ``known`` pixels into the others, by a normalised Gaussian window."""
    weight = ndimage.gaussian_filter(known.astype(np.float32), REACH, truncate=4.0)[..., None]
    total = ndimage.gaussian_filter(values * known[..., None], (REACH, REACH, 0), truncate=4.0)
    return np.where(known[..., None], values, total / np.maximum(weight, 1e-6))


def rim_opacity(image: np.ndarray, plate: np.ndarray, object_colour: np.ndarray) -> np.ndarray:
    """Least-squares solution a of I = a F + (1 - a) B [(N,)], all colours (N, 3)."""
    step = object_colour - plate
    return np.asarray(((image - plate) * step).sum(-1) / np.maximum((step**2).sum(-1), 1e-6))


def rim_opacity_in_shadow(image: np.ndarray, plate: np.ndarray, object_colour: np.ndarray) -> np.ndarray:
    """Posterior mean of a in I = a f F + (1 - a) s B [(N,)], all colours (N, 3), where the light f on the object and s
    on the plate are normal variables around 1, and I has noise: the likelihood of each a is then normal, too.
    """
    scores = []
    for alpha in OPACITIES:
        front, back = alpha * object_colour, (1.0 - alpha) * plate
        lights = OBJECT_LIGHT * front, SHADOW_LIGHT * back
        covariance = PIXEL_NOISE**2 * np.eye(3) + sum(one[..., :, None] * one[..., None, :] for one in lights)
        away = (image - front - back)[..., None]
        squares = (away * np.linalg.solve(covariance, away)).sum((-2, -1))
        scores.append(-0.5 * squares - 0.5 * np.linalg.slogdet(covariance)[1])
    weights = np.exp(np.array(scores) - np.max(scores, axis=0))
    return np.asarray(np.tensordot(OPACITIES, weights, axes=1) / weights.sum(axis=0))
