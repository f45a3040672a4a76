"""Signed residuals as colours: orange where the model is darker than the video, blue where it is brighter.

On a white background orange is what only the model shows, blue what only the video shows.
Orange and blue stay apart for every common colour deficiency, and both ends are about equally dark.
"""

import torch
from torch import Tensor

NEGATIVE = (0.80, 0.36, 0.0)
POSITIVE = (0.0, 0.36, 0.72)
SCALES = (0.05, 0.1, 0.2, 0.5, 1.0)


def signed_residual(predicted: Tensor, measured: Tensor) -> Tensor:
    """Mean over the channels of predicted - measured, (..., H, W, 3) -> (..., H, W), in -1..1."""
    return (predicted - measured).mean(-1)


def residual_colours(residual: Tensor, scale: float) -> Tensor:
    """Colours of signed residuals of any shape [0..1, (..., 3)]: white at 0, full orange at -scale and below, full blue
    at +scale.
    """
    strength = (residual / scale).clamp(-1, 1)[..., None]
    end = torch.where(strength < 0, torch.tensor(NEGATIVE), torch.tensor(POSITIVE))
    return 1 - strength.abs() * (1 - end)


def residual_scale(residual: Tensor) -> float:
    """The smallest round scale that 99.5 % of the object's residuals (those beyond 1/255) stay within."""
    size = residual.abs()
    size = size[size > 1 / 255]
    if size.numel() == 0:
        return SCALES[0]
    reach = size.float().sort().values[int(0.995 * (size.numel() - 1))].item()
    return next((scale for scale in SCALES if reach <= scale), SCALES[-1])


def comparison_panel(predicted: Tensor, measured: Tensor) -> Tensor:
    """Rendered | measured [0..1, (H, W, 3)] | signed residual, full colour at 0.5, side by side [0..1, (H, 3 W, 3)]."""
    residual = residual_colours(signed_residual(predicted, measured), 0.5)
    return torch.cat((predicted.clamp(0, 1), measured.clamp(0, 1), residual), dim=1)
