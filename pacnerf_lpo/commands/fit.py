"""``pacnerf-lpo fit``: the phases of Algorithm 1 on a video, then evaluation and report."""

from __future__ import annotations

from collections.abc import Sequence

import pacnerf_lpo.mpm.effects
import pacnerf_lpo.mpm.materials
import pacnerf_lpo.phases.schedules
import pacnerf_lpo.phases.static_grid
import pacnerf_lpo.render.camera_faults  # noqa: F401  (short class names in YAML exist once their modules are imported)
from pacnerf_lpo import cli
from pacnerf_lpo.data.video_module import VideoData
from pacnerf_lpo.mpm.physics import Physics


def run(args: Sequence[str]) -> int:
    """Run the command; returns its exit status."""
    return cli.fit(args, VideoData, Physics)
