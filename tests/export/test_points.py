"""PLY, VTU and CSV hold the particles that were predicted; each is read by a library that did not write it."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
import yaml
from plyfile import PlyData
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from pacnerf_lpo.data.measurements import read_tracked_points
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.export.motion import Subject, frame_velocities
from pacnerf_lpo.export.points import write_csv, write_ply, write_vtu


@pytest.fixture(scope="module")
def ply(subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("export") / "ply"
    write_ply(subject, folder)
    return sorted(folder.iterdir())


@pytest.fixture(scope="module")
def vtu(subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "vtu"
    write_vtu(subject, folder)
    return folder


def read_vtu(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Points, point data and the types of the cells, as ParaView reads them."""
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    assert reader.GetErrorCode() == 0
    data = grid.GetPointData()
    values = {data.GetArrayName(k): vtk_to_numpy(data.GetArray(k)).copy() for k in range(data.GetNumberOfArrays())}
    kinds = np.array([grid.GetCellType(k) for k in range(grid.GetNumberOfCells())])
    return vtk_to_numpy(grid.GetPoints().GetData()).copy(), values, kinds


def test_ply_as_another_library_reads_it(subject: Subject, ply: list[Path]):
    assert [file.name for file in ply] == [f"frame_{frame:03d}.ply" for frame in range(5)]
    cloud = trimesh.load(ply[3])
    np.testing.assert_array_equal(np.asarray(cloud.vertices, dtype=np.float32), subject.motion.positions[3])
    np.testing.assert_array_equal(cloud.colors[:, :3], subject.motion.colours)


def test_ply_has_velocity_and_density(subject: Subject, ply: list[Path]):
    vertices = PlyData.read(ply[0])["vertex"]
    np.testing.assert_array_equal(vertices["density"], subject.stage.state.density.numpy())
    assert vertices["red"].dtype == np.uint8
    np.testing.assert_allclose(vertices["vy"], -0.5)


def test_vtu_as_paraview_reads_it(subject: Subject, vtu: Path):
    points, values, kinds = read_vtu(vtu / "frame_003.vtu")
    motion = subject.motion
    np.testing.assert_array_equal(points, motion.positions[3])
    assert len(kinds) == len(points) and (kinds == 1).all()  # VTK_VERTEX: without cells ParaView shows nothing
    assert set(values) == {"velocity", "colour", "density", "fraction", "id"}
    np.testing.assert_array_equal(values["velocity"], motion.velocities[3])
    np.testing.assert_array_equal(values["colour"], motion.colours)
    np.testing.assert_array_equal(values["density"], motion.density)
    np.testing.assert_array_equal(values["fraction"], motion.fraction)
    np.testing.assert_array_equal(values["id"], np.arange(len(points)))
    assert values["colour"].dtype == np.uint8


def test_pvd_lists_every_frame_with_its_time(subject: Subject, vtu: Path):
    root = ElementTree.parse(vtu / "motion.pvd").getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    listed = [(float(entry.get("timestep")), entry.get("file")) for entry in root.iter("DataSet")]
    np.testing.assert_allclose([time for time, _ in listed], np.arange(5) / 24, atol=1e-6)
    assert sorted(name for _, name in listed) == sorted(file.name for file in vtu.glob("*.vtu"))


def test_csv_has_a_row_for_each_frame_and_particle(subject: Subject, tmp_path: Path):
    write_csv(subject, tmp_path / "all.csv")
    with open(tmp_path / "all.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["frame", "time_s", "id", "x_m", "y_m", "z_m"]
    frames, count, _ = subject.motion.positions.shape
    assert len(rows) == frames * count
    read = np.array([[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in rows])
    # six decimals: half a micrometre, and the rounding of float32 positions of a metre
    np.testing.assert_allclose(read.reshape(frames, count, 3), subject.motion.positions, atol=0.5e-6 + 1e-7, rtol=0)
    assert [int(row["frame"]) for row in rows[::count]] == list(range(frames))
    np.testing.assert_allclose([float(row["time_s"]) for row in rows[::count]], np.arange(frames) / 24, atol=1e-6)


def test_thinned_trajectories_stand_in_for_measured_tracks(subject: Subject, tmp_path: Path):
    thinned = Subject(subject.run, subject.stage, particles=7)
    write_csv(thinned, tmp_path / "tracks.csv")
    times = subject.motion.times
    tracks = read_tracked_points(tmp_path / "tracks.csv", times.tolist())
    assert len(set(tracks.ids)) == 7 and len(tracks.ids) == 7 * len(times)
    for name, time, position in zip(tracks.ids, tracks.times, tracks.positions, strict=True):
        frame = int(np.abs(times - time).argmin())
        np.testing.assert_allclose(position, subject.motion.positions[frame, int(name)], atol=1e-6)


def test_thinning_takes_all_parts_of_the_body(subject: Subject):
    """Every tenth in order would take the same octant of every cell; a fixed draw does not, and repeats itself."""
    motion = subject.motion
    few = motion.thinned(100)
    np.testing.assert_array_equal(few.numbers, motion.thinned(100).numbers)
    assert len(np.unique(few.numbers)) == 100
    np.testing.assert_array_equal(few.positions, motion.positions[:, few.numbers])
    spread = motion.positions[0].std(0)
    # the standard deviation of a sample of 100 is off by 7 %; three times that
    np.testing.assert_allclose(few.positions[0].std(0), spread, rtol=0.21)
    assert motion.thinned(10**6) is motion


def test_an_identified_spin_is_in_the_first_velocity(finished_run: Path, tmp_path: Path):
    """v + omega x (x - centre), where a spin about y is part of the model."""
    shutil.copytree(finished_run, tmp_path / "run")
    path = tmp_path / "run" / "config.yaml"
    config = yaml.safe_load(path.read_text())
    spin = {"class_path": "pacnerf_lpo.mpm.effects.InitialSpin", "init_args": {"spin_y": 2.0}}
    path.write_text(yaml.safe_dump({**config, "physics": {**config["physics"], "effects": [spin]}}))
    run = Run(tmp_path / "run")
    motion = Subject(run, run.last).motion
    relative = motion.positions[0] - motion.positions[0].mean(0)
    turning = np.stack((2 * relative[:, 2], np.full(len(relative), -0.5), -2 * relative[:, 0]), axis=1)
    np.testing.assert_allclose(motion.velocities[0], turning, atol=1e-5)


def test_velocities_of_free_fall_are_exact():
    """Second-order differences of a parabola in time are exact up to float64 rounding of x / dt."""
    times = np.arange(6) / 24
    start, speed = np.array([[0.1, 1.0, -0.3]]), np.array([[1.0, -0.5, 0.2]])
    positions = start + speed * times[:, None, None] + 0.5 * np.array([0, -9.8, 0]) * times[:, None, None] ** 2
    expected = speed + np.array([0, -9.8, 0]) * times[:, None, None]
    np.testing.assert_allclose(frame_velocities(positions, speed, times), expected, atol=1e-12)
