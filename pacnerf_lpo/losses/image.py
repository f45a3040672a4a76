"""Losses between images."""

import math


def psnr(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio [dB] of colours in 0..1."""
    return -10 * math.log10(max(mean_squared_error, 1e-12))
