"""Sums over, and copies to, the samples of each ray: stored ray after ray, ``lengths`` (R,) of them on each."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.nn.functional import embedding_bag


def segment_sum(values: Tensor, lengths: Tensor) -> Tensor:
    """Sum the sample values (M, C) of each ray: (R, C). Differentiable."""
    return _Sum.apply(values, lengths)


def segment_copy(values: Tensor, lengths: Tensor) -> Tensor:
    """Copy each ray's values (R, C) to its samples: (M, C). Differentiable."""
    return _Copy.apply(values, lengths)


def _sum(values: Tensor, lengths: Tensor) -> Tensor:
    begin = lengths.cumsum(0) - lengths
    return embedding_bag(torch.arange(len(values), device=values.device), values.contiguous(), begin, mode="sum")


def _copy(values: Tensor, lengths: Tensor) -> Tensor:
    return values.repeat_interleave(lengths, dim=0)


class _Sum(Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, lengths: Tensor) -> Tensor:
        ctx.save_for_backward(lengths)
        ctx.save_for_forward(lengths)
        return _sum(values, lengths)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        return _copy(gradients[0], ctx.saved_tensors[0]), None

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Tensor:
        return _sum(tangents[0], ctx.saved_tensors[0])


class _Copy(Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, lengths: Tensor) -> Tensor:
        ctx.save_for_backward(lengths)
        ctx.save_for_forward(lengths)
        return _copy(values, lengths)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        return _sum(gradients[0], ctx.saved_tensors[0]), None

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> Tensor:
        return _copy(tangents[0], ctx.saved_tensors[0])
