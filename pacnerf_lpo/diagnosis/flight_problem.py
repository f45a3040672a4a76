"""The scenes of measured flights as the problem of a diagnosis: one recording, or a study of several."""

from collections.abc import Sequence
from pathlib import Path

from pacnerf_lpo.data.recordings.files import read_values
from pacnerf_lpo.data.trajectories.scene import NAME, read_scene, scenes_in
from pacnerf_lpo.diagnosis.catalogue import known_classes, read_effects
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.problem import Problem
from pacnerf_lpo.identification.rigid import Flight, RigidProblem
from pacnerf_lpo.identification.study import StudyProblem


def flights(paths: Sequence[str | Path]) -> list[Path]:
    """The scenes of measured flights that are given, in folders or by themselves; none where all are runs.

    Raises:
        UserInputError: runs and such scenes together.
    """
    found = [scenes_in(Path(path)) for path in paths]
    if any(found) and not all(found):
        other = next(path for path, own in zip(paths, found, strict=True) if not own)
        raise UserInputError(f"diagnose: {other} is no scene of a measured flight, as the others are; give them apart")
    return [scene for own in found for scene in own]


def problem_of_flights(folders: Sequence[Path], divided: Sequence[str]) -> tuple[Problem, bytes]:
    """What is under diagnosis, and bytes that differ where the diagnosis may differ.

    Of several flights with measured spins, each has a coefficient of its own for every effect that they enter: spins
    are measured with errors of their own, up to another sense of rotation.

    Args:
        folders: scenes of one body.
        divided: names of the classes of effects that every recording has for itself.
    """
    folders = [folder.resolve() for folder in folders]
    problems = [problem_of_flight(folder) for folder in folders]
    if any(problem.flight.spin is not None for problem in problems):
        divided = [*divided, *(kind.__name__ for kind in known_classes() if kind.constants_of_recording)]
    fingerprint = b"".join(problem.fingerprint for problem in problems) + str(list(divided)).encode()
    if len(problems) == 1:
        return problems[0], fingerprint
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        names = [f"{folder.parent.name}_{folder.name}" for folder in folders]
    return StudyProblem(problems, names, divided), fingerprint


def problem_of_flight(folder: Path) -> RigidProblem:
    """One scene. Raises UserInputError."""
    scene = read_scene(folder)
    effects = read_effects(folder / NAME, read_values(folder / NAME)["physics"].get("effects") or [])
    spin = None if scene.one.spin is None else tuple(scene.one.spin.tolist())
    flight = Flight(
        folder.name,
        scene.one.times,
        scene.one.positions,
        scene.noise,
        scene.solid.make(),
        scene.solid.mass,
        scene.held,
        scene.guess,
        spin,
        scene.one.source,
    )
    return RigidProblem(flight, scene.gravity, effects)
