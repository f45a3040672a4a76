"""Initial velocity from the frames before contact (identification step (a) of PAC-NeRF)."""

import math
from typing import Any

import torch
from torch import Tensor, nn

from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.phases.dynamic import DynamicPhase
from pacnerf_lpo.phases.work import Work, compared
from pacnerf_lpo.types import ParticleState

ITERATIONS_PER_STEP = 4
LOSS_SCALE = 1e3  # L-BFGS moves by the bare gradient first, unless its norm exceeds one
FIRST_STEP = 0.5  # m/s, length of the first trial step
UNSTABLE = 10.0
"""Times the highest loss so far: the penalty that a line search sees for a velocity whose motion is unstable."""


class VelocityModule(DynamicPhase):
    """One global initial velocity by L-BFGS (history 20, strong Wolfe) on the frames before contact.

    Args:
        hit_frame: first frame in which the body touches the ground; the frames before it are used.
        max_iterations: L-BFGS iterations at most.
        guess: velocity to start from [m/s].
        views_per_frame: how many training views each frame is compared in, spread evenly; None: all.
        silhouette_weight: see :class:`DynamicPhase`.
        tolerance: stops when no component moves by more than this in four iterations [m/s].
    """

    before: Tensor  # velocity before the last step

    def __init__(
        self,
        hit_frame: int,
        max_iterations: int = 100,
        guess: tuple[float, float, float] = (0.0, 0.0, 0.0),
        views_per_frame: int | None = None,
        silhouette_weight: float = 0.0,
        tolerance: float = 1e-3,
    ):
        super().__init__(steps=math.ceil(max_iterations / ITERATIONS_PER_STEP), silhouette_weight=silhouette_weight)
        if hit_frame < 2:
            raise UserInputError(f"hit_frame = {hit_frame}: the velocity needs at least two frames before contact")
        self.frames, self.views_per_frame, self.tolerance = hit_frame, views_per_frame, tolerance
        self.velocity = nn.Parameter(torch.tensor(guess, dtype=torch.float32))
        self.register_buffer("before", self.velocity.detach().clone())
        self._highest: float | None = None  # loss of a stable motion
        self.last_step = 0.0

    def check_settings(self) -> None:
        """The video must contain the frames before contact."""
        video = self.data.video
        if self.frames > len(video.times):
            raise UserInputError(
                f"hit_frame = {self.frames} but {video.source} has {len(video.times)} frames; lower hit_frame"
            )

    def work(self, particles: int) -> Work:
        """See :meth:`AbstractPhase.work`: a line search tries a quarter more than there are iterations."""
        views = min(self.views_per_frame or len(self.data.train), len(self.data.train))
        return compared(self.frames, views, gradients=True) * (1.25 * ITERATIONS_PER_STEP * self.steps)

    def begin(self) -> None:
        """Fix the physical parameters to what is known; before contact they hardly count."""
        self._values = self.physics.values(self.state)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """L-BFGS; a Lightning step runs a few of its iterations, so that evaluations are not repeated."""
        return torch.optim.LBFGS(
            [self.velocity], lr=FIRST_STEP, max_iter=ITERATIONS_PER_STEP, history_size=20, line_search_fn="strong_wolfe"
        )

    def training_step(self, step: int, _: int) -> Tensor:
        """Cost of all training views over the frames before contact.

        A line search may try a velocity so high that the motion is unstable. A high loss is returned there, and goes
        less far. Raises SimulationError where the motion that the search starts from is unstable.
        """
        halvings = self.physics.halvings
        try:
            if not self.velocity.isfinite().all():
                raise SimulationError(0, 0, "the velocity that is tried is no number")
            trajectory = self.rollout(self.velocity, self._values, self.frames)
        except SimulationError:
            if self._highest is None:
                raise
            self.physics.halvings = halvings
            return 0.0 * self.velocity.nan_to_num(0.0, 0.0, 0.0).sum() + UNSTABLE * self._highest
        views = self.fixed_views(self.frames, self.views_per_frame)
        seen, observer = self.watch(trajectory, self.velocity, self._values)
        loss = self.image_cost.loss(seen, self.state.density, self.state.features, views, observer=observer)
        self.log("velocity/loss", loss)
        self._highest = max(self._highest or 0.0, LOSS_SCALE * loss.item())
        return LOSS_SCALE * loss

    def on_train_start(self) -> None:
        """A checkpoint is written between a step and the decision it leads to, so a resumed run decides first."""
        if self.global_step > 0:
            self._stop_if_at_rest()

    def on_train_batch_end(self, *_) -> None:
        """Log the velocity and stop when it no longer moves. Where gradients that hardly differ have led a line search
        to no number, the next step begins without their history where this one began.
        """
        if not self.velocity.isfinite().all():
            with torch.no_grad():
                self.velocity.copy_(self.before)
            self.trainer.optimizers[0].state.clear()
            self.last_step = FIRST_STEP
            return
        for axis, value in zip("xyz", self.velocity.detach(), strict=True):
            self.log(f"velocity/v_{axis} [m|s]", value)
        self._stop_if_at_rest()

    def _stop_if_at_rest(self) -> None:
        last = self.trainer.optimizers[0].state[self.velocity]
        self.last_step = float((last["t"] * last["d"]).abs().max()) if "d" in last else 0.0
        moved = (self.velocity.detach() - self.before).abs().max().item()
        self.before.copy_(self.velocity.detach())
        if moved < self.tolerance:
            self.trainer.should_stop = True

    def export_state(self) -> ParticleState:
        velocity = self.velocity.detach().cpu().expand_as(self.state.positions).clone()
        known = self.physics.known({**self.physics.guess, **self.state.physics})
        return self.state.with_(velocity=velocity, physics=known)

    def course(self) -> dict[str, Any]:
        """Frames used, and the length of the last L-BFGS step [m/s]."""
        return {"frames": self.frames, "last_step": self.last_step}

    def progress_metrics(self) -> dict[str, str]:
        return {"v0": "({:+.3f}, {:+.3f}, {:+.3f}) m/s".format(*self.velocity.detach().tolist())}
