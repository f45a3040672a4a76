"""``pacnerf-lpo export``: the choice of a format, a new user's mistakes, and nothing written half."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.errors import SimulationError
from pacnerf_lpo.evaluation.prediction import prediction_folder
from pacnerf_lpo.evaluation.run_directory import Run
from pacnerf_lpo.export import points
from pacnerf_lpo.export.files import whole_file, whole_folder
from pacnerf_lpo.export.formats import FORMATS
from pacnerf_lpo.mpm.physics import Physics
from tests.test_docs import guide_commands

STEM = "03_r1_correction"
EXTRA = ("meshio", "pxr", "skimage", "trimesh")


@pytest.fixture
def complain(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Runs the command and returns the one line it prints, before the particles are looked at."""

    def begin(*_) -> None:
        raise AssertionError("long work began")

    monkeypatch.setattr(Physics, "simulate", begin)

    def run(*words: str) -> str:
        status = main(["export", *words])
        lines = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
        assert status == 2 and len(lines) == 1 and len(lines[0]) < 400, lines
        return lines[0]

    return run


@pytest.fixture
def still_run(finished_run: Path, tmp_path: Path) -> Path:
    """A run that was stopped after the static phase."""
    run = tmp_path / "still"
    shutil.copytree(finished_run, run, ignore=shutil.ignore_patterns("predictions", "exports", "particles"))
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["phases"] = manifest["phases"][:1]
    (run / "manifest.json").write_text(json.dumps(manifest))
    return run


@pytest.mark.parametrize("words", [words for words in guide_commands() if words[0] == "export"], ids=" ".join)
def test_readme(finished_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]):
    monkeypatch.chdir(tmp_path)
    own = {"runs/demo": str(finished_run), "[3]": "[2]", "[0,3]": "[0,2]"}
    assert main([own.get(word, word) for word in words]) == 0
    assert "--output" not in words or Path(words[words.index("--output") + 1]).exists()


def test_every_format_has_a_place_of_its_own_in_the_run(finished_run: Path, capsys: pytest.CaptureFixture[str]):
    for name in FORMATS:
        assert main(["export", str(finished_run), "--format", name]) == 0
    printed = capsys.readouterr().out.split()
    folder = finished_run / "exports"
    assert printed == [
        str(finished_run / "particles" / STEM),
        *(str(folder / f"{STEM}{end}") for end in ("_vtu", ".usd", "_obj", "_glb", ".csv", ".mp4")),
    ]
    assert all(Path(path).exists() for path in printed)
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("name", ["motion.usda", "motion.USDC", "tracks.csv"])
def test_the_ending_chooses_the_format(finished_run: Path, tmp_path: Path, name: str):
    """And the export is repeated in its place."""
    for _ in range(2):
        assert main(["export", str(finished_run), "--output", str(tmp_path / "new" / name), "--particles", "5"]) == 0
    assert [path.name for path in (tmp_path / "new").iterdir()] == [name]


def test_a_folder_of_the_same_kind_is_replaced(finished_run: Path, tmp_path: Path):
    words = ["export", str(finished_run), "--format", "vtu", "--output", str(tmp_path / "vtu")]
    assert main(words) == 0
    shutil.copy(tmp_path / "vtu" / "frame_000.vtu", tmp_path / "vtu" / "frame_099.vtu")
    assert main(words) == 0
    assert sorted(path.name for path in (tmp_path / "vtu").iterdir()) == [
        *(f"frame_{frame:03d}.vtu" for frame in range(5)),
        "motion.pvd",
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["vtu"]


def test_points_need_no_images(finished_run: Path, tmp_path: Path):
    """A run without predictions is simulated, not rendered."""
    run = tmp_path / "run"
    shutil.copytree(finished_run, run, ignore=shutil.ignore_patterns("predictions", "exports"))
    assert main(["export", str(run), "--output", str(tmp_path / "tracks.csv"), "--particles", "3"]) == 0
    assert not (run / "predictions").exists()
    assert len((tmp_path / "tracks.csv").read_text().splitlines()) == 1 + 5 * 3


def test_motion_is_read_where_it_was_predicted(finished_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run = tmp_path / "run"
    shutil.copytree(finished_run, run, ignore=shutil.ignore_patterns("predictions", "exports", "particles"))
    opened = Run(run)
    folder = prediction_folder(opened, opened.last)
    folder.mkdir(parents=True)
    known = np.random.default_rng(0).random((5, len(opened.last.state.positions), 3)).astype(np.float32)
    np.save(folder / "positions.npy", known)
    monkeypatch.delattr(Physics, "simulate")
    assert main(["export", str(run), "--format", "ply"]) == 0
    vertices = PlyData.read(run / "particles" / STEM / "frame_004.ply")["vertex"]
    np.testing.assert_array_equal(np.stack([vertices[axis] for axis in "xyz"], axis=1), known[4])


def test_a_shape_without_motion(still_run: Path, complain: Callable[..., str], monkeypatch: pytest.MonkeyPatch):
    for name in ("vtu", "usd", "csv", "mp4"):
        line = complain(str(still_run), "--format", name)
        assert "phase 00_static has seen frame 0 only" in line
        assert f"fit --resume {still_run}" in line and "ply, obj, glb" in line
    for name in ("ply", "glb"):
        assert main(["export", str(still_run), "--format", name]) == 0
    assert [path.name for path in (still_run / "exports" / "00_static_glb").iterdir()] == ["frame_000.glb"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--format fbx", "--format fbx: known are ply, vtu, usd, obj, glb, csv, mp4"),
        (
            "--output {tmp}/body.stl",
            "its ending does not name a format; give a file that ends in .usd, .usda, .usdc,",
        ),
        ("--output {tmp}/folder", "or a folder and --format ply, vtu, obj, glb"),
        ("--output {tmp}/body.glb", "its ending does not name a format"),
        ("--format obj --output {tmp}/body.obj", "one file per frame is written; give a folder"),
        ("--format vtu --output {tmp}/motion.usd", "one file per frame is written; give a folder"),
        ("--format csv --output {tmp}/motion.usd", "give a name that ends in .csv"),
        ("--format usd --output {tmp}/motion", "give a name that ends in .usd or .usda or .usdc"),
        ("--format glb --particles 10", "--format glb needs all particles"),
        ("--format csv --particles 0", "give at least 1"),
        ("--format csv --views [0]", "is not seen by a camera"),
        ("--format mp4 --views [0,2]", "shows one view"),
        ("--format mp4 --views [3]", "no view 3; it has"),
        ("--views [3]", "no view 3; it has"),
        ("--format csv --phase 09_none", "no finished phase '09_none'"),
        ("--format vtu --output {tmp}/taken", "the folder holds other files, such as notes.txt; give another name"),
        ("--format vtu --output {tmp}/taken/notes.txt", "is a file, and one file per frame needs a folder"),
        ("--output {tmp}/taken/notes.txt/tracks.csv", "notes.txt is a file, not a folder"),
        ("--output {tmp}/folder.csv", "is a folder; give the name of a file"),
    ],
)
def test_mistakes(finished_run: Path, tmp_path: Path, complain: Callable[..., str], words: str, message: str):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine")
    (tmp_path / "folder.csv").mkdir()
    assert message in complain(str(finished_run), *words.format(tmp=tmp_path).split())
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["folder.csv", "notes.txt", "taken"]
    assert (tmp_path / "taken" / "notes.txt").read_text() == "mine"


def test_no_such_run(tmp_path: Path, complain: Callable[..., str]):
    assert str(tmp_path / "none") in complain(str(tmp_path / "none"), "--format", "csv")


@pytest.mark.parametrize(
    ("name", "packages"), [("vtu", "meshio"), ("usd", "usd-core"), ("glb", "scikit-image and trimesh")]
)
def test_a_missing_library(
    finished_run: Path, complain: Callable[..., str], monkeypatch: pytest.MonkeyPatch, name: str, packages: str
):
    for module in EXTRA:
        monkeypatch.setitem(sys.modules, module, None)
    line = complain(str(finished_run), "--format", name)
    assert line == f"pacnerf-lpo: --format {name} needs {packages}: pip install 'pacnerf-lpo[export]'"


@pytest.mark.slow
def test_nothing_else_needs_the_extra(finished_run: Path, tmp_path: Path):
    """In a process of its own, where no test has imported them before."""
    words = ["export", str(finished_run), "--phase", "00_static", "--format", "ply", "--output", str(tmp_path / "ply")]
    program = f"import sys; sys.modules.update(dict.fromkeys({EXTRA})); from pacnerf_lpo.__main__ import main; "
    subprocess.run([sys.executable, "-c", f"{program}sys.exit(main({words}))"], check=True)
    assert (tmp_path / "ply" / "frame_000.ply").exists()


def test_an_unstable_motion_is_one_line(
    finished_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    run = tmp_path / "run"
    shutil.copytree(finished_run, run, ignore=shutil.ignore_patterns("predictions", "exports"))

    def explode(*_) -> None:
        raise SimulationError(4, 17, "|v| dt > dx (v = 310 m/s)")

    monkeypatch.setattr(Physics, "simulate", explode)
    assert main(["export", str(run), "--format", "usd"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == "pacnerf-lpo: simulation stopped in frame 4, substep 17: |v| dt > dx (v = 310 m/s)"
    assert not list((run / "exports").glob("*"))


def test_an_interrupted_export_leaves_the_old_one(finished_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    words = ["export", str(finished_run), "--format", "ply", "--output", str(tmp_path / "ply")]
    assert main(words) == 0
    before = (tmp_path / "ply" / "frame_000.ply").read_bytes()

    def stop(frames: int, path: Path):
        yield 0
        raise KeyboardInterrupt

    monkeypatch.setattr(points, "frames_of", stop)
    assert main([*words, "--particles", "3"]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["ply"]
    assert len(list((tmp_path / "ply").iterdir())) == 5 and (tmp_path / "ply" / "frame_000.ply").read_bytes() == before


def test_a_file_is_whole_or_not_there(tmp_path: Path):
    path = tmp_path / "new" / "table.csv"
    with pytest.raises(OSError, match="full"), whole_file(path) as part:
        part.write_text("half")
        raise OSError("disk full")
    assert not list(path.parent.iterdir())
    with whole_file(path) as part:
        assert part.suffix == ".csv" and not path.exists()
        part.write_text("whole")
    assert [(file.name, file.read_text()) for file in path.parent.iterdir()] == [("table.csv", "whole")]


def test_what_a_killed_export_left_is_removed(tmp_path: Path):
    (tmp_path / ".vtu.part").mkdir()
    (tmp_path / ".vtu.part" / "frame_000.vtu").write_text("half")
    with whole_folder(tmp_path / "vtu") as part:
        (part / "frame_001.vtu").write_text("whole")
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["vtu", "vtu/frame_001.vtu"]
