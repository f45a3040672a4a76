"""Surfaces enclose the body; OBJ and GLB are read by VTK, which did not write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkFiltersCore import vtkMassProperties
from vtkmodules.vtkIOGeometry import vtkGLTFReader, vtkOBJReader

from pacnerf_lpo.errors import RunError
from pacnerf_lpo.evaluation.run_directory import Run, Stage
from pacnerf_lpo.export.motion import Subject
from pacnerf_lpo.export.surface import LEAST_LEVEL, FilledSpace, write_glb, write_obj

RADIUS, DISTANCE = 0.2, 0.02


def jittered(reach: float) -> torch.Tensor:
    """One particle at random in each cube of a lattice, as they are sampled."""
    axis = torch.arange(-reach, reach, DISTANCE)
    corners = torch.cartesian_prod(axis, axis, axis)
    return corners + DISTANCE * torch.rand(len(corners), 3, generator=torch.Generator().manual_seed(0))


def read(path: Path):
    """Triangles as VTK reads them."""
    reader = vtkGLTFReader() if path.suffix == ".glb" else vtkOBJReader()
    reader.SetFileName(str(path))
    reader.Update()
    if path.suffix == ".obj":
        return reader.GetOutput()
    iterator = reader.GetOutput().NewIterator()
    iterator.InitTraversal()
    return iterator.GetCurrentDataObject()


@pytest.fixture(scope="module")
def folders(subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("export")
    write_obj(subject, folder / "obj")
    write_glb(subject, folder / "glb")
    return {name: folder / name for name in ("obj", "glb")}


def test_surface_of_a_ball():
    positions = jittered(0.3)
    positions = positions[positions.norm(dim=1) < RADIUS]
    space = FilledSpace.around(positions, torch.ones(len(positions)), DISTANCE)
    surface = space.surface(space.enclosing_level)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert mesh.is_watertight
    # counting whole nodes is good to the root of those on the surface, some 1300 of 4200: 1 %; the sign says that
    # triangles are counter-clockwise from outside
    assert mesh.volume == pytest.approx(len(positions) * DISTANCE**3, rel=0.01)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)
    radii = np.linalg.norm(surface.vertices, axis=1)
    # particles at random would scatter a vertex by 0.25 distances: the filter (s = 1.08) averages 8 pi^1.5 s^3 of them,
    # half of which are there, and its edge has the slope 1 / (s sqrt(2 pi)); the jittered lattice scatters less
    assert radii.std() < 0.25 * DISTANCE
    assert ((surface.normals * surface.vertices).sum(1) / radii).min() > 0.8


def test_faint_particles_are_not_the_body():
    """Full for x < -10 cm, a fifth full beyond: the surface is between them, not somewhere among the faint ones."""
    positions = jittered(0.2)
    space = FilledSpace.around(positions, torch.where(positions[:, 0] < -0.1, 1.0, 0.2), DISTANCE)
    assert space.enclosing_level == LEAST_LEVEL
    surface = space.surface(LEAST_LEVEL)
    inner = (np.abs(surface.vertices[:, 1:]) < 0.1).all(1) & (surface.vertices[:, 0] > -0.15)
    assert inner.sum() > 20
    # level 0.3 of a step from 1 to 0.2, filtered with 1.08 distances: 1.15 standard deviations beyond it
    np.testing.assert_allclose(surface.vertices[inner, 0].mean(), -0.1 + 1.15 * 1.08 * DISTANCE, atol=0.2 * DISTANCE)


@pytest.mark.parametrize("ending", ["obj", "glb"])
def test_the_body_as_vtk_reads_it(subject: Subject, folders: dict[str, Path], ending: str):
    files = sorted(folders[ending].iterdir())
    assert [file.name for file in files] == [f"frame_{frame:03d}.{ending}" for frame in range(5)]
    for frame in (0, 4):
        mesh = read(files[frame])
        bounds = np.array(mesh.GetBounds()).reshape(3, 2)
        lower, upper = (getattr(subject.positions[frame], end)(0) for end in ("min", "max"))
        # metres, same axes: within a distance (3 cm) outside, and three inside at the tips of wings a particle thick
        assert (bounds[:, 0] > lower - 0.03).all() and (bounds[:, 1] < upper + 0.03).all()
        assert (bounds[:, 0] < lower + 0.09).all() and (bounds[:, 1] > upper - 0.09).all()
    mass = vtkMassProperties()
    mass.SetInputData(read(files[0]))
    filled = len(subject.motion.numbers) * 0.03**3
    assert mass.GetVolume() == pytest.approx(filled, rel=0.05)  # counted in whole nodes: the root of some 600 of 1400


def test_colours_are_those_of_the_particles(subject: Subject, folders: dict[str, Path]):
    """All particles have the same features, so a vertex shows the colour network along its normal."""
    mesh = trimesh.load(folders["obj"] / "frame_002.obj", process=False)
    features = subject.stage.state.features[: len(mesh.vertices)]
    features = features[:1].expand(len(mesh.vertices), -1)
    normals = torch.from_numpy(np.array(mesh.vertex_normals, dtype=np.float32))
    expected = 255 * subject.renderer.colours(features, -normals).numpy()
    np.testing.assert_allclose(mesh.visual.vertex_colors[:, :3], expected, atol=1.5)
    glb = read(folders["glb"] / "frame_002.glb").GetPointData().GetArray("COLOR_0")
    linear = np.where(expected < 10.3, expected / 255 / 12.92, ((expected / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(vtk_to_numpy(glb)[:, :3], linear, atol=2 / 255)


def test_scattered_particles_have_no_surface(subject: Subject, finished_run: Path, tmp_path: Path):
    run = Run(finished_run)
    stage = Stage(run.last.record, finished_run)
    stage.__dict__["state"] = stage.state.with_(density=torch.full_like(stage.state.density, -50.0))
    with pytest.raises(RunError, match="frame 0 of 03_r1_correction has no surface"):
        write_glb(Subject(run, stage), tmp_path / "glb")
    assert not list(tmp_path.iterdir())
