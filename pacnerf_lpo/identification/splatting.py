"""Outlines of moving particles by splatting: thousands of times cheaper than rendering, as good for moments."""

import torch
from torch import Tensor
from torch.nn import functional

OPAQUE = 0.7
"""Optical depth of one particle spacing of the body: the outline is half opaque near the surface of a thick body."""
BLUR = 0.4
"""Width of a particle's footprint in particle spacings."""
REACH, MOST_REACH = 2.5, 24
"""Where a footprint ends, in units of its width, and at most [pixels]."""


def splat(pixels: Tensor, weights: Tensor, size: tuple[int, int], apart: Tensor) -> Tensor:
    """Opacity of point sets: bilinear splats, blurred by the distance between the points, then 1 - exp(-depth).

    Args:
        pixels: image coordinates, pixel centres at +0.5 [(B, N, 2)], x then y
        weights: share of a full particle [0..1, (N,)]
        size: height and width of the image.
        apart: distance between neighbouring particles, in pixels, for each of the B images [(B,)]

    Returns:
        [0..1, (B, H, W)]
    """
    images, sigma = len(pixels), BLUR * apart
    radius = int(torch.ceil(REACH * sigma.max()).clamp(1, MOST_REACH))
    x, y = (pixels - 0.5).unbind(-1)
    low_x, low_y = x.floor(), y.floor()
    (left, right), (top, bottom) = _window(low_x, size[1], radius), _window(low_y, size[0], radius)
    width, height = right - left + 4, bottom - top + 4  # what lies outside goes to two pixels around, which are cut off
    column = (low_x - left).clamp(-2, width - 4).long() + 2
    row = (low_y - top).clamp(-2, height - 4).long() + 2
    first = ((torch.arange(images)[:, None] * height + row) * width + column).flatten()
    part_x, part_y = x - low_x, y - low_y
    depth = pixels.new_zeros(images * height * width)
    for dx, share_x in ((0, (1 - part_x) * weights), (1, part_x * weights)):
        for dy, share_y in ((0, 1 - part_y), (1, part_y)):
            depth.index_add_(0, first + (dy * width + dx), (share_x * share_y).flatten())
    depth = _blurred(depth.view(images, height, width)[:, 2:-2, 2:-2], sigma, radius)
    opacity = -(-OPAQUE * depth * apart[:, None, None] ** 2).expm1()
    return functional.pad(opacity, (left, size[1] - right, top, size[0] - bottom))


def _window(along: Tensor, length: int, radius: int) -> tuple[int, int]:
    """First and last column, or row, exclusive, of what points [pixels, (B, N)] draw into an image of so many; one
    where they are out of sight.
    """
    seen = along.nan_to_num()
    low, high = seen.amin().item() - radius, seen.amax().item() + 2 + radius
    first = int(min(max(low, 0), length - 1))
    return first, int(min(max(high, first + 1), length))


def _blurred(images: Tensor, sigma: Tensor, radius: int) -> Tensor:
    """Each image [(B, H, W)] blurred by a Gaussian of its own width [pixels, (B,)], up to a radius."""
    steps = torch.arange(-radius, radius + 1, dtype=images.dtype)
    kernel = torch.exp(-0.5 * (steps / sigma.clamp_min(1e-3)[:, None]) ** 2)
    kernel = kernel / kernel.sum(1, keepdim=True)
    stack, groups = images[None], len(images)
    stack = functional.conv2d(stack, kernel[:, None, :, None], padding=(radius, 0), groups=groups)
    return functional.conv2d(stack, kernel[:, None, None, :], padding=(0, radius), groups=groups)[0]
