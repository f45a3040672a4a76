"""The comparison of a run's model with its video, as a diagnosis reads it from the run directory."""

import json
from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from pacnerf_lpo.diagnosis.catalogue import known_classes
from pacnerf_lpo.diagnosis.flight_problem import flights, problem_of_flights
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.identification.problem import PARTICLES, Problem, StateProblem
from pacnerf_lpo.identification.split import split
from pacnerf_lpo.identification.study import StudyProblem
from pacnerf_lpo.scene_folder import RUN

LEAST_FITTED = 30
"""Numbers of points that make a fit, where there is nothing else."""


def problem_of_runs(
    run_dirs: Sequence[str | Path],
    stem: str | None,
    particles: int,
    points: tuple[str | None, str | None],
    images: bool,
    divided: Sequence[str],
) -> tuple[Problem, bytes]:
    """What is under diagnosis, a run or a study of several, and bytes that differ where the diagnosis may differ.

    Args:
        run_dirs: folders that fit wrote, of one object; or scenes of measured flights, or folders of such.
        stem, particles, images: as for :class:`RunProblem`.
        points: tracks and clouds in place of the run's own.
        divided: names of the classes of effects that every recording has for itself.

    Raises:
        UserInputError: a run or its points cannot be used, or the runs are no study of one object.
    """
    scenes = flights(run_dirs)
    if scenes:
        if stem is not None or any(points) or not images:
            raise UserInputError(
                "diagnose: --phase, --tracks, --clouds and --images are for runs, not measured flights"
            )
        check_divided(divided)
        return problem_of_flights(scenes, divided)
    if len(run_dirs) == 1:
        if divided:
            raise UserInputError("diagnose: --per-recording is for several runs; give them one after the other")
        problem = RunProblem(Run(run_dirs[0]), stem, particles, *points, images)
        return problem, problem.fingerprint
    if any(points):
        raise UserInputError("diagnose: --tracks and --clouds belong to one recording; of several, give them to fit")
    paths = [Path(run_dir).resolve() for run_dir in run_dirs]
    for path, given in zip(paths, run_dirs, strict=True):
        if paths.count(path) > 1:
            raise UserInputError(f"diagnose: {given} is given twice; a study is of different recordings")
    check_divided(divided)
    runs = [Run(run_dir) for run_dir in run_dirs]
    for run in runs:
        if run.manifest.status == "failed":
            raise UserInputError(
                f"{run.run_dir}: its fit failed; go on with `fit --resume {run.run_dir}`, or leave it out of the study"
            )
    problems = [RunProblem(run, stem, particles, images=images) for run in runs]
    called = [path.parent.name if path.name == RUN else path.name for path in paths]
    if len(set(called)) < len(called):
        called = [f"{path.parent.name}_{path.name}" for path in paths]
    return StudyProblem(problems, called, divided), b"".join(p.fingerprint for p in problems) + str(divided).encode()


def check_divided(names: Sequence[str]) -> None:
    """Raise UserInputError for the name of an effect that the package does not have or that has no coefficient."""
    known = {kind.__name__: kind for kind in known_classes()}
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, 1, 0.0)
            raise UserInputError(f"diagnose: --per-recording {name}: no such effect; did you mean {near[0]}?")
        if not known[name].parameters:
            raise UserInputError(f"diagnose: --per-recording {name}: it has no coefficient that could differ")


class RunProblem(StateProblem):
    """A run: its video and its model.

    Args:
        run: the run; its last phase before a correction supplies the body and the first guess of the motion.
        stem: another phase, such as ``01_velocity``.
        particles: the body is sampled by about so many.
        tracks, clouds: measured in addition to the video, in place of the run's own; None: as the run has them.
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
        if not run.physics.decided:
            raise UserInputError(
                f"{run.run_dir}: physics.material is auto, and no law has been chosen yet; go on with "
                f"`pacnerf-lpo fit --resume {run.run_dir}`"
            )
        self.run, self.stage, self.images = run, run.stage(stem) if stem else run.uncorrected, images
        data = run.data
        if tracks is not None or clouds is not None:
            data.measure(data.video, tracks or data.tracks, clouds or data.clouds)
        if not images and data.tracked_points is None and data.point_clouds is None:
            raise UserInputError("diagnose: --images false leaves nothing to compare; give --tracks or --clouds")
        super().__init__(run.scene, data, self.stage.state, run.physics, split(data), images, particles, images)
        if self.points is not None:
            self.split = replace(self.split, points=self.points.fitted)
        fitted, judging = int(self.fitted.sum()), int((self.usable & self.split.held[..., None]).sum())
        if not images and (fitted < LEAST_FITTED or judging == 0):
            raise UserInputError(
                f"diagnose: the points give {fitted} numbers to fit and {judging} to judge by, in the last frames and "
                f"every third tracked point; {LEAST_FITTED} and 1 are needed, give more points or compare the images"
            )

    @property
    def fingerprint(self) -> bytes:
        """Differs for runs whose diagnosis may differ."""
        config = json.dumps([self.run.config["data"], self.run.config["physics"]], default=str)
        points = b"" if self.points is None else self.points.fingerprint + bytes([self.images])
        return self.stage.state_path.read_bytes() + config.encode() + points
