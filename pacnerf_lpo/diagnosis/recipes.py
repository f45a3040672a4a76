"""Recordings that a person could make of the same object, and what a model would see in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.data import cameras
from pacnerf_lpo.identification.forward_model import VELOCITY, BodyModel, Model, with_effects
from pacnerf_lpo.identification.problem import Part
from pacnerf_lpo.mpm.effects import Effect, InitialSpin, Magnus
from pacnerf_lpo.types import Video

BACK = (1.0, 1.25, 1.6, 2.0, 2.5, 3.2)
"""Factors on the distance of the cameras that are tried until they see the whole motion."""


@dataclass(frozen=True)
class Recipe:
    """A recording, described by how it differs from one that there is.

    name: what a person does, with ``{height}`` and ``{before}`` for the heights of the drops, ``{rate}`` for the frames
        per second and ``{frames}`` for their number.
    higher: factor on the height of the body above the ground.
    throw: velocity that is added at frame 0 [m/s]
    spin: of the body at frame 0 [rad/s]
    opposite: whether it turns the other way round than it was measured to.
    faster: factor on the frame rate.
    longer: factor on the time that is recorded after the contact.
    nearer: factor on the distance of the cameras.
    """

    name: str
    higher: float = 1.0
    throw: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    opposite: bool = False
    faster: float = 1.0
    longer: float = 1.0
    nearer: float = 1.0


DROP = "drop it from {height:.2g} m instead of {before:.2g} m"
RECIPES = (
    Recipe("record the same once more"),
    Recipe(DROP, higher=1.5),
    Recipe(DROP, higher=2.0),
    Recipe(DROP, higher=3.0),
    Recipe(DROP, higher=0.5),
    Recipe("go on recording for twice as long after the contact, {frames} frames in all", longer=2.0),
    Recipe("put the cameras at two thirds of the distance", nearer=2 / 3),
    Recipe("record the same with {rate:.0f} instead of {rate_before:.0f} frames per second", faster=2.0),
    Recipe("throw it upwards with 2 m/s from the same height", throw=(0.0, 2.0, 0.0)),
    Recipe("throw it down with 3 m/s from the same height", throw=(0.0, -3.0, 0.0)),
    Recipe("throw it sideways with 3 m/s from the same height", throw=(3.0, 0.0, 0.0)),
    Recipe("let it fall with a spin of two turns per second", spin=(0.0, 0.0, 4 * np.pi)),
    Recipe("throw it as before, but with the opposite spin", opposite=True),
)
"""The easiest first."""


@dataclass(frozen=True)
class Proposed:
    """A recipe worked out for one recording.

    recipe: what it is.
    words: the same with numbers.
    lifted: how far the body is above where it was [m]
    video: cameras and times; no pictures.
    contact: time until the contact in the recording that there is, and in this one [s]
    scale: size of a pixel relative to the cameras as they were.
    """

    recipe: Recipe
    words: str
    lifted: float
    video: Video
    contact: tuple[float, float]
    scale: float

    def model(self, part: Part) -> Model:
        """What a model of the old recording says of this one, without its camera faults; what belongs to a recording
        alone stands where a person would have it.
        """
        problem = part.recording
        shared = [self._turning(effect) for effect in part.effects if not effect.of_recording]
        turns = [InitialSpin(*self.recipe.spin)] if any(self.recipe.spin) else []  # type: ignore[arg-type, call-arg]
        known = {**part.known, **{name: value for effect in turns for name, value in effect.guess.items()}}
        for parameter, more in zip(VELOCITY, self.recipe.throw, strict=True):
            known[parameter.name] += more
        body = problem.body
        up = torch.tensor([0.0, self.lifted, 0.0], dtype=body.positions.dtype)
        rate = problem.physics.frame_rate * self.recipe.faster
        physics = with_effects(problem.physics, [*shared, *turns], body.spacing, problem.voxel, rate)
        return BodyModel(replace(body, positions=body.positions + up), physics, self.video, known)

    def _turning(self, effect: Effect) -> Effect:
        """An effect as it is in this recording, if it was given the spin that was measured in the old one."""
        if not isinstance(effect, Magnus) or effect.spin is None:
            return effect
        spin = self.recipe.spin if any(self.recipe.spin) else effect.spin
        return effect.at([-turn for turn in spin] if self.recipe.opposite else spin)


def work_out(recipe: Recipe, part: Part) -> Proposed | None:
    """A recipe for a recording, with the fitted model that there is of it; None where cameras that are nearer would not
    see all of the motion. Raises SimulationError.
    """
    problem, known = part.recording, part.known
    old = problem.video
    rate = problem.physics.frame_rate
    bottom = float(problem.body.positions[:, 1].min()) - known["ground_height"]
    gravity, upward = -problem.physics.gravity[1], known["v_y"]
    times = _fall(bottom, upward, gravity), _fall(recipe.higher * bottom, upward + recipe.throw[1], gravity)
    after = max(float(old.times[-1] - old.times[0]) - times[0], 0.0) * recipe.longer
    frames = max(2, round((times[1] + after) * rate * recipe.faster) + 1)
    if times[0] == times[1] and recipe.faster == recipe.longer == 1:
        frames = len(old.times)
    words = recipe.name.format(
        height=recipe.higher * bottom, before=bottom, rate=rate * recipe.faster, rate_before=rate, frames=frames
    )
    lifted = (recipe.higher - 1) * bottom
    views, _, height, width = old.silhouettes.shape
    times_seen = torch.arange(frames, dtype=torch.float64) / (rate * recipe.faster)
    blank = Video.no_pictures(views, frames, height, width)
    video = replace(old, **blank, times=times_seen, frame_ids=tuple(range(frames)))
    found = Proposed(recipe, words, lifted, video, times, recipe.nearer)
    model = found.model(part)
    path = model.path(model.start)
    aim = part.recording.body.positions.mean(0)
    for back in BACK:
        moved = recipe.nearer * back
        raised = lifted / 2 if back > 1 else 0.0
        seen = replace(video, camera_to_world=_moved(old.camera_to_world, aim, moved, raised))
        if _in_view(path, seen) or back == BACK[-1]:
            break
    if back > 1 and recipe.nearer < 1:
        return None
    if back > 1:
        words += f" (with the cameras at {back:g} times the distance, so that they see all of it)"
    return replace(found, words=words, video=seen, scale=moved)


def _fall(height: float, upward: float, gravity: float) -> float:
    """Time [s] to fall from a height [m] with an upward velocity [m/s] under gravity [m/s^2]."""
    return (upward + float(np.sqrt(max(upward**2 + 2 * gravity * max(height, 0.0), 0.0)))) / max(gravity, 1e-6)


def _moved(poses: Tensor, aim: Tensor, distance: float, raised: float) -> Tensor:
    """Cameras [(V, 3, 4), m] at another multiple of their distance from a point [m, (3,)], and raised [m]."""
    found = poses.clone()
    found[..., 3] = aim + distance * (poses[..., 3] - aim)
    found[:, 1, 3] += raised
    return found


def _in_view(path: Tensor, video: Video) -> bool:
    """Whether nearly all particles [m, (F, N, 3)] are in the picture in all views and frames."""
    height, width = video.silhouettes.shape[2:]
    flat = path.reshape(-1, 3)
    for intrinsic, pose in zip(video.intrinsics, video.camera_to_world, strict=True):
        pixels, depth = cameras.project(flat, intrinsic, pose)
        inside = (pixels >= 0).all(1) & (pixels[:, 0] <= width) & (pixels[:, 1] <= height) & (depth > 0)
        if inside.float().mean() < 0.98:
            return False
    return True


def recipes_for(effects: Sequence[object]) -> list[Recipe]:
    """The recipes, without the spin where a spin of the recording is in question, and without the opposite of a spin
    where none was measured.
    """
    turning = any(isinstance(effect, InitialSpin) for effect in effects)
    measured = any(isinstance(effect, Magnus) and effect.spin is not None for effect in effects)
    return [r for r in RECIPES if not (turning and any(r.spin)) and (measured or not r.opposite)]
