"""The truth: a finer simulation with its own particles, filmed by cameras that are not quite ideal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.identification.forward_model import MARGIN, BodyModel
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.particles.sampling import interpolate
from validation.hidden_effects.setting import FRAME_RATE, Setting

FASTER, FASTER_AT = 1.6, 0.75
"""Steps per second relative to those of the diagnosis' model, for a node spacing of so much of the model's."""
SUPERSAMPLING = 2
MATTE_NOISE = 0.4
"""Of the opacity of half-covered pixels: edges err by 0.2 pixels then, those of path-traced videos by 0.3."""
BRIGHTNESS_NOISE, VIEW_SHADE = 0.004, 0.008


@dataclass(frozen=True)
class Film:
    """What the cameras recorded.

    silhouettes: opacity [0..1, (V, F, H, W)]
    brightness: logarithm of the mean brightness relative to what is believed [(V, F)]
    path: of the particles [m, (F, N, 3)];  model: that moved.
    """

    silhouettes: Tensor
    brightness: np.ndarray
    path: Tensor
    model: BodyModel


def film(
    setting: Setting,
    true: dict[str, float],
    effects: Sequence[Effect],
    random: np.random.Generator,
    finer: float,
) -> Film:
    """Simulate and record a scene.

    Args:
        setting: of the scene.
        true: every value, of velocity and effects too [SI]
        effects: that act.
        random: of particles and noise.
        finer: node spacing relative to the setting's; the time step follows it.

    Raises:
        SimulationError: the motion is unstable.
    """
    rate = FASTER * setting.rate * FASTER_AT / finer
    physics = Physics(setting.law_at(true), effects=effects, substep_rate=rate, frame_rate=FRAME_RATE)
    generator = torch.Generator().manual_seed(int(random.integers(1 << 31)))
    spacing = finer * setting.spacing
    positions = setting.filled(spacing / 2, generator)
    full = torch.ones(len(positions))
    discs = Discs.within(lambda points: interpolate(setting.surface, points)[0], positions, spacing / 2)
    body = Body(positions, full, spacing, discs)
    model = BodyModel(body, physics, setting.video(factor=SUPERSAMPLING), true)
    path = model.path(model.start)
    views = [matte(model.outlines(path, model.start, [view])[0], random) for view in range(len(setting.cameras))]
    shade = VIEW_SHADE * random.standard_normal((len(views), 1))
    brightness = model.brightness(model.start) + shade
    brightness += BRIGHTNESS_NOISE * random.standard_normal(brightness.shape)
    return Film(torch.stack(views), brightness - np.median(brightness, axis=0), path, model)


def matte(opacity: Tensor, random: np.random.Generator) -> Tensor:
    """What a matting makes of opacities of twice the size, with a margin: [0..1, (F, H, W)]."""
    inner = opacity[..., MARGIN:-MARGIN, MARGIN:-MARGIN]
    small = functional.avg_pool2d(inner, SUPERSAMPLING)
    noise = torch.from_numpy(random.standard_normal(small.shape)).to(small)
    return (small + 4 * MATTE_NOISE * small * (1 - small) * noise).clamp(0.0, 1.0)
