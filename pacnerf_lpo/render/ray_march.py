"""Volume rendering of a grid by ray marching (step dx/2) with occupancy skipping.

C(r) = sum_i T_i alpha_i c_i + T_end * white,  T_i = prod_{j<i} (1 - alpha_j)   (PAC-NeRF, eq. 1-2)
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.nn.functional import embedding_bag

from pacnerf_lpo.data.cameras import box_interval
from pacnerf_lpo.scene.activation import occupied_cells, optical_depth, sample_length
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.scene.trilinear import Stencil, cell_of, gather, stencil, weights_of
from pacnerf_lpo.types import FieldGrid, Rays

MIN_ALPHA = 1e-7
MIN_WEIGHT = 1e-7
BLOCK = 2048
"""Samples that are coloured at a time on a CPU."""
Map = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Rendering:
    """Rendered rays: ``colour`` [0..1, (R, 3)] and final ``transmittance`` [0..1, (R,)]."""

    colour: Tensor
    transmittance: Tensor


@dataclass(frozen=True)
class March:
    """The samples of R rays that contribute to the image, ray after ray.

    features: appearance at the samples [(K, 12)]
    weights: T alpha, each sample's share of its ray's colour [(K,)]
    lengths: number of samples of each ray [(R,), int64]
    transmittance: what is left at the end of each ray [(R,)]
    directions: the rays' unit directions [(R, 3)]
    """

    features: Tensor
    weights: Tensor
    lengths: Tensor
    transmittance: Tensor
    directions: Tensor


def render_rays(
    grid: FieldGrid, colour: ColourNetwork, rays: Rays, base_dx: float, min_weight: float = MIN_WEIGHT
) -> Rendering:
    """Render rays through a grid. Differentiable in the grid's density and features, the colour weights and rays.

    Args:
        rays: R rays [m].
        base_dx: coarsest spacing dx0, which sets the optical length of a sample [m].
        min_weight: samples that would add less to their ray are not coloured; they still attenuate.
    """
    return shade(march(grid, rays, base_dx, min_weight), colour)


def march(grid: FieldGrid, rays: Rays, base_dx: float, min_weight: float = MIN_WEIGHT) -> March:
    """Find the samples that contribute, their weights and features: the part of rendering that knows no colour."""
    delta = sample_length(grid.dx, base_dx)
    points, lengths = _occupied_samples(grid, rays, delta)
    weights, transmittance = _compose(gather(grid.density.reshape(-1, 1), points).squeeze(1), lengths, delta)
    keep = (weights.detach() >= min_weight).nonzero().squeeze(1)
    ray = torch.arange(len(lengths), device=lengths.device).repeat_interleave(lengths)
    return March(
        gather(grid.features.flatten(0, 2), points.select(keep)),
        weights.index_select(0, keep),
        torch.bincount(ray.index_select(0, keep), minlength=len(lengths)),
        transmittance,
        rays.directions,
    )


def shade(samples: March, colour: ColourNetwork, directions: Tensor | None = None) -> Rendering:
    """Colour the samples of a march, looking along ``directions`` (R, 3) or along the rays, and put the rays on white.

    A CPU colours them in blocks whose layers stay in its cache.
    """
    along = samples.directions if directions is None else directions
    hit = samples.lengths.nonzero().squeeze(1)
    lengths = samples.lengths.index_select(0, hit)
    per_ray = colour.direction_part(along.index_select(0, hit))
    rays, counts = _blocks(lengths)
    of_samples, of_rays = (samples.features, samples.weights), (per_ray, lengths)
    blocks = [*(one.split(counts) for one in of_samples), *(one.split(rays) for one in of_rays)]
    light = [
        segment_sum(colour.finish(features, segment_copy(seen, many)) * weights[:, None], many)
        for features, weights, seen, many in zip(*blocks, strict=True)
    ]
    behind = samples.transmittance[:, None].repeat(1, 3)
    return Rendering(behind.index_add(0, hit, torch.cat(light)), samples.transmittance)


def _blocks(lengths: Tensor) -> tuple[list[int], list[int]]:
    """Numbers of whole rays, and of their samples, in blocks of about BLOCK samples; one block on a GPU."""
    end = lengths.cumsum(0)
    total = int(end[-1]) if len(end) else 0
    if lengths.is_cuda or total <= BLOCK:
        return [len(lengths)], [total]
    ray = torch.searchsorted(end, torch.arange(BLOCK, total, BLOCK)).unique() + 1
    last = torch.cat((ray[ray < len(lengths)], torch.tensor([len(lengths)])))
    count = end[last - 1]
    return last.diff(prepend=last.new_zeros(1)).tolist(), count.diff(prepend=count.new_zeros(1)).tolist()


def _occupied_samples(grid: FieldGrid, rays: Rays, delta: float) -> tuple[Stencil, Tensor]:
    """Samples every dx/2 in cells where alpha can reach 1e-7, and their number on each ray."""
    with torch.no_grad():
        upper = grid.lower + grid.dx * (torch.tensor(grid.shape, device=grid.lower.device) - 1)
        enter, leave = box_interval(rays, grid.lower, upper)
        steps = ((leave - enter) / (grid.dx / 2)).floor().long().add_(1).clamp_min_(0)
        ray = torch.arange(len(steps), device=steps.device).repeat_interleave(steps)
        step = torch.arange(len(ray), device=ray.device) - (steps.cumsum(0) - steps).index_select(0, ray)
        distance = enter.index_select(0, ray) + step * (grid.dx / 2)
        entry = rays.origins.index_select(0, ray)
        positions = torch.addcmul(entry, rays.directions.index_select(0, ray), distance[:, None])
        cell, fraction = cell_of(positions, grid.lower, grid.dx, grid.shape)
        keep = occupied_cells(grid, delta, MIN_ALPHA).flatten().index_select(0, cell).nonzero().squeeze(1)
        ray = ray.index_select(0, keep)
        lengths = torch.bincount(ray, minlength=len(steps))
    if rays.directions.requires_grad:  # samples move sideways with a ray whose camera is being corrected, not along it
        along = rays.directions.index_select(0, ray) * distance.index_select(0, keep)[:, None]
        return stencil(rays.origins.index_select(0, ray) + along, grid.lower, grid.dx, grid.shape), lengths
    return Stencil(cell.index_select(0, keep), weights_of(fraction.index_select(0, keep)), grid.shape), lengths


def _compose(density: Tensor, lengths: Tensor, delta: float) -> tuple[Tensor, Tensor]:
    """Weights T alpha (M,) of the samples and final transmittance (R,); sums run in float64 over all rays at once."""
    depth = optical_depth(density, delta)
    opacity = -(-depth).expm1()
    visible = opacity.detach() >= MIN_ALPHA
    total = torch.where(visible, depth, 0).double().cumsum(0)
    total = torch.cat((total.new_zeros(1), total))
    end = lengths.cumsum(0)
    begin = total.index_select(0, end - lengths)
    before = total[:-1] - segment_copy(begin[:, None], lengths).squeeze(1)
    transmittance = (begin - total.index_select(0, end)).exp().to(density.dtype)
    return torch.where(visible, opacity, 0) * (-before).exp().to(density.dtype), transmittance


def segment_sum(values: Tensor, lengths: Tensor) -> Tensor:
    """Sum the values of samples (M, C), stored ray after ray, ``lengths`` (R,) of each: (R, C). Differentiable."""
    return _Linear.apply(values, lengths, _sum, _copy)


def segment_copy(values: Tensor, lengths: Tensor) -> Tensor:
    """Copy each ray's values (R, C) to its samples: (M, C). Differentiable."""
    return _Linear.apply(values, lengths, _copy, _sum)


def _sum(values: Tensor, lengths: Tensor) -> Tensor:
    begin = lengths.cumsum(0) - lengths
    return embedding_bag(torch.arange(len(values), device=values.device), values.contiguous(), begin, mode="sum")


def _copy(values: Tensor, lengths: Tensor) -> Tensor:
    return values.repeat_interleave(lengths, dim=0)


class _Linear(Function):
    """A linear map of the values and its adjoint: sum and copy are each the other's."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, lengths: Tensor, mapping: Map, adjoint: Map) -> Tensor:
        ctx.save_for_backward(lengths)
        ctx.mapping, ctx.adjoint = mapping, adjoint
        return mapping(values, lengths)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        return ctx.adjoint(gradients[0], ctx.saved_tensors[0]), None, None, None
