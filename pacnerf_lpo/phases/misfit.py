"""Predicted against measured images of a moving particle set: the misfit that every dynamic phase minimises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.ray_march import render_rays
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import ParticleState

if TYPE_CHECKING:
    from pacnerf_lpo.data.video_module import VideoData


class VideoMisfit:
    """Renders particles into the cameras of a video and compares.

    Args:
        data: the video with its cached rays.
        state: supplies the grid spacings and the frozen colour network.
        silhouette_weight: weight of the squared error between opacity and matte beside that of the colours.
        pool: images are averaged over blocks of pool x pool pixels before they are compared (1: not at all).
    """

    def __init__(self, data: VideoData, state: ParticleState, silhouette_weight: float = 0.0, pool: int = 1):
        self.data, self.silhouette_weight, self.pool = data, silhouette_weight, pool
        self.spacing, self.base_spacing = state.spacing, state.base_spacing
        self.colour = ColourNetwork()
        self.colour.load_state_dict(state.colour_network)
        self.colour.requires_grad_(False)
        self.frames = data.video.images.shape[1]

    def residual(self, positions: Tensor, density: Tensor, features: Tensor, view: int, frame: int) -> Tensor:
        """Predicted minus measured, zero where an occluder hides the scene, pooled.

        Args:
            positions: [m, (N, 3)]
            density: raw density [(N,)]
            features: appearance [(N, 12)]
            view, frame: indices into the video.

        Returns:
            [(H/pool, W/pool, 3)], with a fourth channel, opacity minus matte, if silhouettes are weighted.
        """
        video = self.data.video
        height, width = video.images.shape[2:4]
        grid = particles_to_grid(positions, density, features, self.spacing)
        rendering = render_rays(grid, self.colour, self.data.rays(view), self.base_spacing)
        difference = rendering.colour.reshape(height, width, 3) - video.images[view, frame]
        if self.silhouette_weight > 0:
            opacity = 1 - rendering.transmittance.reshape(height, width, 1)
            outline = opacity - video.silhouettes[view, frame].unsqueeze(-1)
            difference = torch.cat((difference, self.silhouette_weight**0.5 * outline), dim=-1)
        difference = difference * video.valid[view].unsqueeze(-1)
        if self.pool == 1:
            return difference
        pooled = functional.avg_pool2d(difference.permute(2, 0, 1), self.pool, ceil_mode=True)
        return pooled.permute(1, 2, 0)

    def loss(
        self, trajectory: Tensor, density: Tensor, features: Tensor, views: Sequence[Sequence[int]], first: int = 0
    ) -> Tensor:
        """Squared error summed over channels, averaged over pixels, frames and the views of each frame.

        Gradients are computed frame by frame while going forward, so that memory holds one image at a time.

        Args:
            trajectory: positions at every compared frame [m, (F, N, 3)]
            density: raw density [(N,)]
            features: appearance [(N, 12)]
            views: for each frame, the indices of the views it is compared in
            first: frame number of ``trajectory[0]``
        """

        def frame_loss(index: int, positions: Tensor, sigma: Tensor, colour: Tensor) -> Tensor:
            terms = [
                self.residual(positions, sigma, colour, view, first + index).square().sum(-1).mean()
                for view in views[index]
            ]
            return torch.stack(terms).mean()

        return _FrameByFrame.apply(frame_loss, trajectory, density, features)


class _FrameByFrame(torch.autograd.Function):
    """mean over frames of loss(frame, positions[frame], density, features), differentiated eagerly, frame by frame."""

    @staticmethod
    def forward(ctx, loss: Callable, trajectory: Tensor, density: Tensor, features: Tensor):
        needed = ctx.needs_input_grad[1:]
        inputs = [tensor.detach() for tensor in (trajectory, density, features)]
        gradients = [torch.zeros_like(tensor) if need else None for tensor, need in zip(inputs, needed, strict=True)]
        frames, total = len(trajectory), 0.0
        for index in range(frames):
            leaves = [
                tensor.detach().requires_grad_(need) for tensor, need in zip(_at(inputs, index), needed, strict=True)
            ]
            with torch.set_grad_enabled(any(needed)):
                value = loss(index, *leaves) / frames
            total += value.item()
            if value.requires_grad:
                _accumulate(gradients, leaves, value, index)
        ctx.save_for_backward(*gradients)
        return trajectory.new_tensor(total)

    @staticmethod
    def backward(ctx, outer: Tensor):
        return None, *(None if gradient is None else gradient * outer for gradient in ctx.saved_tensors)


def _at(inputs: list[Tensor], index: int) -> tuple[Tensor, Tensor, Tensor]:
    return inputs[0][index], inputs[1], inputs[2]


def _accumulate(gradients: list[Tensor | None], leaves: list[Tensor], value: Tensor, index: int) -> None:
    targets = [leaf for leaf in leaves if leaf.requires_grad]
    found = iter(torch.autograd.grad(value, targets))
    for slot, leaf in enumerate(leaves):
        gradient = gradients[slot]
        if leaf.requires_grad and gradient is not None:
            (gradient[index] if slot == 0 else gradient).add_(next(found))
