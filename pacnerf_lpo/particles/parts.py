"""Parts of a cloud of particles that do not touch, and which of them the mattes confirm."""

from collections.abc import Sequence

import torch
from scipy import ndimage
from torch import Tensor

from pacnerf_lpo.data.hull import on_object
from pacnerf_lpo.types import Video

MAJORITY = 0.5
"""Share of the views in whose mattes a part has to lie: more of them say that it is there than do not."""


def confirmed(positions: Tensor, spacing: float, inside: Tensor) -> Tensor:
    """Particles of the largest part, and of those that most views see inside their mattes [(N,), bool].

    Matter that few cameras look at, such as above the images of most, can be anything: the mattes of the others say
    nothing of it. Parts are particles whose cells, of one spacing, do not touch.

    Args:
        positions: of the particles [m, (N, 3)].
        spacing: of the field [m].
        inside: whether a view sees a particle inside its matte [(V, N), bool].
    """
    cells = ((positions - positions.amin(0)) / spacing).floor().long()
    filled = torch.zeros(*(cells.amax(0) + 1).tolist(), dtype=torch.bool)
    filled[tuple(cells.T)] = True
    labels, count = ndimage.label(filled.numpy(), structure=torch.ones(3, 3, 3).numpy())
    part = torch.from_numpy(labels)[tuple(cells.T)].long() - 1
    sizes = torch.bincount(part, minlength=count)
    seen = torch.zeros(count).index_add_(0, part, inside.float().mean(0)) / sizes
    kept = seen > MAJORITY
    kept[sizes.argmax()] = True
    return kept[part]


def inside_mattes(positions: Tensor, video: Video, views: Sequence[int]) -> Tensor:
    """Whether views (indices into the video) see points [m, (N, 3)] inside their mattes at frame 0 [(V, N), bool]."""
    return torch.stack([on_object(positions.double(), video, view)[1] for view in views])
