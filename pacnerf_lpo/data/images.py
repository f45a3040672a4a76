"""PNG files to arrays, area-averaged scaling, and silhouettes of images that are already on white."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import contourpy
import numpy as np
import torch
from PIL import Image
from scipy import ndimage
from torch import Tensor

from pacnerf_lpo.errors import UserInputError

MODES = ("RGB", "RGBA", "L", "LA", "P", "1")
HIGHLIGHT_FRACTION = 0.005
"""An enclosed white patch below this fraction of the silhouette is a highlight, a larger one a hole in the object."""


def read_png(path: Path) -> np.ndarray:
    """The image as float32 in 0..1, (H, W, 3), or (H, W, 4) where the file has transparency.

    Raises UserInputError where the file is missing, truncated or no image.
    """
    with _opened(path) as image:
        if image.mode not in MODES:
            raise UserInputError(f"{path}: pixels of kind {image.mode} are not supported; save it as 8-bit RGB or RGBA")
        transparent = "A" in image.getbands() or "transparency" in image.info
        return np.asarray(image.convert("RGBA" if transparent else "RGB")).astype(np.float32) / 255.0


def image_size(path: Path) -> tuple[int, int]:
    """(height, width) from the file's header alone. Raises UserInputError where the file is missing or no image."""
    with _opened(path) as image:
        return image.height, image.width


@contextmanager
def _opened(path: Path) -> Iterator[Image.Image]:
    try:
        with Image.open(path) as image:
            yield image
    except FileNotFoundError:
        raise UserInputError(f"{path}: the image is missing; copy it there or leave its view or frame out") from None
    except (OSError, SyntaxError) as error:
        reason = str(error).splitlines()[0].replace(str(path), "").strip(" '")
        raise UserInputError(f"{path}: the image cannot be read ({reason}); copy or export it again") from None


def on_white(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A matted image as colour on white (H, W, 3) and silhouette (H, W), from RGB (or opaque RGBA) on white or RGBA."""
    if pixels.shape[-1] == 3 or pixels[..., 3].min() == 1.0:
        return pixels[..., :3], white_silhouette(pixels[..., :3])
    alpha = pixels[..., 3:]
    return pixels[..., :3] * alpha + (1.0 - alpha), pixels[..., 3]


def white_silhouette(pixels: np.ndarray) -> np.ndarray:
    """Silhouette [0 or 1, (H, W)] of an object on pure white: what is not white, highlights inside it filled.

    Only small enclosed patches are filled, so that the hole of a torus stays a hole.
    """
    return fill_small_holes(pixels.min(axis=-1) < 1.0 - 1.5 / 255.0, HIGHLIGHT_FRACTION).astype(np.float32)


def fill_small_holes(solid: np.ndarray, share: float) -> np.ndarray:
    """``solid`` (H, W) with enclosed holes of at most this share of its pixels filled."""
    labels, _ = ndimage.label(~solid)
    small = np.bincount(labels.ravel()) <= int(share * solid.sum())
    open_to_border = (labels[0], labels[-1], labels[:, 0], labels[:, -1])
    small[np.concatenate((*open_to_border, [0]))] = False
    return solid | small[labels]


def large_pieces(solid: np.ndarray, share: float) -> np.ndarray:
    """The connected pieces of ``solid`` that are not smaller than this share of the largest one [(H, W), bool]."""
    labels, count = ndimage.label(solid)
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    return (areas >= share * areas.max())[labels] & solid if count else solid


def contours(opacity: np.ndarray) -> list[np.ndarray]:
    """Closed lines around what is more than half opaque [0..1, (H, W)], x right and y down, to a fraction of a pixel;
    centres of pixels are at +0.5 [pixels, (K, 2) each].
    """
    lines = contourpy.contour_generator(z=np.pad(opacity, 1), line_type="Separate").lines(0.5)
    return [np.asarray(line) - 0.5 for line in lines]


def area_weights(size: int, scaled: int) -> Tensor:
    """Row-stochastic (scaled, size) matrix that averages ``size`` pixels over ``scaled`` equal intervals."""
    edges = torch.linspace(0.0, size, scaled + 1, dtype=torch.float64)
    pixels = torch.arange(size, dtype=torch.float64)
    overlap = torch.minimum(edges[1:, None], pixels + 1) - torch.maximum(edges[:-1, None], pixels)
    return (overlap.clamp_min(0.0) * scaled / size).float()


def area_average(images: Tensor, height: int, width: int) -> Tensor:
    """Images (..., H, W, C) averaged over the area of each pixel of a (height, width) raster."""
    if images.shape[-3:-1] == (height, width):
        return images
    rows, columns = area_weights(images.shape[-3], height), area_weights(images.shape[-2], width)
    return torch.einsum("yh,...hwc,xw->...yxc", rows, images, columns)
