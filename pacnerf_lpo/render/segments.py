"""Sums over, and copies to, the samples of each ray: stored ray after ray, ``lengths`` (R,) of them on each."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.nn.functional import embedding_bag

Map = Callable[[Tensor, Tensor], Tensor]


def segment_sum(values: Tensor, lengths: Tensor) -> Tensor:
    """Sum the sample values (M, C) of each ray: (R, C). Differentiable."""
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
