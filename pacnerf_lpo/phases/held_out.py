"""Training images held out of the correction, to decide whether another round of Algorithm 1 still helps."""

from collections.abc import Iterable

import torch

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases.image_cost import ImageCost
from pacnerf_lpo.render.clocks import cameras_of
from pacnerf_lpo.render.observation import Observer
from pacnerf_lpo.types import ParticleState

Images = frozenset[tuple[int, int]]


def held_out_images(data: VideoData) -> Images:
    """View and frame index of the held-out images: in every second frame that of one training view, in turn.

    Frame 0 is not among them, because the static phase has seen it in all training views.
    """
    frames = range(1, len(data.video.times), 2)
    return frozenset((data.train[turn % len(data.train)], frame) for turn, frame in enumerate(frames))


@torch.no_grad()
def held_out_error(data: VideoData, physics: Physics, state: ParticleState, images: Iterable[tuple[int, int]]) -> float:
    """Mean squared colour error (0..1, summed over channels) of a state in images, each a view and a frame index."""
    video = data.video
    values = physics.values(state)
    observer, cost = Observer(cameras_of(physics.effects, video), values), ImageCost(data, state)
    seen = observer.seen(physics.simulate(state, len(video.times)), physics.velocity_of(state), video.times)
    return cost.colour_error(seen, state.density, state.features, sorted(images), observer)
