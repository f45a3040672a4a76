"""Outlines of moving particles by splatting: thousands of times cheaper than rendering, and as good for summaries."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

OPAQUE = 0.7
"""Optical depth of one particle spacing of matter: the outline is half opaque near the surface of a thick body."""
BLUR = 0.4
"""Width of a particle's footprint in particle spacings."""


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
    height, width = size
    images = len(pixels)
    corner = pixels - 0.5
    low = corner.floor()
    part = corner - low
    depth = pixels.new_zeros(images * height * width)
    offset = torch.arange(images)[:, None] * (height * width)
    for dx in (0, 1):
        for dy in (0, 1):
            column, row = low[..., 0].long() + dx, low[..., 1].long() + dy
            share = (part[..., 0] if dx else 1 - part[..., 0]) * (part[..., 1] if dy else 1 - part[..., 1]) * weights
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            index = (offset + row.clamp(0, height - 1) * width + column.clamp(0, width - 1)).reshape(-1)
            depth.index_add_(0, index, (share * inside).reshape(-1))
    depth = _blurred(depth.view(images, height, width), BLUR * apart)
    return -(-OPAQUE * depth * apart[:, None, None] ** 2).expm1()


def _blurred(images: Tensor, sigma: Tensor) -> Tensor:
    """Each image [(B, H, W)] blurred by a Gaussian of its own width [pixels, (B,)]."""
    radius = int(torch.ceil(2.5 * sigma.max()).clamp(1, 24))
    steps = torch.arange(-radius, radius + 1, dtype=images.dtype)
    kernel = torch.exp(-0.5 * (steps / sigma.clamp_min(1e-3)[:, None]) ** 2)
    kernel = kernel / kernel.sum(1, keepdim=True)
    stack, groups = images[None], len(images)
    stack = functional.conv2d(stack, kernel[:, None, :, None], padding=(radius, 0), groups=groups)
    return functional.conv2d(stack, kernel[:, None, None, :], padding=(0, radius), groups=groups)[0]
