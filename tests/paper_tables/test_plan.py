"""Which runs a suite needs, and what their keys depend on."""

from __future__ import annotations

import json
import os
from copy import deepcopy
from pathlib import Path

import pytest
import yaml
from PIL import Image

from pacnerf_lpo.data import pac_nerf
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.evaluation.parameter_errors import read_truth
from pacnerf_lpo.paper_tables import plan
from pacnerf_lpo.paper_tables.plan import _files, _rounds_needed, beginning_key, plan_runs, run_key
from pacnerf_lpo.paper_tables.scenes import Scene, find_scenes
from pacnerf_lpo.paper_tables.suites import NINE, SHARED, SUITES
from pacnerf_lpo.paper_tables.tables import RunName

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def write_scene(folder: Path, views: int = 4, frames: int = 14) -> Path:
    """A scene whose images are there, but nothing else about it is right."""
    (folder / "data").mkdir(parents=True)
    shots = []
    for view in range(views):
        for frame in range(frames):
            pose = {"c2w": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "intrinsic": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
            shots.append({"file_path": f"./data/r_{view}_{frame}.png", "time": frame / 24, **pose})
            Image.new("RGB", (2, 2), (view, frame, 0)).save(folder / "data" / f"m_{view}_{frame}.png")
    (folder / "all_data.json").write_text(json.dumps(shots))
    return folder


@pytest.fixture
def config(tmp_path: Path) -> dict:
    pac_nerf.file_digest.cache_clear()
    root = str(write_scene(tmp_path / "scene"))
    return {
        "seed_everything": 0,
        "truth": None,
        "data": {"root": root, "train_views": [0, 1], "test_views": [2], "frames": 13, "background": "auto"},
        "physics": {"rho": 1000.0},
        "phases": {"static": {"init_args": {"steps": 2000}}, "correction": {"class_path": "LPOModule"}},
        "outer_loop": {"rounds": 1, "run_dir": "runs/fit", "physics_start": "warm"},
        "trainer": {},
    }


@pytest.mark.parametrize(
    ("section", "name", "value", "run_changes", "beginning_changes"),
    [
        ("physics", "rho", 1001.0, True, True),
        ("data", "train_views", [0, 2], True, True),
        ("phases", "correction", {"class_path": "GridOptimizationModule"}, True, False),
        ("outer_loop", "physics_start", "restart", True, False),
        ("outer_loop", "rounds", 4, False, False),
        ("outer_loop", "run_dir", "elsewhere", False, False),
    ],
)
def test_key_and_configuration(config: dict, section, name, value, run_changes: bool, beginning_changes: bool):
    changed = deepcopy(config)
    changed[section][name] = value
    assert (run_key(changed) != run_key(config)) == run_changes
    assert (beginning_key(changed) != beginning_key(config)) == beginning_changes


def test_key_and_contents_of_the_data(config: dict, tmp_path: Path):
    before = run_key(config)
    folder = tmp_path / "scene" / "data"

    def key_after(path: Path, content: bytes) -> str:
        times = path.stat()
        path.write_bytes(content)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        pac_nerf.file_digest.cache_clear()
        return run_key(config)

    unused = [folder / "m_3_0.png", folder / "m_0_13.png"]  # a view and a frame that are not used
    assert [key_after(path, b"other") for path in unused] == [before] * 2
    used = folder / "m_2_12.png"
    same_size = used.read_bytes()[:-1] + b"x"
    assert key_after(used, same_size) != before  # same size, same time


def test_key_does_not_depend_on_where_the_data_lies(config: dict, tmp_path: Path):
    before = run_key(config)
    moved = tmp_path / "moved"
    (tmp_path / "scene").rename(moved)
    pac_nerf.file_digest.cache_clear()
    config["data"]["root"] = str(moved)
    config["truth"] = str(moved / "truth.json")
    assert run_key(config) == before


def test_key_and_version(config: dict, monkeypatch: pytest.MonkeyPatch):
    before = run_key(config)
    monkeypatch.setattr(plan, "__version__", "9.9.9")
    assert run_key(config) != before


@pytest.mark.parametrize("suite", SUITES)
def test_configurations_of_every_suite_exist(suite: str):
    scenes = [Scene(name, name, (CONFIGS / "scenes" / f"{name}.yaml",), "", True) for name in SUITES[suite].scenes]
    by_name = {scene.name: scene for scene in scenes}
    needed = _rounds_needed(SUITES[suite], scenes)
    for name in needed:
        _files(name, by_name[name.scene], CONFIGS, [CONFIGS / extra for extra in SUITES[suite].overlays])
        assert name.beginning in needed


def test_runs_that_the_tables_need():
    def count(suite: str, scenes: tuple[str, ...]) -> dict[str, int]:
        places = [Scene(name, name, (), "", True) for name in scenes]
        needed = _rounds_needed(SUITES[suite], places)
        return {str(name): rounds for name, rounds in needed.items() if name.scene == "torus"}

    assert count("table4", NINE) == {f"torus {name} baseline": 0 for name in (
        "3v", "3v_dagger", "3v_dagger_no_surface_schedule", "3v_dagger_no_view_invariant", "3v_dagger_full_length"
    )}  # fmt: skip
    assert count("table9", ("torus",)) == {"torus 3v lpo": 1, "torus 3v baseline": 1}
    assert count("table10", NINE) == {
        **{f"torus {name} baseline": 1 for name in ("3v", "3v_dagger")},
        **{f"torus {name} lpo": 4 for name in ("3v", "3v_dagger")},
    }
    assert len(count("table13", NINE)) == 5 * 6
    assert len(count("shared", SHARED)) == 1 + 2 * 6


def test_scenes_with_a_truth_are_not_the_paper_s(tmp_path: Path):
    for name in ("torus", "letter"):
        (tmp_path / "data" / name).mkdir(parents=True)
    (tmp_path / "data" / "torus" / "truth.json").write_text("never read here")
    torus, letter = find_scenes(tmp_path / "data", ("torus", "letter", "cat"), CONFIGS, tmp_path / "truth")
    assert not torus.original and torus.configs[-1] == CONFIGS / "shared" / "torus.yaml"
    assert letter.original and letter.configs == (CONFIGS / "scenes" / "letter.yaml",)
    truth = read_truth(letter.truth)
    assert truth.parameters == {"mu": 100.0, "kappa": 1e5} and truth.fluid


@pytest.mark.parametrize("folder", ["nowhere", "."])
def test_no_scenes(tmp_path: Path, folder: str):
    with pytest.raises(UserInputError, match="--data-root"):
        find_scenes(tmp_path / folder, NINE, CONFIGS, tmp_path)


@pytest.mark.slow
def test_plan_of_real_configurations(tmp_path: Path):
    """One beginning for all corrections, which an overlay cannot switch on again, and none where it would differ."""
    pac_nerf.file_digest.cache_clear()
    root = str(write_scene(tmp_path / "torus", views=11))
    scene = Scene("torus", root, (CONFIGS / "scenes" / "torus.yaml",), "", original=True)
    runs = plan_runs(SUITES["table15"], [scene], CONFIGS, [CONFIGS / "cpu.yaml"], tmp_path)
    by_name = {run.name: run for run in runs}
    base = by_name[RunName("torus", "6v")]
    for correction in ("lpo", "lpo_f", "lpo_p", "go", "none"):
        run = by_name[RunName("torus", "6v", correction)]
        assert run.start is base
        assert run.config["outer_loop"]["rounds"] == run.rounds == 4
        assert (run.config["phases"]["correction"] is None) == (correction == "none")
    assert by_name[RunName("torus", "pac_nerf")].start is None
    keys_of_runs = {run.key for run in runs if run.name.correction}
    assert len(keys_of_runs) == 5 and base.rounds == 1
    base.prepare()
    written = yaml.safe_load((base.run_dir / "config.yaml").read_text())
    assert written == base.config and written["data"]["image_scale"] == 0.5
