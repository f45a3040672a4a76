"""A rollout frame by frame, forward and backward: checkpoints, recomputation, grids that follow the particles,
failures.

Memory: one state per frame, and all substeps of as many of the last frames as fit the budget (at least one). The
    backward pass recomputes the substeps of every other frame from its checkpoint.
"""

from dataclasses import astuple

import torch
from torch import Tensor

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.mpm import kernels
from pacnerf_lpo.mpm.arrays import CAUSES, NOT_YET, START, Numbers
from pacnerf_lpo.mpm.point import LocalLaws
from pacnerf_lpo.mpm.runtime import LAUNCHING, heed
from pacnerf_lpo.mpm.taichi_calls import Launcher
from pacnerf_lpo.mpm.tape import Grid, Tape, enclosing_grid

MOST_NODES = 1 << 25
"""A grid of 2^25 nodes is half a gigabyte; particles spread wider than that have left the scene."""
LEAST_PARTICLES = 2500
"""Fewer are not worth a thread of their own."""
MASS_FLOOR = 1e-10
"""A node lighter than this fraction of the mean particle mass stays at rest."""


class Engine:
    """Runs and differentiates rollouts of one discretisation.

    Args:
        laws: what the kernels are compiled from.
        dx: node spacing [m].
        substeps: per frame.
        frame_dt: [s].
        gravity: [m/s^2].
        dtype: ``"f32"`` or ``"f64"``.
        threads: on the CPU.
        cuda: run on CUDA.
        memory: for the substeps of whole frames kept from forward to backward [bytes].
    """

    def __init__(
        self,
        laws: LocalLaws,
        dx: float,
        substeps: int,
        frame_dt: float,
        gravity: tuple[float, ...],
        dtype: str,
        threads: int,
        cuda: bool,
        memory: float,
    ):
        self._laws, self._dtype = laws, dtype
        self.dx, self.substeps, self.frame_dt, self.gravity = dx, substeps, frame_dt, gravity
        self.cuda, self._threads, self._memory = cuda, threads, memory
        self._spare: list[Tape] = []

    def prepare(self, state: Tensor, constants: Tensor, coefficients: Tensor) -> "Run":
        """Pack the inputs of one rollout; see :class:`Rollout`."""
        dt = self.frame_dt / self.substeps
        lightest = MASS_FLOOR * float(constants[:, 0].mean())
        x, y, z = self.gravity
        head = Numbers(self.dx, 1 / self.dx, dt, (self.dx / 2) ** 3, x, y, z, lightest, 0.0)
        numbers = torch.cat([state.new_tensor(astuple(head)), coefficients.to(state)])
        return Run(self, state.contiguous(), constants.contiguous(), numbers, len(coefficients))

    def slices(self, particles: int) -> int:
        """How many slices so many particles are worth; on CUDA a slice is one particle."""
        return particles if self.cuda else max(1, min(self._threads, particles // LEAST_PARTICLES))

    def kernels(self, particles: int) -> tuple[Launcher, Launcher]:
        """Forward and adjoint kernel for so many particles."""
        with LAUNCHING:
            return kernels.build(self._laws, self._dtype, self.cuda, not self.cuda and self.slices(particles) > 1)

    def tape(self, run: "Run") -> Tape:
        """A tape for one kept frame, reused when there is one of the right size."""
        matching = [tape for tape in self._spare if tape.states[0].numel() == run.state.numel()]
        self._spare = matching[1:]
        return matching[0] if matching else Tape(self.substeps, run.state, keep=True)

    def give_back(self, tape: Tape) -> None:
        """Let the next rollout reuse a tape."""
        self._spare.append(tape)

    def kept_frames(self, run: "Run") -> int:
        """How many frames' substeps fit the memory budget; at least one."""
        return max(1, int(self._memory // Tape.bytes(self.substeps, run.grid(run.state, 1), run.state)))


class Run:
    """One rollout in progress: its inputs and its grid buffers."""

    def __init__(self, engine: Engine, state: Tensor, constants: Tensor, numbers: Tensor, coefficients: int):
        self._engine, self.state, self._constants, self._numbers = engine, state, constants, numbers
        self.particles, self._coefficients = len(state), coefficients
        self._forward, self._adjoint = engine.kernels(self.particles)
        self._slices = engine.slices(self.particles)
        self._chunk = -(-self.particles // self._slices)
        self._rows = 1 if engine.cuda else self._slices
        self._spans = torch.zeros(6 * self._rows, dtype=torch.int32, device=state.device)
        self._momentum = state.new_zeros(0, 4)

    def grid(self, state: Tensor, margin: int) -> Grid:
        """The grid for the frame that starts at ``state``."""
        gravity = state.new_tensor(self._engine.gravity)
        return enclosing_grid(state.view(self.state.shape), self._engine.dx, self._engine.frame_dt, gravity, margin)

    def frame(self, index: int, tape: Tape) -> None:
        """Fill the tape of frame interval ``index`` from its first state; widen the grid until it holds the motion.

        Raises:
            SimulationError: NaN, CFL violation, or particles spread beyond any reasonable grid.
        """
        start, margin = tape.states[0].clone(), 1
        while True:
            grid = self.grid(start, margin)
            if grid.nodes > MOST_NODES:
                raise SimulationError(
                    index, 0, f"{CAUSES[2]}: particles spread over {' x '.join(map(str, grid.size))} cells"
                )
            with LAUNCHING:
                failures = self._advance(index, tape, grid)
            if min(failures) == NOT_YET:
                return
            self._momentum.zero_()
            if failures[2] > min(failures):
                raise SimulationError(index, min(failures), CAUSES[failures.index(min(failures))])
            margin *= 4
            tape.states[0].copy_(start)

    def _advance(self, index: int, tape: Tape, grid: Grid) -> list[int]:
        tape.fit(grid)
        common, status = self._common(index, grid)
        S, x, u, contacts = self._engine.substeps, tape.state_arrays, tape.velocities, tape.contacts
        step = self._forward
        step.bind(
            before=x[0],
            now=x[0],
            ahead=x[1],
            velocity_in=u[0],
            velocity_out=u[0],
            contact=contacts[0],
            substep=0,
            finish=0,
            begin=1,
            keep_all=int(tape.keep),
            **common,
        )
        step()
        for s in range(1, S):
            step(
                before=x[s - 1],
                now=x[s],
                ahead=x[s + 1],
                velocity_in=u[s - 1],
                velocity_out=u[s],
                contact=contacts[s],
                substep=s,
                finish=1,
            )
        step(before=x[S - 1], now=x[S], velocity_in=u[S - 1], substep=S, finish=1, begin=0, keep_all=1)
        return status.tolist()

    def start_adjoint(self) -> None:
        """Set the adjoints of state, constants and coefficients to zero."""
        self.of_state = torch.zeros_like(self.state)
        self.of_constants = torch.zeros_like(self._constants)
        self.of_coefficients = torch.zeros(
            self._rows, self._coefficients, dtype=torch.float64, device=self.state.device
        )

    def frame_adjoint(self, index: int, tape: Tape) -> None:
        """Pull the adjoint of the state back over frame interval ``index``."""
        common, _ = self._common(index, tape.grid)
        S, x, u, contacts = self._engine.substeps, tape.state_arrays, tape.velocities, tape.contacts
        node = self.state.new_empty(tape.grid.nodes, 4)
        step = self._adjoint
        step.bind(
            now=x[S],
            before=x[S - 1],
            gradient=self.of_state.view(-1),
            node=node,
            velocity=u[S - 1],
            contact=contacts[S - 1],
            of_constants=self.of_constants.view(-1),
            of_coefficients=self.of_coefficients.view(-1),
            substep=S,
            begun=0,
            finished=1,
            **common,
        )
        step()
        for s in range(S - 1, 0, -1):
            step(now=x[s], before=x[s - 1], velocity=u[s - 1], contact=contacts[s - 1], substep=s, begun=1)
        step(now=x[0], substep=0, begun=1, finished=0)

    def _common(self, index: int, grid: Grid) -> tuple[dict, Tensor]:
        wanted = grid.nodes * self._rows
        if len(self._momentum) < wanted:
            self._momentum = self.state.new_zeros(wanted * 5 // 4, 4)
        self._numbers[START] = index * self._engine.frame_dt
        self._dims = torch.tensor(
            [self.particles, *grid.size, *grid.origin], dtype=torch.int32, device=self.state.device
        )
        self._status = torch.full((len(CAUSES),), NOT_YET, dtype=torch.int32, device=self.state.device)
        return {
            "momentum": self._momentum,
            "constants": self._constants.view(-1),
            "numbers": self._numbers,
            "dims": self._dims,
            "spans": self._spans,
            "status": self._status,
            "slices": self._slices,
            "chunk": self._chunk,
        }, self._status


class Rollout(torch.autograd.Function):
    """Positions at every frame, from packed inputs; see :class:`~pacnerf_lpo.mpm.simulator.Simulator`."""

    @staticmethod
    def forward(ctx, engine: Engine, frames: int, recording: bool, state, constants, coefficients):
        """Roll out.

        Args:
            state: particle states at frame 0 [(N, 24 and the history)], see :mod:`~pacnerf_lpo.mpm.arrays`.
            constants: mass, stiffness factor and position at time 0 [(N, 5)].
            coefficients: of the local laws [(P,)].
        """
        run = engine.prepare(state, constants, coefficients)
        intervals = frames - 1
        kept_from = intervals - engine.kept_frames(run) if recording else intervals
        latest, scratch = run.state.reshape(-1), Tape(engine.substeps, run.state, keep=False)
        checkpoints, tapes = [], {}
        out = state.new_empty(frames, len(state), 3)
        out[0] = state[:, :3]
        for index in range(intervals):
            heed()
            tape = tapes[index] = engine.tape(run) if index >= kept_from else scratch
            tape.states[0].copy_(latest)
            checkpoints.append(latest.clone() if recording else None)
            run.frame(index, tape)
            latest = tape.states[-1]
            out[index + 1] = latest.view(state.shape)[:, :3]
        if recording:
            ctx.run, ctx.engine, ctx.checkpoints = run, engine, checkpoints
            ctx.tapes = {index: tape for index, tape in tapes.items() if tape.keep}
        return out

    @staticmethod
    def backward(ctx, of_out):  # type: ignore[override]
        run, engine = ctx.run, ctx.engine
        run.start_adjoint()
        for index in reversed(range(len(ctx.checkpoints))):
            run.of_state[:, :3] += of_out[index + 1]
            tape = ctx.tapes.pop(index, None)
            if tape is None:
                tape = engine.tape(run)
                tape.states[0].copy_(ctx.checkpoints[index])
                run.frame(index, tape)
            with LAUNCHING:
                run.frame_adjoint(index, tape)
            engine.give_back(tape)
        run.of_state[:, :3] += of_out[0]
        return None, None, None, run.of_state, run.of_constants, run.of_coefficients.sum(0).to(run.of_state)
