"""The colour network: 12 features and an encoded view direction to RGB."""

import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from pacnerf_lpo.types import FEATURES

FREQUENCIES = 4
ENCODING = 3 + 3 * 2 * FREQUENCIES
WIDTH = 128


def encode_directions(directions: Tensor) -> Tensor:
    """Unit directions (S, 3) to (d, sin 2^k d, cos 2^k d), k = 0..3: (S, 27)."""
    scaled = (directions[:, :, None] * 2.0 ** torch.arange(FREQUENCIES, device=directions.device)).flatten(1)
    return torch.cat((directions, scaled.sin(), scaled.cos()), dim=1)


class ColourNetwork(nn.Module):
    """12 features + 27 direction values -> 128 -> 128 -> 3, ReLU between, sigmoid at the end (PAC-NeRF)."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Linear(FEATURES + ENCODING, WIDTH)
        self.second = nn.Linear(WIDTH, WIDTH)
        self.last = nn.Linear(WIDTH, 3)
        nn.init.zeros_(self.last.bias)

    def forward(self, features: Tensor, directions: Tensor) -> Tensor:
        """Colours in 0..1 (S, 3) of features (S, 12) seen along unit ``directions`` (S, 3)."""
        return self.finish(features, self.direction_part(directions))

    def direction_part(self, directions: Tensor) -> Tensor:
        """What the first layer makes of the directions (R, 3): (R, 128). Computed once per ray, not per sample."""
        return linear(encode_directions(directions), self.first.weight[:, FEATURES:], self.first.bias)

    def finish(self, features: Tensor, direction_part: Tensor) -> Tensor:
        """Colours (S, 3) of features (S, 12), given each sample's :meth:`direction_part` (S, 128)."""
        hidden = torch.addmm(direction_part, features, self.first.weight[:, :FEATURES].T).relu_()
        return self.last(self.second(hidden).relu_()).sigmoid()
