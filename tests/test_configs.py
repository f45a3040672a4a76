"""Every configuration in ``configs/`` says what its name promises, and runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import pacnerf_lpo.commands.fit  # noqa: F401  (makes the short class names known)
from pacnerf_lpo.__main__ import main
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.mpm.physics import Physics

pytestmark = pytest.mark.slow

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
SMOKE = Path(__file__).with_name("smoke.yaml")
ABLATIONS = ("3v_dagger_no_surface_schedule", "3v_dagger_no_view_invariant", "3v_dagger_full_length")
SCENES = sorted(path.stem for path in (CONFIGS / "scenes").glob("*.yaml"))
SHARED = {name: name for name in ("torus", "droplet", "playdoh", "cream", "trophy")}
SHARED |= {"drag_torus": "torus", "null_bird": "bird", "slip_cat": "torus"}  # on which scene's settings each builds


def configured(*names: str, root: str = "some/folder") -> PhaseCLI:
    """The command line of ``fit`` with these configs, parsed, with everything made but nothing read."""
    files = [word for name in ("fit", *names) for word in ("--config", str(CONFIGS / f"{name}.yaml"))]
    return PhaseCLI([*files, "--data.root", root], VideoModule, Physics)


def flat(config: Any, prefix: str = "") -> dict[str, Any]:
    """Nested sections as ``{"phases.static.class_path": ...}``."""
    if not isinstance(config, dict):
        return {prefix: config}
    return {key: value for name, part in config.items() for key, value in flat(part, f"{prefix}.{name}").items()}


def changes(one: PhaseCLI, other: PhaseCLI) -> set[str]:
    """Sections (two levels) in which two configurations differ."""
    a, b = (flat(cli.config.as_dict()) for cli in (one, other))
    differing = {key for key in a.keys() | b.keys() if a.get(key) != b.get(key)}
    return {".".join(key.split(".")[1:3]) for key in differing if not key.startswith(".config")}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("last", [[], ["cpu"]], ids=["full", "cpu"])
def test_every_scene_is_complete(scene: str, last: list[str]):
    cli = configured(f"scenes/{scene}", *last)
    hit = cli.config.phases.velocity.init_args.hit_frame
    assert cli.config.phases.physics.init_args.hit_frame == hit
    assert hit + cli.config.phases.physics.init_args.warm_up_frames < cli.config.data.frames
    assert list(cli.phases) == ["static", "velocity", "physics", "correction"]
    assert cli.physics.free_names


def test_shared_scenes_say_when_they_land_and_how_large_their_images_are():
    assert {path.stem for path in (CONFIGS / "shared").glob("*.yaml")} == SHARED.keys()
    for name, scene in SHARED.items():
        cli = configured(f"scenes/{scene}", "cpu", f"shared/{name}")
        assert changes(configured(f"scenes/{scene}", "cpu"), cli) <= {
            "phases.velocity",
            "phases.physics",  # its hit_frame follows that of the velocity
            *("data.image_scale", "data.box_lower", "data.box_upper"),
        }
        assert cli.config.phases.velocity.init_args.hit_frame < cli.config.data.frames
        assert cli.config.data.image_scale == (0.5 if name == scene else 1.0)  # 256 or 128 pixels


def test_five_view_sets_are_different_and_use_every_view():
    sets = [tuple(configured("scenes/torus", f"views/3v_{k}").config.data.train_views) for k in range(1, 6)]
    assert len(set(sets)) == 5 and {len(views) for views in sets} == {3}
    assert {view for views in sets for view in views} == set(range(11))


@pytest.mark.parametrize("baseline", sorted(path.stem for path in (CONFIGS / "baselines").glob("*.yaml")))
def test_baselines_change_the_static_phase_and_the_views_and_nothing_else(baseline: str):
    assert changes(configured("scenes/torus"), configured("scenes/torus", f"baselines/{baseline}")) <= {
        "data.train_views",
        "phases.static",
    }


def test_dagger_ablations_each_switch_off_one_change():
    static = {
        name: flat(configured("scenes/torus", f"baselines/{name}").config.phases.static.init_args.as_dict())
        for name in ("3v", "3v_dagger", *ABLATIONS)
    }
    dagger = static["3v_dagger"]
    changed = {
        name: {key.split(".")[1] for key in mine.keys() | dagger.keys() if mine.get(key) != dagger.get(key)}
        for name, mine in static.items()
    }
    assert changed == {
        "3v": {"surface_schedule", "view_invariant_weight", "length"},
        "3v_dagger": set(),
        "3v_dagger_no_surface_schedule": {"surface_schedule"},
        "3v_dagger_no_view_invariant": {"view_invariant_weight"},
        "3v_dagger_full_length": {"length"},
    }


def test_corrections():
    moved = {
        name: (arguments.positions, arguments.features)
        for name in ("lpo", "lpo_f", "lpo_p")
        for arguments in [configured("scenes/torus", f"corrections/{name}").config.phases.correction.init_args]
    }
    assert moved == {"lpo": (True, True), "lpo_f": (False, True), "lpo_p": (True, False)}
    assert "correction" not in configured("scenes/torus", "corrections/none").phases


def test_a_correction_after_cpu_keeps_its_iterations():
    assert "correction" not in configured("scenes/torus", "cpu", "corrections/none").phases
    grid = configured("scenes/torus", "cpu", "corrections/go").phases["correction"]
    assert type(grid).__name__ == "GridOptimizationModule" and grid.steps == 40


def test_cpu_keeps_what_distinguishes_the_baselines():
    length = [
        configured("scenes/torus", baseline, "cpu").config.phases.static.init_args.length.init_args
        for baseline in ("baselines/3v", "baselines/3v_dagger")
    ]
    assert [(part.steps, part.halvings) for part in length] == [(6000, 2), (2000, 2)]


def fit(run_dir: Path, *options: str, configs: tuple[str, ...]) -> int:
    files = [word for name in ("fit", *configs) for word in ("--config", str(CONFIGS / f"{name}.yaml"))]
    words = ["fit", *files, "--config", str(SMOKE), "--outer_loop.run_dir", str(run_dir), "--trainer.accelerator=cpu"]
    return main([*words, *options])


def test_demo_runs_to_its_report(tmp_path: Path, small_threads: None, capsys: pytest.CaptureFixture[str]):
    run_dir = tmp_path / "demo"
    assert fit(run_dir, configs=("demo",)) == 0
    assert (run_dir / "report.html").is_file() and (run_dir / "results.json").is_file()
    events = EventAccumulator(str(run_dir / "tensorboard")).Reload()
    assert {"static/loss", "velocity/loss", "physics/E [Pa]", "correction/psnr (test views)"} <= set(
        events.Tags()["scalars"]
    )
    assert any(tag.startswith("correction/view 0, frame 0") for tag in events.Tags()["images"])
    capsys.readouterr()
    assert main(["evaluate", str(run_dir), "--truth", "demo"]) == 0
    assert "| E |" in capsys.readouterr().out


def test_a_published_scene_runs_with_adam(tmp_path: Path, small_threads: None):
    bird = ["--data.root=asset:bird", "--data.box_lower=[-0.6,0.2,-0.4]", "--data.box_upper=[0.6,1.0,0.4]"]
    adam = ["--phases.physics.method=PaperAdam", "--phases.physics.method.main_iterations=1"]
    adam += ["--phases.physics.method.warm_up_iterations=0"]
    assert fit(tmp_path / "run", *bird, *adam, configs=("scenes/cat", "baselines/3v_dagger", "corrections/lpo_p")) == 0
    assert (tmp_path / "run" / "report.html").is_file()


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("--physics.material.E=-1e5", "NeoHookean: E = -100000 Pa is not a possible Young's modulus"),
        ("--physics.material=NeoHokean", "did you mean NeoHookean?"),
        ("--data.train_views=[0,4,99]", "99"),
        ("--data.root=nowhere", "nowhere"),
        ("--physics.frame_rate=30", "time stamps give 24.00 frames/s"),
        ("--phases.velocity.hit_frame=40", "hit_frame = 40"),
    ],
)
def test_a_mistake_is_found_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, expected: str
):
    assert fit(tmp_path / "run", option, configs=("demo",)) == 2
    lines = capsys.readouterr().err.strip().split("\n")  # on a slow machine a bar (\r) shows the images being read
    assert len(lines) == 1 and expected in lines[0], lines
    assert not (tmp_path / "run").exists()


EFFECTS = sorted(path.stem for path in (CONFIGS / "effects").glob("*.yaml"))
SUITED = {"shear_thinning": "cream", "cohesion": "trophy"}


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_is_an_overlay_that_adds_itself(effect: str):
    scene = f"scenes/{SUITED.get(effect, 'torus')}"
    plain, cli = configured(scene), configured(scene, f"effects/{effect}")
    assert changes(plain, cli) == {"physics.effects"}
    (added,) = cli.physics.effects
    assert type(added).__name__.lower() == effect.replace("_", "")
    assert cli.physics.free_names == [*plain.physics.free_names, *added.parameters]


def test_overlays_of_effects_combine():
    cli = configured("scenes/torus", "effects/linear_drag", "effects/ground_friction")
    assert [type(effect).__name__ for effect in cli.physics.effects] == ["LinearDrag", "GroundFriction"]
