"""A rollout frame by frame, forward and backward: checkpoints, recomputation, failures, grids that follow the body.

Memory: one state per frame, and all substeps of as many of the last frames as fit the budget (at least one). The
backward pass recomputes the substeps of every other frame from its checkpoint.
"""

from dataclasses import astuple, dataclass, field

import torch
from torch import Tensor

from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.mpm import kernels, schedule_cuda
from pacnerf_lpo.mpm.arrays import ALIVE, CAUSES, MASS, NOT_YET, START, Bench, Numbers, V, packed, unpacked
from pacnerf_lpo.mpm.lanes import LANES
from pacnerf_lpo.mpm.point import LocalLaws
from pacnerf_lpo.mpm.runtime import LAUNCHING, heed
from pacnerf_lpo.mpm.schedule_cpu import DONE, FIRST_SLICE, LINE, STOPPED
from pacnerf_lpo.mpm.taichi_calls import Launcher
from pacnerf_lpo.mpm.tape import Grid, Tape, enclosing_grid

MOST_NODES = 1 << 25
"""A grid of 2^25 nodes is half a gigabyte; particles spread wider than that have left the scene."""
LEAST_PARTICLES = 2500
"""Fewer are not worth a thread of their own."""
MASS_FLOOR = 1e-10
"""A node lighter than this fraction of the mean particle mass stays at rest."""


@dataclass(eq=False)
class Engine:
    """Runs and differentiates rollouts of one discretisation.

    laws: what the kernels are compiled from.
    dx: node spacing [m].  substeps: per frame.  frame_dt: [s].  gravity: [m/s^2].
    dtype: ``"f32"`` or ``"f64"``.  threads: on the CPU.  cuda: run on CUDA.
    memory: for the substeps of whole frames kept from forward to backward [bytes].
    spare: tapes that no rollout uses now.
    """

    laws: LocalLaws
    dx: float
    substeps: int
    frame_dt: float
    gravity: tuple[float, ...]
    dtype: str
    threads: int
    cuda: bool
    memory: float
    spare: list[Tape] = field(default_factory=list)

    def kernels(self, slices: int) -> tuple[Launcher, Launcher]:
        """Forward and adjoint kernel for particles in so many slices."""
        with LAUNCHING:
            return kernels.build(self.laws, self.dtype, self.cuda, slices > 1)

    def tape(self, run: "Run") -> Tape:
        """A tape for one kept frame, reused when there is one of the right size."""
        matching = [tape for tape in self.spare if tape.states[0].shape == run.state.shape]
        self.spare = matching[1:]
        return matching[0] if matching else Tape(self.substeps, run.state, keep=True)

    def kept_frames(self, run: "Run") -> int:
        """How many frames' substeps fit the memory budget; at least one."""
        return max(1, int(self.memory // Tape.bytes(self.substeps, run.grid(run.state, 1), run.state)))


class Run:
    """One rollout in progress: inputs, which are those of :class:`Rollout`, and grid buffers. Particles lie in blocks,
    see :mod:`~pacnerf_lpo.mpm.arrays`.
    """

    def __init__(self, engine: Engine, state: Tensor, constants: Tensor, coefficients: Tensor):
        self._engine, self.particles, self._coefficients = engine, len(state), len(coefficients)
        dx, dt, (x, y, z) = engine.dx, engine.frame_dt / engine.substeps, engine.gravity
        lightest = MASS_FLOOR * float(constants[:, MASS].mean())
        head = Numbers(dx, 1 / dx, dt, (dx / 2) ** 3, x, y, z, lightest, 0.0)
        self._numbers = torch.cat([state.new_tensor(astuple(head)), coefficients.to(state)])
        alive = torch.cat([constants, torch.ones_like(constants[:, :1])], 1)
        filling = torch.cat([constants[-1], constants.new_zeros(1)])
        self.state, self._constants = packed(state, state[-1]), packed(alive, filling)
        self._slices = 1 if engine.cuda else max(1, min(engine.threads, self.particles // LEAST_PARTICLES))
        self._forward, self._adjoint = engine.kernels(self._slices)
        self._spans = torch.zeros(6 * self._slices, dtype=torch.int32, device=state.device)
        self._bench = state.new_zeros(self._slices * Bench.ROWS, LANES)
        self._momentum = state.new_zeros(0, 4)
        self._of_state, self._of_constants = self.state[:0], self._constants[:0]  # a forward launch leaves them alone
        self._of_coefficients = state.new_zeros(0, dtype=torch.float64)

    def grid(self, state: Tensor, margin: int) -> Grid:
        """The grid for the frame that starts at ``state``."""
        x, v = state[:, : V + 3].transpose(0, 1).reshape(2, 3, -1)
        return enclosing_grid(x, v, self._engine.dx, self._engine.frame_dt, self._engine.gravity, margin)

    def frame(self, index: int, tape: Tape) -> None:
        """Fill the tape of frame interval ``index`` from its first state; widen the grid until it holds the motion.

        Raises:
            SimulationError: NaN, CFL violation, or particles spread beyond any reasonable grid.
        """
        start, margin = tape.states[0].clone(), 1
        while True:
            grid = self.grid(start, margin)
            if grid.nodes > MOST_NODES:
                spread = " x ".join(map(str, grid.size))
                raise SimulationError(index, 0, f"{CAUSES[2]}: particles spread over {spread} cells")
            tape.fit(grid)
            with LAUNCHING:
                failures = self.launch(index, tape)
            if min(failures) == NOT_YET:
                return
            self._momentum.zero_()
            if failures[2] > min(failures):
                raise SimulationError(index, min(failures), CAUSES[failures.index(min(failures))])
            margin *= 4
            tape.states[0].copy_(start)

    def start_adjoint(self) -> None:
        """Set the adjoints of state, constants and coefficients to zero."""
        self._of_state = torch.zeros_like(self.state)
        self._of_constants = torch.zeros_like(self._constants)
        self._of_coefficients = self.state.new_zeros(self._slices, self._coefficients, dtype=torch.float64)

    def add_to_adjoint(self, of_positions: Tensor) -> None:
        """Add the adjoint of the positions at a frame [(N, 3)]."""
        self._of_state[:, :3] += packed(of_positions, torch.zeros_like(of_positions[0]))

    def adjoints(self) -> tuple[Tensor, Tensor, Tensor]:
        """Of the state [(N, width)], the constants [(N, 5)] and the coefficients [(P,)]."""
        of_constants = unpacked(self._of_constants, self.particles)[:, :ALIVE]
        return unpacked(self._of_state, self.particles), of_constants, self._of_coefficients.sum(0).to(self.state)

    def launch(self, index: int, tape: Tape, back: bool = False) -> list[int]:
        """Passes of frame interval ``index``; ``back``: those that pull the adjoint of the state back over it. Returns
        the first substep that each failure befell.
        """
        kernel, order = (self._adjoint, -1) if back else (self._forward, 1)
        wanted = tape.grid.nodes * self._slices
        if len(self._momentum) < wanted:
            self._momentum = self.state.new_zeros(wanted * 5 // 4, 4)
        node = self.state.new_empty(tape.grid.nodes, 4) if back else self._momentum
        self._numbers[START] = index * self._engine.frame_dt
        blocks, device = len(self.state), self.state.device
        dims = torch.tensor([blocks, *tape.grid.size, *tape.grid.origin], dtype=torch.int32, device=device)
        status = torch.full((len(CAUSES),), NOT_YET, dtype=torch.int32, device=device)
        progress = torch.zeros(LINE * (FIRST_SLICE + self._slices), dtype=torch.int32, device=device)
        kernel.bind(
            momentum=self._momentum,
            constants=self._constants.view(-1, LANES),
            numbers=self._numbers,
            dims=dims,
            spans=self._spans,
            status=status,
            bench=self._bench,
            progress=progress,
            slices=self._slices,
            chunk=-(-blocks // self._slices),
            substeps=self._engine.substeps,
            first=0,
            last=0,
            **tape.arguments,
            gradient=self._of_state.view(-1, LANES),
            node=node,
            of_constants=self._of_constants.view(-1, LANES),
            of_coefficients=self._of_coefficients.view(-1),
        )
        passes = self._engine.substeps + 1
        each = schedule_cuda.PASSES if self._engine.cuda else passes
        for first in range(0, passes, each)[::order]:
            last = min(first + each, passes)
            kernel(first=first, last=last)
            while self._slices > 1 and int(progress[DONE]) < 2 * self._slices * (last - first):
                progress[STOPPED] = 0
                kernel()
        return status.tolist()


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
        run = Run(engine, state, constants, coefficients)
        intervals = frames - 1
        kept_from = intervals - engine.kept_frames(run) if recording else intervals
        latest, scratch = run.state, Tape(engine.substeps, run.state, keep=False)
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
            out[index + 1] = unpacked(latest[:, :3], run.particles)
        if recording:
            ctx.run, ctx.engine, ctx.checkpoints = run, engine, checkpoints
            ctx.tapes = {index: tape for index, tape in tapes.items() if tape.keep}
        return out

    @staticmethod
    def backward(ctx, of_out):  # type: ignore[override]
        run, engine = ctx.run, ctx.engine
        run.start_adjoint()
        for index in reversed(range(len(ctx.checkpoints))):
            run.add_to_adjoint(of_out[index + 1])
            tape = ctx.tapes.pop(index, None)
            if tape is None:
                tape = engine.tape(run)
                tape.states[0].copy_(ctx.checkpoints[index])
                run.frame(index, tape)
            with LAUNCHING:
                run.launch(index, tape, back=True)
            engine.spare.append(tape)
        run.add_to_adjoint(of_out[0])
        return None, None, None, *run.adjoints()
