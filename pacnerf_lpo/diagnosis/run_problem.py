"""The comparison of a run's model with its video, as a diagnosis reads it from the run directory."""

from __future__ import annotations

import json
from dataclasses import replace

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.identification.problem import PARTICLES, StateProblem
from pacnerf_lpo.identification.split import split

LEAST_FITTED = 30
"""Numbers of points that make a fit, where there is nothing else."""


class RunProblem(StateProblem):
    """A run: its video and its model.

    Args:
        run: the run; its last phase before a correction supplies the body and the first guess of the motion.
        stem: another phase, such as ``01_velocity``.
        particles: the body is sampled by about so many.
        tracks, clouds: measured beside the video, in place of the run's own; None: as the run has them.
        images: False: only points are compared.

    Raises:
        UserInputError: too few views or frames, or wrong or too few points.
    """

    def __init__(
        self,
        run: Run,
        stem: str | None = None,
        particles: int = PARTICLES,
        tracks: str | None = None,
        clouds: str | None = None,
        images: bool = True,
    ):
        self.run, self.stage, self.images = run, run.stage(stem) if stem else run.uncorrected, images
        data = run.data
        if tracks is not None or clouds is not None:
            data.measure(data.video, tracks or data.tracks, clouds or data.clouds)
        if not images and data.tracked_points is None and data.point_clouds is None:
            raise UserInputError("diagnose: --images false leaves nothing to compare; give --tracks or --clouds")
        held = split(data)
        super().__init__(run.scene, data, self.stage.state, run.physics, held, images, particles, images)
        if self.points is not None:
            self.split = replace(self.split, points=self.points.fitted)
        if not images:
            self._check_points()

    def _check_points(self) -> None:
        fitted, held = int(self.fitted.sum()), int((self.usable & self.split.held[..., None]).sum())
        if fitted < LEAST_FITTED or held == 0:
            raise UserInputError(
                f"diagnose: the points give {fitted} numbers to fit and {held} to judge by, in the last frames and "
                f"every third tracked point; {LEAST_FITTED} and 1 are needed, give more points or compare the images"
            )

    @property
    def fingerprint(self) -> bytes:
        """Differs for runs whose diagnosis may differ."""
        config = json.dumps([self.run.config["data"], self.run.config["physics"]], default=str)
        points = b"" if self.points is None else self.points.fingerprint + bytes([self.images])
        return self.stage.state_path.read_bytes() + config.encode() + points
