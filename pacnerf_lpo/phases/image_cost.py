"""Predicted against measured images of a moving particle set: the cost that every dynamic phase minimises."""

from collections.abc import Callable, Iterable, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.evaluation.prediction import StateRenderer
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.observation import AS_BELIEVED, Observer
from pacnerf_lpo.render.ray_march import render_rays
from pacnerf_lpo.types import FieldGrid, ParticleState


class ImageCost:
    """Renders particles into the cameras of a video, on the device of the process, and compares.

    Everything it is given and returns is on the CPU.

    Args:
        data, state: the video, and a state with the grid spacings and the frozen colour network.
        silhouette_weight: weight of the squared error between opacity and matte relative to that of the colours.

    Attributes:
        pool: images are averaged over blocks of pool x pool pixels before they are compared (1: not at all).
    """

    def __init__(self, data: VideoData, state: ParticleState, silhouette_weight: float = 0.0):
        self.data, self.silhouette_weight, self.pool = data, silhouette_weight, 1
        self.spacing, self.base_spacing = state.spacing, state.base_spacing
        renderer = StateRenderer(state)
        self.colour, self.device = renderer.colour.requires_grad_(False), renderer.device
        self.frames = data.video.images.shape[1]

    def residual(
        self,
        positions: Tensor,
        density: Tensor,
        features: Tensor,
        view: int,
        frame: int,
        observer: Observer = AS_BELIEVED,
    ) -> Tensor:
        """Predicted minus measured image [(H/pool, W/pool, 3)], zero where an occluder hides the scene, with a fourth
        channel, opacity minus matte, if silhouettes are weighted.

        The view sees the particles at ``positions`` [m, (N, 3)], with raw density [(N,)] and appearance [(N, 12)]; view
        and frame are indices into the video.
        """
        return self.residual_of_field(self.field(positions, density, features), view, frame, observer)

    def residual_at(
        self, seen: Tensor, density: Tensor, features: Tensor, view: int, frame: int, observer: Observer
    ) -> Tensor:
        """:meth:`residual` where the particles are given as each clock sees them [m, (clocks, N, 3)]."""
        at = observer.clock(self.data.video.view_ids[view])
        return self.residual(seen[at], density, features, view, frame, observer)

    def field(self, positions: Tensor, density: Tensor, features: Tensor) -> FieldGrid:
        """The field of the particles, on the device; arguments as of :meth:`residual`."""
        there = self.device
        return particles_to_grid(positions.to(there), density.to(there), features.to(there), self.spacing)

    def residual_of_field(self, grid: FieldGrid, view: int, frame: int, observer: Observer = AS_BELIEVED) -> Tensor:
        """:meth:`residual` of a field that several views see."""
        video = self.data.video
        measured, matte = video.images[view, frame], video.silhouettes[view, frame]
        rays = observer.rays(self.data, view, frame).to(self.device)
        rendering = render_rays(grid, self.colour, rays, self.base_spacing)
        light, transmittance = rendering.colour.cpu(), rendering.transmittance.cpu()
        colour = observer.colour(light, transmittance, video, view, frame)
        difference = colour.reshape(measured.shape) - measured
        if self.silhouette_weight > 0:
            outline = 1 - transmittance.reshape(matte.shape) - matte
            difference = torch.cat((difference, self.silhouette_weight**0.5 * outline[..., None]), dim=-1)
        difference = difference * video.valid[view].unsqueeze(-1)
        if self.pool == 1:
            return difference
        pooled = functional.avg_pool2d(difference.permute(2, 0, 1), self.pool, ceil_mode=True)
        return pooled.permute(1, 2, 0)

    def colour_error(
        self, seen: Tensor, density: Tensor, features: Tensor, images: Iterable[tuple[int, int]], observer: Observer
    ) -> float:
        """Squared error of the colours alone, summed over channels, averaged over the pixels of images, each given by
        its view and frame; other arguments as of :meth:`loss`.
        """
        found = [self.residual_at(seen[:, frame], density, features, view, frame, observer) for view, frame in images]
        return torch.stack(found)[..., :3].square().sum(-1).mean().item()

    def loss(
        self,
        seen: Tensor,
        density: Tensor,
        features: Tensor,
        views: Sequence[Sequence[int]],
        first: int = 0,
        observer: Observer = AS_BELIEVED,
    ) -> Tensor:
        """Squared error summed over channels, averaged over pixels, frames and the views of each frame.

        Gradients are computed frame by frame while going forward, so that memory holds one image at a time.

        Args:
            seen: positions at every compared frame, by each clock of the observer [m, (clocks, F, N, 3)]
            density, features: as of :meth:`residual`
            views: for each frame, the indices of the views it is compared in
            first: frame number of ``seen[:, 0]``
        """
        names = observer.names
        coefficients = torch.stack([observer.values[name] for name in names]) if names else seen.new_empty(0)

        def frame_loss(index: int, positions: Tensor, sigma: Tensor, colour: Tensor, values: Tensor) -> Tensor:
            now = Observer(observer.observations, dict(zip(names, values, strict=True)))
            found = [self.residual_at(positions, sigma, colour, view, first + index, now) for view in views[index]]
            return torch.stack([residual.square().sum(-1).mean() for residual in found]).mean()

        return _FrameByFrame.apply(frame_loss, seen, density, features, coefficients)


class _FrameByFrame(torch.autograd.Function):
    """mean over frames of loss(frame, seen[:, frame], others), differentiated eagerly, frame by frame."""

    @staticmethod
    def forward(ctx, loss: Callable, seen: Tensor, *others: Tensor):
        needed = ctx.needs_input_grad[1:]
        inputs = zip((seen, *others), needed, strict=True)
        gradients = [torch.zeros_like(tensor) if need else None for tensor, need in inputs]
        frames, total = seen.shape[1], 0.0
        for index in range(frames):
            of_frame = zip((seen[:, index], *others), needed, strict=True)
            leaves = [tensor.detach().requires_grad_(need) for tensor, need in of_frame]
            with torch.set_grad_enabled(any(needed)):
                value = loss(index, *leaves) / frames
            total += value.item()
            if value.requires_grad:
                targets = [leaf for leaf in leaves if leaf.requires_grad]
                found = iter(torch.autograd.grad(value, targets, materialize_grads=True))
                for slot, gradient in enumerate(gradients):
                    if gradient is not None:
                        (gradient if slot else gradient[:, index]).add_(next(found))
        ctx.save_for_backward(*gradients)
        return seen.new_tensor(total)

    @staticmethod
    def backward(ctx, outer: Tensor):
        return None, *(None if gradient is None else gradient * outer for gradient in ctx.saved_tensors)
