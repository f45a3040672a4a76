"""What velocity estimation, physical identification and LPO share: a particle state that moves and is filmed."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.phases.base import AbstractPhase, psnr
from pacnerf_lpo.phases.image_cost import ImageCost
from pacnerf_lpo.phases.work import Work, compared
from pacnerf_lpo.render.camera_faults.base import faults_of
from pacnerf_lpo.render.clocks import cameras_of
from pacnerf_lpo.render.observation import AS_BELIEVED, Observer
from pacnerf_lpo.types import ParticleState

FRAME_RATE_TOLERANCE = 0.01
TEST_EVERY = 5
"""Steps of a correction between two looks at the test views: each renders as many images as a step, without gradients,
so that they take less than a tenth of the time."""


class DynamicPhase(AbstractPhase):
    """A phase that starts from a particle state and compares its motion with the video.

    Args:
        steps: number of optimiser steps.
        silhouette_weight: weight of the squared error between opacity and matte (0 in the paper). Shading that changes
            along the fall pulls the colours alone towards a wrong motion; outlines do not.
        seed: seed of the random choice of views; step k draws from ``seed + k``, so a resumed run repeats itself.
    """

    state: ParticleState
    image_cost: ImageCost

    def __init__(self, steps: int, silhouette_weight: float = 0.0, seed: int = 0):
        super().__init__()
        if steps < 1:
            raise UserInputError(f"{type(self).__name__}: give at least one iteration")
        self.steps, self.silhouette_weight, self.seed = steps, silhouette_weight, seed

    def check(self) -> None:
        """Raise UserInputError when the video's time stamps and ``physics.frame_rate`` differ by more than 1 %, or an
        effect names a camera that the training views do not show.
        """
        video, times, rate = self.data.video, self.data.video.times, self.physics.frame_rate
        if len(times) < 2:
            raise UserInputError(f"{video.source}: one frame shows no motion; at least two are needed")
        measured = (len(times) - 1) / float(times[-1] - times[0])
        if abs(measured / rate - 1) > FRAME_RATE_TOLERANCE:
            raise UserInputError(
                f"{video.source}: its time stamps give {measured:.2f} frames/s but physics.frame_rate is {rate:g}; set "
                f"--physics.frame_rate={measured:.4g}"
            )
        used = [video.view_ids[index] for index in self.data.train]
        for effect in faults_of(self.physics.effects):
            if effect.view is not None and effect.view not in used:
                raise UserInputError(
                    f"physics.effects: {type(effect).__name__} concerns view {effect.view}, which is no training view; "
                    f"set its view to one of {used}, or add it to data.train_views"
                )
        self.check_settings()
        self.physics.halvings = 0

    def check_settings(self) -> None:
        """Raise UserInputError where the video or the model does not suit the settings of the phase."""
        return

    def import_state(self, state: ParticleState | None) -> None:
        """Keep the state and prepare the comparison with the video; then :meth:`begin`."""
        if state is None:
            raise UserInputError(f"{type(self).__name__} needs a particle state: run the static phase before it")
        self.state = state
        self.image_cost = ImageCost(self.data, state, self.silhouette_weight)
        self.begin()

    @abstractmethod
    def begin(self) -> None:
        """Make what is optimised, from the state that was imported."""

    def one_view_per_frame(self, step: int, frames: int) -> list[list[int]]:
        """One random training view for each frame, of those whose image is not held out."""
        generator = torch.Generator().manual_seed(self.seed * 100_003 + step)
        picks = torch.rand(frames, generator=generator).tolist()
        open_views = ([v for v in self.data.train if (v, frame) not in self.held_out] for frame in range(frames))
        return [[views[int(pick * len(views))]] for pick, views in zip(picks, open_views, strict=True)]

    def fixed_views(self, frames: int, per_frame: int | None) -> list[list[int]]:
        """So many training views for each frame, evenly spread and rotating from frame to frame; None: all of them."""
        train = self.data.train
        count = min(per_frame or len(train), len(train))
        steps = [k * len(train) // count for k in range(count)]
        return [[train[(frame + step) % len(train)] for step in steps] for frame in range(frames)]

    def rollout(
        self, velocity: Tensor, parameters: dict[str, Tensor], frames: int, moved: tuple[Tensor, Tensor] | None = None
    ) -> Tensor:
        """Trajectory [m, (frames, N, 3)] with a velocity [m/s, (3,) or (N, 3)] of the imported particles; or of others,
        ``moved``: positions at frame 0 [m, (N, 3)] and raw density [(N,)].
        """
        positions, density = (self.state.positions, self.state.density) if moved is None else moved
        everywhere, massive = velocity.expand_as(positions), self.state.massive(density)
        return self.physics.rollout(positions, everywhere, massive, parameters, self.state.spacings, frames)

    def watch(self, trajectory: Tensor, velocity: Tensor, parameters: Mapping[str, Tensor]) -> tuple[Tensor, Observer]:
        """How cameras see a motion [m, (F, N, 3)] from frame 0 on, to be compared by :class:`ImageCost`: positions by
        each clock [m, (clocks, F, N, 3)], and what is wrong with the cameras.

        The velocity is that at frame 0 without the effects on it [m/s, (N, 3) or (3,)]; all parameters are given [SI].
        """
        cameras = cameras_of(self.physics.effects, self.data.video)
        if not cameras:
            return trajectory[None], AS_BELIEVED
        first, density = trajectory[0], self.state.massive(self.state.density)
        everywhere = velocity.expand_as(first)
        start = self.physics.initial_velocity(first, everywhere, density, parameters, self.state.spacings)
        names = [name for effect in cameras for name in effect.parameters]
        now = {name: parameters[name].clone() for name in names}  # not what an optimiser makes of them later
        observer = Observer(cameras, now)
        return observer.seen(trajectory, start, self.data.video.times[: len(trajectory)]), observer

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep how often the time step was halved, and what the phase has reached."""
        checkpoint["step_halvings"] = self.physics.halvings
        checkpoint["progress"] = self.progress()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Go on with the time step and the progress that were reached."""
        self.physics.halvings = checkpoint["step_halvings"]
        self.take_up(checkpoint["progress"])

    def progress(self) -> dict[str, Any]:
        """What a checkpoint keeps in addition to weights and optimiser: plain data and tensors."""
        return {}

    def take_up(self, progress: dict[str, Any]) -> None:
        """Go on with what :meth:`progress` gave."""
        return


class Correction(DynamicPhase):
    """A phase that corrects what the body is at frame 0 by the whole video, while physics and velocity stay."""

    density_drives_mass: bool

    def work(self, particles: int) -> Work:
        return compared(len(self.data.video.times), 1, gradients=True) * self.steps

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        self.log("correction/Adam rate", optimizer.param_groups[0]["lr"])

    def loss(self, step: int, velocity: Tensor, positions: Tensor, density: Tensor, features: Tensor) -> Tensor:
        """Cost of particles over all frames, one random training view for each; logged in the steps of the phase."""
        driving, values = density if self.density_drives_mass else density.detach(), self.physics.values(self.state)
        trajectory = self.rollout(velocity, values, self.image_cost.frames, (positions, driving))
        seen, observer = self.watch(trajectory, velocity, values)
        views = self.one_view_per_frame(step, self.image_cost.frames)
        loss = self.image_cost.loss(seen, density, features, views, observer=observer)
        if step < self.steps:
            self._log_test_psnr(step, seen, density, features, observer)
            self.log("correction/loss", loss)
        return loss

    @torch.no_grad()
    def _log_test_psnr(self, step: int, seen: Tensor, density: Tensor, features: Tensor, observer: Observer) -> None:
        """Log the PSNR of the test views, in every so many steps: one view for each frame, in turn."""
        test = self.data.test
        if test and step % TEST_EVERY == 0:
            images = [(test[frame % len(test)], frame) for frame in range(seen.shape[1])]
            error = self.image_cost.colour_error(seen, density, features, images, observer)
            self.log("correction/PSNR of test views [dB]", psnr(error / 3))
