# mypy: disable-error-code="valid-type,index,attr-defined"
"""Outlines of moving particles: the union of discs that reach to the surface of the body, thousands of times cheaper
than rendering.

A ball around a particle that just touches the surface is inside of the body, and all of them together fill it. So their
outline is that of the body, whether it is thick or thin there: sums of footprints make a thick body too large and a
thin one half transparent.
"""

import functools

import torch
from torch import Tensor

from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.mpm.runtime import LAUNCHING, device, start
from pacnerf_lpo.mpm.taichi_calls import Launcher, ti

LEAST_DISC = 0.6
"""Discs of particles deep inside are larger than half a particle spacing by so much, so that a pixel between them is
opaque [pixels]."""
LARGEST_DISC = 1e6
"""What is larger is of no body before the camera, and infinity not drawn [pixels]."""
LANES = 8
"""Neighbouring pixels in one vector register: a disc is five to nine pixels wide."""
LEAST_SHARE = 512
"""Taichi gives a CPU thread at least so many iterations of a loop: so far apart are those that draw an image."""


def splat(
    pixels: Tensor, scale: Tensor, discs: Discs, apart: float, size: tuple[int, int], footprint: float = 1.0
) -> Tensor:
    """Opacity of unions of discs, with an edge that is a pixel wide.

    The radius of a disc is its depth at frame 0. What is deep inside may come to the surface later, and is drawn as if
    it were half a spacing, and :data:`LEAST_DISC`, below it. On the CPU a thread draws an image, on CUDA a row of it,
    so that no pixel is changed by two threads.

    Args:
        pixels: image coordinates of the particles, pixel centres at +0.5 [(B, N, 2)], x then y; nothing is drawn where
            they are not finite.
        scale: pixels per metre there [(B, N)]; 0 behind the camera, where nothing is drawn.
        discs: half way between the particles; in perspective, that is nearer to the image of the farther one.
        apart: distance between neighbouring particles [m].
        size: height and width of the images.
        footprint: factor on all radii.

    Returns:
        [0..1, (B, H, W)]
    """
    start()
    images, (rows, columns) = len(scale), size
    blocks = -(-columns // LANES)
    inside = torch.full((images * rows * blocks, LANES), -0.5)
    strips, share = (1, LEAST_SHARE) if device().type == "cpu" else (rows, 1)
    arrays = {
        "seen": torch.cat((pixels, scale[..., None]), -1).float().contiguous().flatten(),
        "ends": discs.ends.int().contiguous().flatten(),
        "depth": discs.depth.float().contiguous(),
        "sizes": torch.tensor([images, rows, strips, share], dtype=torch.int32),
        "lengths": torch.tensor([apart, footprint], dtype=torch.float32),
    }
    with LAUNCHING:
        draw = _launcher()
        draw.bind(**arrays, inside=inside, count=images * strips * share)
        draw()
    return inside.add_(0.5).clamp_max_(1.0).view(images, rows, blocks * LANES)[..., :columns]


@functools.cache
def _launcher() -> Launcher:
    Reals = ti.types.ndarray(dtype=ti.f32, ndim=1)
    Whole = ti.types.ndarray(dtype=ti.i32, ndim=1)
    Pixels = ti.types.ndarray(dtype=ti.types.vector(LANES, ti.f32), ndim=1)

    @ti.kernel
    def draw(seen: Reals, ends: Whole, depth: Reals, inside: Pixels, sizes: Whole, lengths: Reals, count: int):
        for t in range(count):
            images, rows, strips, share = sizes[0], sizes[1], sizes[2], sizes[3]
            apart, footprint = lengths[0], lengths[1]
            if t % share == 0:
                image, height, blocks = t // share // strips, rows // strips, inside.shape[0] // (images * rows)
                highest, first_particle = t // share % strips * height, image * (seen.shape[0] // (3 * images))
                for k in range(depth.shape[0]):
                    a, b = 3 * (first_particle + ends[2 * k]), 3 * (first_particle + ends[2 * k + 1])
                    near = seen[a + 2] / (seen[a + 2] + seen[b + 2])
                    x = (1 - near) * seen[a] + near * seen[b] - 0.5
                    y = (1 - near) * seen[a + 1] + near * seen[b + 1] - 0.5
                    middle = 2 * near * seen[b + 2]
                    radius = footprint * ti.min(middle * depth[k], middle * apart / 2 + LEAST_DISC)
                    reach = radius + 0.5
                    across = -reach < x < blocks * LANES - 1 + reach
                    # also false where a number is not finite
                    if 0.5 < reach < LARGEST_DISC and across and highest - reach < y < highest + height - 1 + reach:
                        top = ti.max(int(ti.ceil(y - reach)), highest)
                        bottom = ti.min(int(ti.floor(y + reach)), highest + height - 1)
                        first = ti.max(int(ti.ceil(x - reach)), 0) // LANES
                        last = ti.min(int(ti.floor(x + reach)), blocks * LANES - 1) // LANES
                        for block in range(first, last + 1):
                            for row in range(top, bottom + 1):
                                place = (image * rows + row) * blocks + block
                                deepest = inside[place]
                                for lane in ti.static(range(LANES)):
                                    away = ti.sqrt((block * LANES + lane - x) ** 2 + (row - y) ** 2)
                                    deepest[lane] = ti.max(deepest[lane], radius - away)
                                inside[place] = deepest

    return Launcher(draw, "f32")
