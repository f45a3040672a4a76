"""Losses between images."""

import math

from torch import Tensor
from torch.nn.functional import mse_loss


def squared_error(predicted: Tensor, measured: Tensor) -> Tensor:
    """Mean squared difference [scalar] of colours in 0..1, any equal shapes."""
    return mse_loss(predicted, measured)


def psnr(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio [dB] of colours in 0..1."""
    return -10 * math.log10(max(mean_squared_error, 1e-12))
