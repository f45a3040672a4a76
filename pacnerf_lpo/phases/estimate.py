"""What a run will take, said before it starts: particles, memory and minutes, by the measured speed of this machine."""

import resource
import time
from collections.abc import Callable, Sequence

import torch
from torch.nn.functional import mse_loss

from pacnerf_lpo.data.cameras import hits_box
from pacnerf_lpo.data.hull import hull_volume
from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.errors import SimulationError, UserInputError
from pacnerf_lpo.identification.problem import PARTICLES
from pacnerf_lpo.mpm import runtime
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases.base import AbstractPhase
from pacnerf_lpo.phases.static_grid import StaticGridModule
from pacnerf_lpo.phases.work import Work
from pacnerf_lpo.render.ray_march import render_rays
from pacnerf_lpo.scene.activation import EMPTY_DENSITY
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.scene.voxel_field import VoxelField
from pacnerf_lpo.types import FEATURES, Rays

SAMPLE = 4000
"""Particles of the timed simulation at most, and rays of the timed image; larger bodies cost in proportion."""
PER_CELL = 8
SOLID_DENSITY = 10.0
"""Raw density that a ray does not get through."""
PARTICLE_NUMBERS = 60
"""Numbers kept per particle and frame of a rollout with gradients: state, adjoint, and what is stored of a step."""
BYTES = 4
INTERVAL_ROLLOUTS, LEAST_PARTICLES = 300, 300
"""What intervals take, as counted on three videos: null replicates on finer grids, errors of shape and force, of which
those of a coarse body count a quarter, and fits; how small a body may be."""


def estimate(
    todo: Sequence[AbstractPhase],
    static: AbstractPhase | None,
    data: VideoData,
    physics: Physics,
    intervals: int = 0,
) -> list[str]:
    """One line: how many particles, how much memory, and about how many minutes on this machine as busy as it is.

    The body is taken to be the visual hull of the mattes, and a short simulation and an image of it are timed, which
    takes some seconds. Nothing where the static phase is of another kind.

    Args:
        todo: templates of the phases that are still to run, each as often as it will.
        static: template of the static phase, which says how large a voxel is.
        intervals: particles of the body that they are found with; 0: there are none.
    """
    if not isinstance(static, StaticGridModule):
        return []
    spacing = static.base_spacing / 2**static.length.halvings  # of the field in the end
    volume, word = _volume(data)
    particles = max(1, round(PER_CELL * volume / spacing**3))
    rounded = f"{float(f'{particles:.2g}'):,.0f}"
    line = f"{word} {rounded} particles, about {memory(data, spacing, particles) / 2**30:.1f} GiB of memory"
    work = Work()
    for phase in todo:
        phase.attach(data, physics)
        work += phase.work(particles)
    if intervals:
        smaller = (intervals / particles) ** (4 / 3)  # half the spacing is half the time step
        work += Work(frames=INTERVAL_ROLLOUTS * smaller * len(data.video.times))
    try:
        seconds = 0.0
        if work.frames:
            count = min(particles, SAMPLE)
            seconds += work.frames * _timed(_simulation(physics, spacing, count)) * particles / count
        seen = [float(hits_box(data.rays(view), data.box).sum()) for view in data.train]
        if rays := work.rays + work.images * sum(seen) / len(seen):
            seconds += rays * _timed(_image(data, static, spacing, volume)) / SAMPLE
    except SimulationError:
        return [f"{line}; how long it takes is not known: the guess of the material is unstable at this time step"]
    return [f"{line}, about {_duration(seconds)} on this machine as busy as it is now"]


def interval_particles(option: bool | int) -> int:
    """Particles for intervals, by the option of ``fit``; 0: there are none. Raises UserInputError for too few."""
    found = PARTICLES if option is True else int(option)
    if found and found < LEAST_PARTICLES:
        raise UserInputError(f"--intervals {option}: give true, false, or at least {LEAST_PARTICLES} particles")
    return found


def _volume(data: VideoData) -> tuple[float, str]:
    """Of the body [m^3], and a word for how exact that is: that of the box where mattes have nothing in common."""
    try:
        return hull_volume(data.video, data.box, data.train), "about"
    except UserInputError:
        edges = torch.tensor(data.box.upper) - torch.tensor(data.box.lower)
        return float(edges.prod()), "at most"


def memory(data: VideoData, spacing: float, particles: int) -> float:
    """Of the process at its largest [bytes]: what it has now, rays, the finest grid with Adam's moments, a rollout."""
    video = data.video
    now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    rays = video.valid.numel() * 6
    nodes = torch.tensor(data.box.upper).sub(torch.tensor(data.box.lower)).div(spacing).add(1).prod().item()
    grids = 4 * nodes * (1 + FEATURES)
    rollout = particles * len(video.times) * PARTICLE_NUMBERS
    return now + BYTES * (rays + grids + rollout)


def _simulation(physics: Physics, spacing: float, count: int) -> Callable[[], object]:
    """One frame of a block of so many particles at rest above the ground."""
    edge = torch.arange(round(count ** (1 / 3)) + 1) * (spacing / 2)
    positions = torch.cartesian_prod(edge, edge + 4 * spacing, edge)[:count]
    values = {name: torch.tensor(value) for name, value in physics.guess.items()}
    full = torch.ones(len(positions))
    return lambda: physics.motion(positions, torch.zeros_like(positions), full, full, values, spacing, 2)


def _image(data: VideoData, static: StaticGridModule, spacing: float, volume: float) -> Callable[[], object]:
    """Rays through a field of voxels of a size [m], with gradients: nothing but a ball of that volume [m^3]."""
    view = data.train[0]
    rays = data.rays(view)
    hit = hits_box(rays, data.box).nonzero().squeeze(1)
    pixels = hit[torch.linspace(0, len(hit) - 1, SAMPLE).long()]
    field, colour = VoxelField.create(data.box, spacing), ColourNetwork()
    with torch.no_grad():
        nodes = torch.cartesian_prod(*(torch.arange(count) * field.dx for count in field.density.shape))
        middle = (torch.tensor(data.box.upper) - torch.tensor(data.box.lower)) / 2
        outside = (nodes - middle).norm(dim=1) > (3 * volume / (4 * torch.pi)) ** (1 / 3)
        field.density.copy_(torch.where(outside, EMPTY_DENSITY, SOLID_DENSITY).reshape(field.density.shape))
    where = runtime.device()
    field.to(where)
    colour.to(where)
    through = Rays(rays.origins[pixels], rays.directions[pixels]).to(where)

    def draw() -> None:
        seen = render_rays(field.grid(), colour, through, static.base_spacing, min_weight=static.min_weight)
        mse_loss(seen.colour, torch.zeros_like(seen.colour)).backward()

    return draw


def _timed(once: Callable[[], object]) -> float:
    """Seconds of a second call: the first one compiles."""
    once()
    began = time.perf_counter()
    once()
    return time.perf_counter() - began


def _duration(seconds: float) -> str:
    if seconds < 90:
        return "a minute"
    return f"{seconds / 60:.0f} minutes" if seconds < 5400 else f"{seconds / 3600:.1f} hours"
