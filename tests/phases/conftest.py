"""A small scene whose answer is known: an elastic block that falls, filmed by three cameras."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch.nn.functional import avg_pool2d

from pacnerf_lpo.data.cameras import pixel_rays
from pacnerf_lpo.identification.body import Body
from pacnerf_lpo.identification.discs import Discs
from pacnerf_lpo.identification.forward_model import MARGIN, BodyModel
from pacnerf_lpo.mpm.materials import NeoHookean
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.particles.transfer import particles_to_grid
from pacnerf_lpo.render.ray_march import render_rays
from pacnerf_lpo.scene.activation import surface_density
from pacnerf_lpo.scene.colour import ColourNetwork
from pacnerf_lpo.types import ParticleState, Video

SIZE, FRAMES, DX = 24, 7, 0.08
TRUTH = {"E": 3e4, "nu": 0.3, "ground_height": 0.0}
VELOCITY = (0.0, -1.0, 0.0)
SHARPER = 4
"""Pixels of true outlines for each of the film's."""


def block() -> ParticleState:
    """A block of 0.4 x 0.32 x 0.4 m, 0.12 m above the ground, its colours varying over it.

    Density falls off towards the surface, as in a trained field: a grid node that a particle newly reaches would
    otherwise jump from empty to dense, and the image with it.
    """
    half, counts = DX / 2, torch.tensor([10, 8, 10])
    lattice = torch.cartesian_prod(*(torch.arange(int(n)) + 0.5 for n in counts))
    depth = torch.minimum(lattice, counts - lattice).amin(1)  # 0.5 in the outermost layer
    positions = lattice * half + torch.tensor([-0.2, 0.12, -0.2])
    torch.manual_seed(0)
    return ParticleState(
        positions=positions,
        velocity=torch.tensor(VELOCITY).expand_as(positions).clone(),
        density=(60 * (depth - 1.5)).clamp(-60, 60),
        features=torch.sin(positions @ torch.randn(3, 12) * 8),
        physics=dict(TRUTH),
        spacing=DX,
        base_spacing=DX,
        colour_network={name: value.clone() for name, value in ColourNetwork().state_dict().items()},
    )


def cameras() -> tuple[torch.Tensor, torch.Tensor]:
    """Three cameras at 1.6 m around the block: poses [(3, 3, 4)] and intrinsics [pixels, (3, 3, 3)]."""
    poses = []
    for angle in torch.tensor([0.0, 2.1, 4.2]):
        back = torch.tensor([torch.sin(angle), 0.35, torch.cos(angle)])
        back = back / back.norm()
        right = torch.linalg.cross(torch.tensor([0.0, 1.0, 0.0]), back)
        right = right / right.norm()
        axes = torch.stack((right, torch.linalg.cross(back, right), back), dim=1)
        poses.append(torch.cat((axes, (torch.tensor([0.0, 0.2, 0.0]) + 1.6 * back)[:, None]), dim=1))
    intrinsic = torch.tensor([[40.0, 0.0, SIZE / 2], [0.0, 40.0, SIZE / 2], [0.0, 0.0, 1.0]])
    return torch.stack(poses), intrinsic.expand(3, 3, 3)


def film(state: ParticleState, trajectory: torch.Tensor, true_poses: torch.Tensor | None = None) -> SimpleNamespace:
    """What a VideoData offers the phases, of particles moving along ``trajectory`` [m, (F, N, 3)].

    ``true_poses`` [(3, 3, 4)]: where the cameras really stood while they filmed; the video says something else.
    """
    poses, intrinsics = cameras()
    believed, rays = (
        [pixel_rays(intrinsic, pose, SIZE, SIZE) for intrinsic, pose in zip(intrinsics, where, strict=True)]
        for where in (poses, poses if true_poses is None else true_poses)
    )
    colour = ColourNetwork()
    colour.load_state_dict(state.colour_network)
    images, mattes = torch.empty(3, len(trajectory), SIZE, SIZE, 3), torch.empty(3, len(trajectory), SIZE, SIZE)
    with torch.no_grad():
        for frame, positions in enumerate(trajectory):
            grid = particles_to_grid(positions, state.density, state.features, state.spacing)
            for view in range(3):
                seen = render_rays(grid, colour, rays[view], state.base_spacing)
                images[view, frame] = seen.colour.reshape(SIZE, SIZE, 3)
                mattes[view, frame] = 1 - seen.transmittance.reshape(SIZE, SIZE)
    video = Video(
        images=images,
        silhouettes=mattes,
        valid=torch.ones(3, SIZE, SIZE, dtype=torch.bool),
        camera_to_world=poses,
        intrinsics=intrinsics,
        times=torch.arange(len(trajectory)) / 24,
        view_ids=(0, 1, 2),
        frame_ids=tuple(range(len(trajectory))),
        source="block",
    )
    rays_of = believed.__getitem__
    rays = {"rays": rays_of, "first_rays": rays_of}
    return SimpleNamespace(video=video, train=[0, 1, 2], test=[], **rays, tracked_points=None, point_clouds=None)


def physics(**guess: float) -> Physics:
    """An elastic block with another time step than the one it was filmed with."""
    return Physics(NeoHookean(**{"E": TRUTH["E"], "nu": TRUTH["nu"], **guess}), substep_rate=960.0)


def solid_block(state: ParticleState) -> ParticleState:
    """The block as a reconstruction of one that is solid up to its faces: its density rises evenly inwards from there,
    and particles outside have no matter.
    """
    half, corner = state.spacing / 2, torch.tensor([0.2, 0.16, 0.2])
    middle = (state.positions.amin(0) + state.positions.amax(0)) / 2
    positions = torch.cartesian_prod(*[torch.arange(-n / 2 - 1.5, n / 2 + 2) * half for n in (10, 8, 10)]) + middle
    torch.manual_seed(0)
    return state.with_(
        positions=positions,
        velocity=state.velocity[:1].expand_as(positions).clone(),
        density=600 * (corner - (positions - middle).abs()).amin(1),
        features=torch.sin(positions @ torch.randn(3, 12) * 8),
        surface_offset=-surface_density(*state.spacings),
    )


def outlined(data: SimpleNamespace, path: torch.Tensor, spacing: float) -> SimpleNamespace:
    """The film with the outlines of a block of full particles [m, (F, N, 3)]; spacing of their nodes in metres."""
    first, sharp = path[0], torch.tensor([SHARPER, SHARPER, 1.0])[:, None]
    faces = torch.stack((first.amin(0) - spacing / 4, first.amax(0) + spacing / 4))
    discs = Discs.within(lambda points: torch.minimum(points - faces[0], faces[1] - points).amin(1), first, spacing / 2)
    body = Body(first, torch.ones(len(first)), spacing, discs)
    blank = torch.zeros(1).expand(3, len(path), SHARPER * SIZE, SHARPER * SIZE)
    video = replace(data.video, images=blank[..., None], silhouettes=blank, intrinsics=data.video.intrinsics * sharp)
    model = BodyModel(body, Physics(NeoHookean()), video, {"v_x": 0.0, "v_y": 0.0, "v_z": 0.0})
    seen = model.outlines(path)[..., MARGIN:-MARGIN, MARGIN:-MARGIN]
    data.video = replace(data.video, silhouettes=avg_pool2d(seen, SHARPER))
    return data


@pytest.fixture(scope="session")
def state() -> ParticleState:
    """The block at frame 0."""
    return block()


@pytest.fixture(scope="session")
def data(state):
    """Its film, simulated with half the time step that the tests identify with."""
    fine = Physics(NeoHookean(E=TRUTH["E"], nu=TRUTH["nu"]), substep_rate=1920.0)
    return film(state, fine.simulate(state, FRAMES))
