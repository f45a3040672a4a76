"""Identification by images against identification by outlines, both on one coarse body that has just been identified.

The two methods err for different reasons: shading that changes along a fall pulls colours to a wrong motion, and an
outline hides what happens inside it. Run on the same body, the errors of its coarse grid are common to both, so that
what differs between their answers is the methods' own.
"""

import time
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import avg_pool2d
from tqdm import tqdm

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.identification.forward_model import Model
from pacnerf_lpo.identification.least_squares import ROUGH_GAIN, Effort, Fit, Residual, fit
from pacnerf_lpo.mpm.parameters import Log10
from pacnerf_lpo.phases.identification_methods import finite_loss
from pacnerf_lpo.phases.image_cost import ImageCost
from pacnerf_lpo.phases.outline_method import HALVINGS, NEIGHBOURS, OutlineCost
from pacnerf_lpo.phases.physics_id import PhysicsIDModule

PARTICLES = 1500
"""Of the coarse body, as in the search of OutlineGaussNewton: a simulation takes a fraction of a second."""
FRAMES = 12
"""Frames from the contact on that are compared: impact and rebound. Later motion follows from these, and costs time."""
LONGEST = 32
"""Pixels along the longer side of the images that are compared: a displacement of a few of the body's cells is seen."""
VIEWS = 4
"""Views in which each frame is compared by images, at most."""
ITERATIONS = 4
NEAREST = 8
"""Coarse particles that a particle of the state follows, weighted by inverse distance: those of one cell."""


def compare_methods(module: PhysicsIDModule) -> dict[str, Any]:
    """What each method would have identified on a coarse body, starting from what was identified. Raises
    SimulationError where the coarse body is unstable at the identified parameters.

    Moduli are tried around their values first, and each method goes on from its own best point.

    Args:
        module: attached, with the state that an identification exported.

    Returns:
        ``particles``, ``seconds``, ``simulations``; ``images`` and ``outlines``: parameters by name [SI]; ``excess``:
        by how many per cent the cost of each method is higher at the other's answer than at its own.
    """
    began, frames = time.monotonic(), min(module.hit_frame + FRAMES, module.frame_count)
    outlines = OutlineCost(module, PARTICLES, frames=frames)
    model = outlines.model
    model.physics.most_halvings = HALVINGS
    images = _Images(module, outlines, frames)
    simulations = 0  # a bar that is not drawn counts nothing
    with tqdm(desc="images against outlines", unit=" simulations", leave=False) as bar:

        def counted(residual: Residual) -> Residual:
            def count(free: np.ndarray) -> np.ndarray:
                nonlocal simulations
                simulations += 1
                bar.update()
                return residual(free)

            return count

        residuals = counted(images.residual), counted(outlines.residual)
        found = [fit(by, _start(model, by), model.scales, model.bounds, Effort(ITERATIONS)) for by in residuals]
        found = [_continued(*each, model) for each in zip(residuals, found, found[::-1], strict=True)]
        excess = [_excess(*each) for each in zip(residuals, found, found[::-1], strict=True)]
    answers = [{name: model.physical(one.free)[name] for name in module.free} for one in found]
    return {
        "particles": len(model.body.positions),
        "seconds": round(time.monotonic() - began, 1),
        "simulations": simulations,
        "images": answers[0],
        "outlines": answers[1],
        "excess": {"images": excess[0], "outlines": excess[1]},
    }


def _start(model: Model, residual: Residual) -> np.ndarray:
    """The best point for a method: of what was identified, and of moduli to either side of it."""
    moduli = [index for index, unknown in enumerate(model.unknowns) if isinstance(unknown.transform, Log10)]
    axes = np.eye(len(model.start))[moduli]
    points = [model.start, *(model.start + offset * axis for axis in axes for offset in NEIGHBOURS)]
    return min(points, key=lambda free: _cost(residual, free))


def _cost(residual: Residual, free: np.ndarray) -> float:
    return finite_loss(lambda: float(np.sum(residual(free) ** 2)))


def _continued(residual: Residual, own: Fit, other: Fit, model: Model) -> Fit:
    """A method's own answer, or where it leads from the answer of the other one, if that is better."""
    if _cost(residual, other.free) >= (1 - ROUGH_GAIN) * own.cost:
        return own
    return fit(residual, other.free, model.scales, model.bounds, Effort(ITERATIONS))


def _excess(residual: Residual, own: Fit, other: Fit) -> float:
    """By how many per cent a cost is higher at another method's answer [%]."""
    return round(100 * (_cost(residual, other.free) / max(own.cost, 1e-30) - 1), 1)


class _Images:
    """Images of a body whose particles follow a coarse one, that of ``outlines``, rendered small, less those of the
    video, in the first so many frames.
    """

    def __init__(self, module: PhysicsIDModule, outlines: OutlineCost, frames: int):
        self.model, self.prior_terms, self.state = outlines.model, outlines.prior_terms, module.state
        self.image_cost = ImageCost(reduced(module.data), module.state, module.silhouette_weight)
        self.views = module.fixed_views(frames, VIEWS)
        tree = cKDTree(self.model.body.positions.numpy())
        distance, self._near = tree.query(self.state.positions.numpy(), NEAREST)
        weight = torch.from_numpy(1 / np.maximum(distance, 1e-2 * self.model.body.spacing)).float()
        self._weight = weight / weight.sum(1, keepdim=True)
        self._unit = max(float(np.sqrt(np.mean(self._pixels(self.model.start) ** 2))), 1e-6)

    def residual(self, free: np.ndarray) -> np.ndarray:
        """In units of their root mean square at the start, then how far unknowns are from their prior means [(D,)]."""
        self.model.physics.halvings = 0
        return np.append(self._pixels(free) / self._unit, self.prior_terms(free))

    @torch.no_grad()
    def _pixels(self, free: np.ndarray) -> np.ndarray:
        model, state, found = self.model, self.state, []
        path, observer = model.path(free)[: len(self.views)], model.observer(free)
        seen = observer.seen(path, model.velocity(free), model.video.times[: len(path)])
        for frame, views in enumerate(self.views):
            fields = [self.image_cost.field(self._carried(p[frame]), state.density, state.features) for p in seen]
            for view in views:
                field = fields[observer.clock(model.video.view_ids[view])]
                found.append(self.image_cost.residual_of_field(field, view, frame, observer))
        return torch.stack(found).flatten().double().numpy()

    def _carried(self, coarse: Tensor) -> Tensor:
        """The state's particles [m, (N, 3)], each displaced as the nearest ones of the coarse body are."""
        moved = (coarse - self.model.body.positions)[self._near]
        return self.state.positions + (self._weight[..., None] * moved).sum(1)


def reduced(data: VideoData) -> VideoData:
    """The same video with images of at most :data:`LONGEST` pixels, each the mean of a block."""
    video = data.video
    height, width = video.images.shape[2:4]
    block = -(-max(height, width) // LONGEST)
    rows, columns = height // block, width // block
    intrinsics = video.intrinsics.clone()
    intrinsics[:, :2] /= block

    def pooled(values: Tensor) -> Tensor:
        """Means of blocks of the last two axes; what is left over at right and bottom is cut off."""
        cut = values[..., : rows * block, : columns * block]
        return avg_pool2d(cut.flatten(0, -3)[None].float(), block)[0].reshape(*values.shape[:-2], rows, columns)

    copied = copy(data)
    copied._rays = {}
    copied.video = replace(
        video,
        images=pooled(video.images.movedim(-1, 2)).movedim(2, -1),
        silhouettes=pooled(video.silhouettes),
        valid=pooled(video.valid) > 1 - 1e-6,
        intrinsics=intrinsics,
    )
    return copied
