"""The surface of the body at every frame, as triangles with colours.

It encloses as much space at frame 0 as the particles fill; the same level then shows how the body is squeezed.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from torch import Tensor

from pacnerf_lpo.errors import RunError
from pacnerf_lpo.evaluation.prediction import to_bytes
from pacnerf_lpo.export.files import whole_folder
from pacnerf_lpo.export.motion import Subject, linear_light
from pacnerf_lpo.export.points import frames_of
from pacnerf_lpo.scene.activation import solid_fraction
from pacnerf_lpo.scene.trilinear import scatter, stencil

SMOOTHING = 1.0
"""Standard deviation of the filter of the particles' volume, in distances between particles."""
LAYER = 4
"""Empty nodes around the particles: the filter ends four standard deviations from its centre."""
LEAST_LEVEL = 0.3
"""Below, single particles of a faint rim would show as bumps."""
NEIGHBOURS = 8


@dataclass(frozen=True)
class Surface:
    """Triangles, counter-clockwise seen from outside.

    vertices: [m, (V, 3)]
    faces: indices of vertices [(T, 3)]
    normals: unit vectors that point outwards [(V, 3)]
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray


@dataclass(frozen=True)
class FilledSpace:
    """How full space is around particles, on nodes as far apart as the particles: one particle a node inside a body.

    share: filtered volume of the particles [1, (X, Y, Z)]
    lower: position of node (0, 0, 0) [m, (3,)]
    distance: between nodes [m]
    volume: volume of the particles, in cubes of the nodes' distance
    """

    share: np.ndarray
    lower: np.ndarray
    distance: float
    volume: float

    @staticmethod
    def around(positions: Tensor, fraction: Tensor, distance: float) -> "FilledSpace":
        """Positions [m, (N, 3)] of particles that each fill a ``fraction`` [0..1, (N,)] of distance^3."""
        first = (positions.amin(0) / distance).floor() - LAYER
        x, y, z = ((positions.amax(0) / distance).floor() - first + 2 + LAYER).long().tolist()
        lower = first * distance
        nodes = scatter(fraction[:, None], stencil(positions, lower, distance, (x, y, z))).view(x, y, z)
        share = gaussian_filter(nodes.numpy(), SMOOTHING)
        return FilledSpace(share, lower.numpy(), distance, float(fraction.sum()))

    @property
    def enclosing_level(self) -> float:
        """The share whose surface encloses as much space as the particles fill; not less than ``LEAST_LEVEL``.

        At 1/2, the filter would take away the faint rim of a radiance field, edges and thin limbs.
        """
        cubes = min(int(self.volume), self.share.size - 1)
        return max(LEAST_LEVEL, float(np.partition(self.share, -cubes - 1, axis=None)[-cubes - 1]))

    def surface(self, level: float) -> Surface:
        """Where the share is ``level``, by marching cubes; raises ValueError where it is less everywhere."""
        from skimage.measure import marching_cubes

        vertices, faces, normals, _ = marching_cubes(
            self.share, level, spacing=(self.distance,) * 3, gradient_direction="ascent"
        )
        return Surface(vertices + self.lower, faces, normals)


def surface_colours(subject: Subject, positions: Tensor, surface: Surface) -> np.ndarray:
    """Displayed colours of the vertices, each seen along its normal [0..255, (V, 3), uint8].

    The features are the mean of those of the nearest particles.
    """
    _, nearest = cKDTree(positions.numpy()).query(surface.vertices, k=min(NEIGHBOURS, len(positions)))
    features = subject.stage.state.features[torch.from_numpy(nearest.reshape(len(surface.vertices), -1))].mean(1)
    inwards = -torch.from_numpy(surface.normals.astype(np.float32))
    return to_bytes(subject.renderer.colours(features, inwards))


def write_obj(subject: Subject, folder: Path) -> None:
    """Write ``frame_000.obj`` and so on [m]; colours follow each vertex, as displayed."""
    _write(subject, folder, "obj")


def write_glb(subject: Subject, folder: Path) -> None:
    """Write ``frame_000.glb`` and so on (binary glTF 2) [m]; colours of vertices are linear light, as it wants them."""
    _write(subject, folder, "glb")


def _write(subject: Subject, folder: Path, ending: str) -> None:
    import trimesh

    state = subject.stage.state
    fraction = solid_fraction(state.massive(state.density), *state.spacings)
    level = FilledSpace.around(state.positions, fraction, state.spacing / 2).enclosing_level
    with whole_folder(folder) as part:
        for frame in frames_of(len(subject.positions), folder):
            positions = torch.from_numpy(subject.positions[frame].copy())
            try:
                surface = FilledSpace.around(positions, fraction, state.spacing / 2).surface(level)
            except ValueError:
                raise RunError(
                    f"frame {frame} of {subject.stage.stem} has no surface: the particles nowhere fill a third of the "
                    "space; export points instead (--format ply, vtu or usd)"
                ) from None
            colours = surface_colours(subject, positions, surface)
            if ending == "glb":
                colours = (linear_light(colours) * 255 + 0.5).astype(np.uint8)
            mesh = trimesh.Trimesh(
                surface.vertices, surface.faces, vertex_normals=surface.normals, vertex_colors=colours, process=False
            )
            mesh.export(part / f"frame_{frame:03d}.{ending}", include_normals=True)
