"""A run that begins with the phases of another one, and why it may not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
import yaml

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.reuse import difference, reusable
from pacnerf_lpo.types import ParticleState
from tests import fake_run

pytestmark = pytest.mark.usefixtures("small_threads")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("reuse") / "first"
    assert fake_run.main(fake_run.arguments(run, velocity="steps=7")) == 0
    return run


def states(run: Path, stem: str) -> ParticleState:
    return ParticleState.load(run / "states" / f"{stem}.pt")


def test_another_material_keeps_reconstruction_and_velocity(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    run, trained = tmp_path / "run", []
    step = fake_run.FakePhase.training_step

    def counted(phase: fake_run.FakePhase, batch: int) -> torch.Tensor:
        trained.append(batch)
        return step(phase, batch)

    monkeypatch.setattr(fake_run.FakePhase, "training_step", counted)
    words = [*fake_run.arguments(run, velocity="steps=9"), f"--outer_loop.reuse={source}"]
    assert fake_run.main(words) == 0
    said = capsys.readouterr().err
    assert "the velocity is fitted again, since phases.velocity.init_args.steps is 7 there and 9 here" in said
    phases = json.loads((run / "manifest.json").read_text())["phases"]
    assert [phase["copied_from"] for phase in phases] == ["first", None, None, None]
    assert [phase["steps"] for phase in phases] == [6, 9, 6, 6]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--phases.static.steps=5",), "phases.static.init_args.steps is 6 there and 5 here"),
        (("--data.root=y",), "it was made with another video"),
        (("--seed_everything=3",), "seed_everything is 0 there and 3 here"),
    ],
)
def test_another_reconstruction_is_refused_before_anything_is_written(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], reason: str
):
    run = tmp_path / "run"
    words = [*fake_run.arguments(run, velocity="steps=7"), *options, f"--outer_loop.reuse={source}"]
    assert fake_run.main(words) == 2
    assert reason in capsys.readouterr().err
    assert not run.exists()


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    words = [*fake_run.arguments(tmp_path / "run"), f"--outer_loop.reuse={tmp_path}"]
    assert fake_run.main(words) == 2
    assert "is not a run directory" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("effect", "taken"), [("drag", 1), ("friction", 2)], ids=["drag-acts-in-flight", "friction-acts-on-the-ground"]
)
def test_effects_in_flight_need_another_velocity(tmp_path: Path, source: Path, effect: str, taken: int):
    module, name = {"drag": ("linear_drag", "LinearDrag"), "friction": ("ground_friction", "GroundFriction")}[effect]
    config = yaml.safe_load((source / "config.yaml").read_text())
    config["physics"]["effects"] = [{"class_path": f"pacnerf_lpo.mpm.effects.{module}.{name}", "init_args": {}}]
    found = reusable(source, config, "x")
    assert len(found.records) == taken
    assert (found.why_not is None) == (taken == 2)


def test_an_unfinished_reconstruction_is_refused(tmp_path: Path, source: Path):
    manifest = json.loads((source / "manifest.json").read_text())
    manifest["phases"] = []
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(UserInputError, match="its reconstruction is not finished"):
        reusable(tmp_path, {}, "x")


def test_the_first_difference_is_named_with_both_values():
    assert difference({"a": {"b": 1, "c": [2]}}, {"a": {"b": 1, "c": [3]}}) == "a.c is [2] there and [3] here"
    assert difference({"a": {"b": 1}}, {"a": {"b": 1}}) is None
    assert difference({"a": 1}, {"a": 1, "d": 2}) == "d is None there and 2 here"
