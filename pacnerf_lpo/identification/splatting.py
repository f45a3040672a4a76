# mypy: disable-error-code="valid-type,index"
"""Outlines of moving particles: the union of discs that reach to the surface of the body, thousands of times cheaper
than rendering.

A ball around a particle that just touches the surface is inside of the body, and all of them together fill it. So their
outline is that of the body, whether it is thick or thin there: sums of footprints make a thick body too large and a
thin one half transparent.
"""

import functools

import torch
from torch import Tensor

from pacnerf_lpo.mpm.runtime import LAUNCHING, start
from pacnerf_lpo.mpm.taichi_calls import Launcher, ti

LEAST_DISC = 0.6
"""Discs of particles deep inside are larger than half a particle spacing by so much, so that a pixel between them is
opaque [pixels]."""


def radii(depth: Tensor, apart: Tensor) -> Tensor:
    """Radius of the disc of each particle [pixels].

    Args:
        depth: how far it is from the surface at frame 0 [pixels, (...)]. What is deep inside may come to the surface
            later, and is drawn as if it were half a spacing below it.
        apart: distance between neighbouring particles [pixels, (...)]
    """
    return torch.minimum(depth, apart / 2 + LEAST_DISC).clamp_min(0.0)


def splat(pixels: Tensor, radius: Tensor, size: tuple[int, int]) -> Tensor:
    """Opacity of unions of discs, with an edge that is a pixel wide.

    Args:
        pixels: image coordinates of their centres, pixel centres at +0.5 [(B, N, 2)], x then y; nothing is drawn where
            they are not finite.
        radius: of each disc [pixels, (B, N)]; 0: it is not drawn.
        size: height and width of the image.

    Returns:
        [0..1, (B, H, W)]
    """
    start()
    images, count = radius.shape
    inside = torch.full((images * size[0] * size[1],), -0.5)
    points, reach = pixels.float().contiguous().flatten(), radius.float().contiguous().flatten()
    with LAUNCHING:
        draw = _launcher()
        counts = {"count": images * count, "each": count, "rows": size[0], "columns": size[1]}
        draw.bind(points=points, radius=reach, inside=inside, **counts)
        draw()
    return (inside.view(images, *size) + 0.5).clamp_max(1.0)


@functools.cache
def _launcher() -> Launcher:
    Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)

    @ti.kernel
    def draw(points: Reals, radius: Reals, inside: Reals, count: int, each: int, rows: int, columns: int):
        for i in range(count):
            x, y, reach = points[2 * i] - 0.5, points[2 * i + 1] - 0.5, radius[i] + 0.5
            # also false where a number is not finite
            if 0.5 < reach < 1e6 and -reach < x < columns - 1 + reach and -reach < y < rows - 1 + reach:
                first = i // each * rows
                left, right = ti.max(int(ti.ceil(x - reach)), 0), ti.min(int(ti.floor(x + reach)), columns - 1)
                top, bottom = ti.max(int(ti.ceil(y - reach)), 0), ti.min(int(ti.floor(y + reach)), rows - 1)
                for row in range(top, bottom + 1):
                    for column in range(left, right + 1):
                        deep = reach - 0.5 - ti.sqrt((column - x) ** 2 + (row - y) ** 2)
                        ti.atomic_max(inside[(first + row) * columns + column], deep)

    return Launcher(draw, "f32")
