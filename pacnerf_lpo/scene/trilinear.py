"""Trilinear reading (gather) and writing (scatter) of node values: two linear maps, each the other's adjoint.

A point at fractional position f inside the cell with lowest node (i, j, k) has the eight weights
prod_axis (f_a or 1 - f_a). Nodes are numbered row-major, z fastest. Sorting points by cell turns the scatter into eight
segmented sums and eight shifted additions, free of atomics, hence deterministic and the same on CPU and CUDA.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.nn.functional import embedding_bag

Shape = tuple[int, int, int]
CORNERS = tuple((x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1))


@dataclass(frozen=True)
class Stencil:
    """The eight nodes around each of M points.

    cell: row-major number of the lowest of the eight nodes [(M,), int64]
    weights: trilinear weights, in the order of ``CORNERS`` [(M, 8)]
    shape: nodes of the grid along x, y, z.
    """

    cell: Tensor
    weights: Tensor
    shape: Shape

    def select(self, keep: Tensor) -> "Stencil":
        """The stencil of the points numbered by ``keep`` [(K,), int64]."""
        return Stencil(self.cell.index_select(0, keep), self.weights.index_select(0, keep), self.shape)


def cell_of(positions: Tensor, lower: Tensor, dx: float, shape: Shape) -> tuple[Tensor, Tensor]:
    """Cell number (M,) and fractional position in the cell (M, 3) of points [m, (M, 3)] of a grid."""
    scaled = (positions - lower) / dx
    last = torch.tensor(shape, device=positions.device) - 2
    node = torch.minimum(scaled.detach().floor().long().clamp_min(0), last)
    return (node[:, 0] * shape[1] + node[:, 1]) * shape[2] + node[:, 2], scaled - node


def weights_of(fraction: Tensor) -> Tensor:
    """Trilinear weights (M, 8) of fractional positions (M, 3); they add up to one."""
    x, y, z = torch.stack((1 - fraction, fraction), dim=-1).unbind(1)
    return (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).flatten(1)


def stencil(positions: Tensor, lower: Tensor, dx: float, shape: Shape) -> Stencil:
    """Stencil of points [m, (M, 3)]; points outside the grid are extrapolated from the nearest cell."""
    cell, fraction = cell_of(positions, lower, dx, shape)
    return Stencil(cell, weights_of(fraction), shape)


def gather(values: Tensor, points: Stencil) -> Tensor:
    """Interpolate node values (X*Y*Z, C) at the points: (M, C). Differentiable in values and weights."""
    return _Transfer.apply(values, points.weights, points.cell, points.shape, False)


def scatter(values: Tensor, points: Stencil) -> Tensor:
    """Add point values (M, C) to their eight nodes with the trilinear weights: (X*Y*Z, C). Differentiable in both."""
    return _Transfer.apply(values, points.weights, points.cell, points.shape, True)


def _corner_offsets(shape: Shape) -> list[int]:
    return [(x * shape[1] + y) * shape[2] + z for x, y, z in CORNERS]


def corners(points: Stencil) -> Tensor:
    """Numbers of the eight nodes around each point [(M, 8), int64], in the order of its weights."""
    return points.cell[:, None] + torch.tensor(_corner_offsets(points.shape), device=points.cell.device)


def _gather(values: Tensor, points: Stencil) -> Tensor:
    if values.shape[1] == 0:  # embedding_bag fails on it, with more than one thread
        return values.new_zeros(len(points.cell), 0)
    return embedding_bag(corners(points), values, mode="sum", per_sample_weights=points.weights)


def _scatter(values: Tensor, points: Stencil) -> Tensor:
    nodes = math.prod(points.shape)
    if values.shape[1] == 0:
        return values.new_zeros(nodes, 0)
    order = torch.argsort(points.cell)
    count = torch.bincount(points.cell, minlength=nodes)
    begin = count.cumsum(0) - count
    sorted_weights = points.weights.index_select(0, order).T.contiguous()
    values = values.contiguous()
    out = values.new_zeros(nodes, values.shape[1])
    for offset, weight in zip(_corner_offsets(points.shape), sorted_weights, strict=True):
        per_cell = embedding_bag(order, values, begin, mode="sum", per_sample_weights=weight)
        out[offset:] += per_cell[: nodes - offset]
    return out


class _Transfer(Function):
    """Gather, or scatter where ``to_nodes``; the adjoint of each by the values is the other."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, weights: Tensor, cell: Tensor, shape: Shape, to_nodes: bool) -> Tensor:
        ctx.save_for_backward(values, weights, cell)
        ctx.shape, ctx.to_nodes = shape, to_nodes
        return (_scatter if to_nodes else _gather)(values, Stencil(cell, weights, shape))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        values, weights, cell = ctx.saved_tensors
        points = Stencil(cell, weights, ctx.shape)
        grad = gradients[0].contiguous()
        adjoint = _gather if ctx.to_nodes else _scatter
        at_points, at_nodes = (values, grad) if ctx.to_nodes else (grad, values)
        to_values = adjoint(grad, points) if ctx.needs_input_grad[0] else None
        to_weights = None
        if ctx.needs_input_grad[1]:
            at_corners = at_nodes.index_select(0, corners(points).flatten()).view(len(cell), 8, -1)
            to_weights = torch.bmm(at_corners, at_points[:, :, None]).squeeze(2)
        return to_values, to_weights, None, None, None
