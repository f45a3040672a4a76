"""A study: several recordings of one object as one problem.

Material and effects are shared; velocity, height of the ground and camera faults belong to a recording, and so does an
effect that is declared per recording (a wind that blew in one of them only). The rows of all recordings are stacked:
first the views of all, then the points of all. Shorter recordings are filled up with frames in which nothing was seen.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.forward_model import VELOCITY, Model, with_effects
from pacnerf_lpo.identification.problem import Part, Problem
from pacnerf_lpo.identification.rigid import PLACE, RELEASE
from pacnerf_lpo.identification.split import Split
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.parameters import OF, Parameter, name_in, own_name
from pacnerf_lpo.mpm.physics import GROUND_HEIGHT
from pacnerf_lpo.render.camera_faults.base import Observation
from pacnerf_lpo.types import Video

CAMERAS = 1000
"""View v of recording k is view 1000 k + v of a study."""
OF_RECORDING = {parameter.name for parameter in (GROUND_HEIGHT, *VELOCITY, *PLACE, RELEASE)}
ANOTHER_SIZE = 0.25
"""Bodies whose principal extents differ by more are not the same one: reconstructions differ by a few percent."""


@dataclass(frozen=True)
class Stack:
    """How the arrays of recordings lie in that of a study.

    views, points, frames: how many each recording has.
    """

    views: tuple[int, ...]
    points: tuple[int, ...]
    frames: tuple[int, ...]

    def rows(self, number: int) -> np.ndarray:
        """Rows of one recording."""
        view, point = sum(self.views[:number]), sum(self.views) + sum(self.points[:number])
        return np.r_[view : view + self.views[number], point : point + self.points[number]]

    def join(self, arrays: Sequence[np.ndarray], axis: int = 0) -> np.ndarray:
        """Arrays of all recordings (..., rows, frames, ...) as one; NaN, or False, where a recording has no frame."""
        first = arrays[0]
        axis %= first.ndim
        shape = list(first.shape)
        shape[axis : axis + 2] = [sum(self.views) + sum(self.points), max(self.frames)]
        found = np.full(shape, False if first.dtype == bool else np.nan)
        for number, array in enumerate(arrays):
            at: list = [slice(None)] * axis
            found[tuple([*at, self.rows(number), slice(self.frames[number])])] = array
        return found

    def part(self, values: np.ndarray, number: int, axis: int = 0) -> np.ndarray:
        """What belongs to one recording in a joined array."""
        at: list = [slice(None)] * (axis % values.ndim)
        return values[tuple([*at, self.rows(number), slice(self.frames[number])])]

    def relative(self, compared: Sequence[Callable[[np.ndarray], np.ndarray]], difference: np.ndarray) -> np.ndarray:
        """Differences of moments [(..., R, F, 11)], each recording's as it is compared."""
        return self.join([one(self.part(difference, n, -3)) for n, one in enumerate(compared)], -3)


class StudyProblem(Problem):
    """Several recordings of one object.

    Args:
        recordings: each a problem.
        names: of the recordings, all different.
        divided: names of the classes of effects that every recording has for itself, besides those that always are.

    Raises:
        UserInputError: fewer than two recordings, equal names, or recordings of different materials or bodies.
    """

    def __init__(self, recordings: Sequence[Problem], names: Sequence[str], divided: Sequence[str] = ()):
        self.recordings, self.names, self.divided = list(recordings), list(names), list(divided)
        check_recordings(self.recordings, self.names)
        counts = [
            (problem.views, len(problem.usable) - problem.views, problem.usable.shape[1]) for problem in recordings
        ]
        self.stack = stack = Stack(*zip(*counts, strict=True))
        first = self.recordings[0]
        inner = [np.broadcast_to(p.split.frames, p.usable.shape[:2]) for p in recordings]
        split = Split(
            np.concatenate([problem.split.views for problem in recordings]),
            stack.join(inner),
            np.concatenate([problem.split.points for problem in recordings]),
        )
        video = _stacked_video([problem.video for problem in recordings])
        measured, noise = (stack.join([getattr(p, name) for p in recordings]) for name in ("measured", "noise"))
        seen = slice(len(video.view_ids))
        scene, voxel = " + ".join(self.names), min(problem.voxel for problem in recordings)
        super().__init__(scene, video, split, first.physics, voxel, measured[seen], noise[seen])
        self.measured, self.noise, self.sensor = measured, noise, stack.join([p.sensor for p in recordings])
        self.usable = stack.join([problem.usable for problem in recordings])
        self.relative = partial(stack.relative, [problem.relative for problem in recordings])
        installed = [self.adopt(effect) for effect in _installed(self.recordings)]
        self.physics = with_effects(first.physics, installed, 1.0, 1.0)
        self.deforms = first.deforms  # type: ignore[misc]

    @property
    def spacing(self) -> float:
        """Node spacing of the first recording's model [m]."""
        return self.recordings[0].spacing

    def sample(self, spacing: float, seed: int) -> Body:
        """The body as the first recording shows it."""
        return self.recordings[0].sample(spacing, seed)

    @cached_property
    def first_guess(self) -> dict[str, float]:
        """Means of what the recordings have found for what they share, and each one's own velocity and ground [SI]."""
        return self._merged([problem.first_guess for problem in self.recordings])

    @property
    def guess(self) -> dict[str, float]:
        return self._merged([problem.guess for problem in self.recordings])

    def adopt(self, effect: Effect) -> Effect:
        """An effect that every recording has for itself with coefficients of each; any other as it is."""
        named = isinstance(effect, Observation) and effect.view is not None  # its view belongs to one recording
        own = (effect.of_recording and not named) or type(effect).__name__ in self.divided
        found = self.recordings[0].adopt(effect)
        return divide(found, self.names) if own else found

    def parts(self, effects: Sequence[Effect], known: dict[str, float]) -> list[Part]:
        found = []
        for (local, names), name, recording in zip(self._shares(effects), self.names, self.recordings, strict=True):
            own = [*recording.guess, *(n for e in local for n in e.parameters), *OF_RECORDING]
            values = {n: known[names.get(n, n)] for n in own if names.get(n, n) in known}
            found.append(Part(name, recording, tuple(local), values))
        return found

    def join(self, arrays: Sequence[np.ndarray], axis: int = 0) -> np.ndarray:
        return self.stack.join(arrays, axis)

    def part_of(self, values: np.ndarray, number: int, axis: int = 0) -> np.ndarray:
        return self.stack.part(values, number, axis)

    def model(self, effects: Sequence[Effect], known: dict[str, float], body: Body | None = None) -> Model:
        """A model of all recordings, of the body that each shows, or of the one that is given."""
        models = [part.recording.model(part.effects, part.known, body) for part in self.parts(effects, known)]
        return self._model(models, effects)

    def coarse_model(self, effects: Sequence[Effect], known: dict[str, float]) -> Model:
        parts = self.parts(effects, known)
        models = [part.recording.coarse_model(part.effects, part.known) for part in parts]
        return self._model(models, effects)

    @property
    def point_names(self) -> list[str]:
        return [f"{p} of {n}" for n, one in zip(self.names, self.recordings, strict=True) for p in one.point_names]

    @property
    def point_kinds(self) -> np.ndarray:
        return np.concatenate([problem.point_kinds for problem in self.recordings])

    def noise_parts(self, sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of all recordings, each as it says."""
        parts = [one.noise_parts(self.part_of(sensor, number)) for number, one in enumerate(self.recordings)]
        widest = max(shared.shape[-1] for _, shared in parts)
        padded = [np.pad(shared, (*[(0, 0)] * 3, (0, widest - shared.shape[-1]))) for _, shared in parts]
        return self.join([own for own, _ in parts]), self.join(padded)

    @property
    def pixel(self) -> float:
        """The mean of the recordings."""
        found = [problem.pixel for problem in self.recordings if problem.pixel]
        return float(np.mean(found)) if found else 0.0

    @property
    def first_frames(self) -> np.ndarray:
        found = np.zeros(len(self.usable), int)
        for number in range(len(self.recordings)):
            found[self.stack.rows(number)] = number * self.usable.shape[1]
        return found

    def _model(self, models: Sequence[Model], effects: Sequence[Effect]) -> "StudyModel":
        names = [called for _, called in self._shares(effects)]
        return StudyModel(models, names, self.names, effects, self.stack)

    def _shares(self, effects: Sequence[Effect]) -> list[tuple[list[Effect], dict[str, str]]]:
        """What concerns each recording: its effects, and what the study calls their coefficients, by its own names."""
        installed = [problem.physics.effects for problem in self.recordings]
        return [_share(effects, n, name, own) for n, (name, own) in enumerate(zip(self.names, installed, strict=True))]

    def _merged(self, values: Sequence[dict[str, float]]) -> dict[str, float]:
        """Values of all recordings [SI] by the names of the study; shared ones are averaged as they are optimised."""
        described = self.recordings[0].physics.parameters
        found: dict[str, float] = {}
        for name in dict.fromkeys(name for own in values for name in own):
            have = [(r, own[name]) for r, own in zip(self.names, values, strict=True) if name in own]
            if name in OF_RECORDING or name not in described:
                found |= {name_in(name, recording): value for recording, value in have}
            else:
                transform = described[name].transform
                mean = float(np.mean([transform.to_free(value) for _, value in have]))
                found[name] = float(transform.to_physical(torch.tensor(mean, dtype=torch.float64)))
        return found


class StudyModel(Model):
    """Models of several recordings with common unknowns. Its motion is that of all bodies side by side.

    Args:
        models: of the recordings.
        names: of each recording's coefficients in the study, by its own; those that are missing are called the same.
        recordings: their names.
        effects: of the study.
        stack: how their rows lie.
    """

    def __init__(
        self,
        models: Sequence[Model],
        names: Sequence[dict[str, str]],
        recordings: Sequence[str],
        effects: Sequence[Effect],
        stack: Stack,
    ):
        self.models, self.stack, self.effects = list(models), stack, tuple(effects)
        self.body, self.physics = models[0].body, models[0].physics
        self.shape = sum(stack.views), max(stack.frames)
        unknowns: dict[str, Parameter] = {}
        low, high, start = (dict[str, float]() for _ in range(3))
        self.known, called = {}, []
        for model, own, recording in zip(models, names, recordings, strict=True):
            called.append([own.get(name, name) for name in model.names])
            for index, (parameter, name) in enumerate(zip(model.unknowns, called[-1], strict=True)):
                mine = name.endswith(OF + recording)
                unknowns[name] = parameter.of_recording(recording) if mine else replace(parameter, name=name)
                low[name] = max(low.get(name, -np.inf), model.bounds[0][index])
                high[name] = min(high.get(name, np.inf), model.bounds[1][index])
                start[name] = model.start[index]
            self.known |= {own.get(name, name): value for name, value in model.known.items()}
        self.unknowns = sorted(unknowns.values(), key=lambda parameter: OF in parameter.name)  # what is shared first
        self.names = tuple(parameter.name for parameter in self.unknowns)
        self.scales = np.array([parameter.scale for parameter in self.unknowns])
        self.start = np.array([start[name] for name in self.names])
        self.bounds = np.array([low[name] for name in self.names]), np.array([high[name] for name in self.names])
        self._places = [[self.names.index(name) for name in own] for own in called]

    def alone(self) -> list[Model]:
        return self.models

    def contact(self, free: np.ndarray, within: float) -> int:
        """Of the recording in which it comes first; the number of frames where none has one."""
        found = [(model.contact(own, within), model.shape[1]) for model, own in self._own(free)]
        return min((first for first, frames in found if first < frames), default=self.shape[1])

    def path(self, free: np.ndarray) -> Tensor:
        """Particles of all recordings at every frame [m, (F, N1 + N2 + ..., 3)]; those of a shorter recording stay
        where they are at its end.
        """
        paths = [model.path(own) for model, own in self._own(free)]
        return torch.cat([torch.cat((p, p[-1:].expand(self.shape[1] - len(p), -1, -1))) for p in paths], dim=1)

    def predict(self, free: np.ndarray) -> np.ndarray:
        return self.stack.join([model.predict(own) for model, own in self._own(free)])

    def observe(self, path: Tensor, free: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
        paths = path.split([len(model.body.positions) for model in self.models], dim=1)
        found = []
        for number, (model, own) in enumerate(self._own(free)):
            seen = None if before is None else self.stack.part(before, number)
            found.append(model.observe(paths[number][: self.stack.frames[number]], own, seen))
        return self.stack.join(found)

    def _own(self, free: np.ndarray) -> list[tuple[Model, np.ndarray]]:
        """Every recording's model with its coordinates."""
        return [(model, free[places]) for model, places in zip(self.models, self._places, strict=True)]


def divide(effect: Effect, recordings: Sequence[str]) -> Effect:
    """The effect with coefficients of its own for every recording. Where constants were measured, and that with errors,
    is why they differ, each is about as large as a probe: what they belong to is one body.

    Raises:
        UserInputError: it has no coefficient.
    """
    if not effect.parameters:
        raise UserInputError(
            f"{type(effect).__name__} has no coefficient, so it cannot differ from recording to recording"
        )
    found = copy(effect)
    if effect.constants_of_recording:
        found.reach = 1.0
    found.parameters = {name_in(n, r): p.of_recording(r) for r in recordings for n, p in effect.parameters.items()}
    found.null, found.guess = (
        {name_in(n, r): v for r in recordings for n, v in d.items()} for d in (effect.null, effect.guess)
    )
    found.probes = tuple({name_in(n, r): v for r in recordings for n, v in probe.items()} for probe in effect.probes)
    return found


def view_name(view: int) -> str:
    """How a person calls a view of a problem, by its file id: ``view 3`` or ``view 3 of recording 2``."""
    number, own = divmod(view, CAMERAS)
    return f"view {own} of recording {number}" if number else f"view {own}"


def _share(
    effects: Sequence[Effect], number: int, recording: str, installed: Sequence[Effect]
) -> tuple[list[Effect], dict[str, str]]:
    """What concerns one recording, whose own model has the ``installed`` effects, in effects of a study."""
    own: list[Effect] = []
    names = {name: name_in(name, recording) for name in OF_RECORDING}
    for effect in effects:
        if isinstance(effect, Observation) and effect.view is not None:
            if effect.view // CAMERAS != number + 1:
                continue
            local: Effect = effect.at(effect.view % CAMERAS)
            names |= zip(local.parameters, effect.parameters, strict=True)
        elif any(OF in name for name in effect.parameters):
            local = copy(effect)
            for divided in ("parameters", "null", "probes"):
                vars(local).pop(divided)
            local.guess = {own_name(n): v for n, v in effect.guess.items() if n.endswith(OF + recording)}
            names |= {name: name_in(name, recording) for name in local.parameters}
        else:
            local = effect
        own.append(_as_measured(local, installed))
    return own, names


def _as_measured(effect: Effect, installed: Sequence[Effect]) -> Effect:
    """An effect with what was measured for it in one recording, whose own model has the ``installed`` effects."""
    mine = next((other for other in installed if type(other) is type(effect)), None)
    if mine is None or not effect.constants_of_recording:
        return effect
    found = copy(mine)
    found.guess = effect.guess
    return found


def _installed(recordings: Sequence[Problem]) -> list[Effect]:
    """Effects of the runs: those on the motion once, faults of cameras with the view ids of the study."""
    found = [effect for effect in recordings[0].physics.effects if not isinstance(effect, Observation)]
    faults = [(n, e) for n, p in enumerate(recordings, 1) for e in p.physics.effects if isinstance(e, Observation)]
    everywhere = {type(e).__name__: e for _, e in faults if e.view is None}
    return [*found, *everywhere.values(), *(e.at(CAMERAS * n + e.view) for n, e in faults if e.view is not None)]


def check_recordings(recordings: Sequence[Problem], names: Sequence[str]) -> None:
    """Raise UserInputError for recordings that are not of one object."""
    if len(recordings) < 2:
        raise UserInputError("a study needs at least two recordings of one object")
    if len(set(names)) < len(names):
        raise UserInputError(
            f"a study: two recordings are called {max(names, key=names.count)}; give each another name"
        )
    first, called = recordings[0], names[0]
    for other, name in zip(recordings[1:], names[1:], strict=True):
        pairs = [(_law(problem), problem.physics.rho) for problem in (first, other)]
        if pairs[0] != pairs[1]:
            raise UserInputError(
                f"a study is of one material: {called} has {_described(*pairs[0])}, {name} has {_described(*pairs[1])}"
            )
        acting = [
            sorted(type(e).__name__ for e in p.physics.effects if not isinstance(e, Observation))
            for p in (first, other)
        ]
        if acting[0] != acting[1]:
            said = [" and ".join(effects) or "no effect" for effects in acting]
            raise UserInputError(f"a study has one model: {called} was fitted with {said[0]}, {name} with {said[1]}")
        sizes = [_extents(problem.body) for problem in (first, other)]
        if (np.abs(sizes[1] / sizes[0] - 1) > ANOTHER_SIZE).any():
            shown = [" x ".join(f"{100 * extent:.3g}" for extent in size) for size in sizes]
            raise UserInputError(
                f"a study is of one body: principal extents are {shown[0]} cm in {called}, but {shown[1]} cm in {name}"
            )
    for problem, name in zip(recordings, names, strict=True):
        if max(problem.video.view_ids, default=0) >= CAMERAS:
            raise UserInputError(f"{name}: view {max(problem.video.view_ids)}; in a study view ids are below {CAMERAS}")


def without_contact(problem: Problem) -> list[str]:
    """A sentence for each recording whose body, moving as first guessed, does not reach the ground."""
    found = []
    for part in problem.parts(problem.physics.effects, problem.first_guess) if problem.deforms else ():
        model = part.model
        if model.contact(model.start, within=1.0) == model.shape[1]:
            found.append(f"{part.name}: the body does not reach the ground; it shows forces, not the material")
    return found


def _law(problem: Problem) -> tuple:
    """Class of the material and the values of its parameters that are not identified."""
    material = problem.physics.material
    fixed = {name: value for name, value in material.guess.items() if name not in material.free_names}
    return type(material).__name__, tuple(sorted(fixed.items()))


def _described(law: tuple, density: float) -> str:
    values = [f"{name} = {value:g}" for name, value in law[1]] + [f"{density:g} kg/m^3"]
    return f"{law[0]} ({', '.join(values)})"


def _extents(body: Body) -> np.ndarray:
    """Standard deviations of the occupied volume along its principal axes, ascending [m, (3,)]."""
    weight = (body.fraction / body.fraction.sum()).double()
    positions = body.positions.double()
    away = positions - (weight[:, None] * positions).sum(0)
    square = (weight[:, None] * away).T @ away
    return np.sqrt(np.linalg.eigvalsh(square.numpy()))


def _stacked_video(videos: Sequence[Video]) -> Video:
    """Cameras of all recordings, and the frames of the longest; without pictures."""
    longest = max(videos, key=lambda video: len(video.times))
    height, width = (max(video.images.shape[axis] for video in videos) for axis in (2, 3))
    ids = [CAMERAS * number + view for number, video in enumerate(videos, 1) for view in video.view_ids]
    return Video(
        **Video.no_pictures(len(ids), len(longest.times), height, width),
        camera_to_world=torch.cat([video.camera_to_world for video in videos]),
        intrinsics=torch.cat([video.intrinsics for video in videos]),
        times=longest.times,
        view_ids=tuple(ids),
        frame_ids=longest.frame_ids,
        source=", ".join(video.source for video in videos),
        offsets=tuple(offset for video in videos for offset in video.offsets or (0.0,) * len(video.view_ids)),
    )
