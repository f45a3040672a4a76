"""Cameras whose frames were taken at other times than those of the others, by an offset that is known."""

from collections.abc import Sequence
from types import SimpleNamespace

from torch import Tensor

from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.render.camera_faults.base import Observation, faults_of
from pacnerf_lpo.types import Video


class KnownOffset(Observation):
    """A frame stamped t shows the world at t + offset. Nothing to identify: the offset was measured with the scene.

    Args:
        offset: how much later than stamped the frames were taken [s].
        view: file id of the camera.
    """

    parameters = {}  # noqa: RUF012
    signature = "one view runs ahead or behind, by a time that is known"
    probes = ()

    def __init__(self, offset: float, view: int):
        super().__init__({}, view)
        self.offset = offset

    def time(self, t: Tensor, c: SimpleNamespace) -> Tensor:
        return t + self.offset


def cameras_of(effects: Sequence[Effect], video: Video) -> tuple[Observation, ...]:
    """What acts on the cameras: the known offsets of their clocks, then the faults that a model has of them."""
    offsets = zip(video.view_ids, video.offsets, strict=False)
    return (*(KnownOffset(offset, view) for view, offset in offsets if offset), *faults_of(effects))
