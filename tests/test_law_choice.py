"""``physics.material: auto`` in a run: where laws compete, how the run goes on with the chosen one, and resume."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from pacnerf_lpo import __main__, cli, config_errors
from pacnerf_lpo.callbacks.phase import PhaseCheckpoint
from pacnerf_lpo.callbacks.stop_request import StopRequest
from pacnerf_lpo.identification import laws
from pacnerf_lpo.identification.forward_model import BodyModel
from pacnerf_lpo.mpm.materials import Auto, NeoHookean, Newtonian, VonMises
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.outer_loop import OuterLoop, algorithm_1
from pacnerf_lpo.phases import LawChoice
from pacnerf_lpo.phases.law_choice import held_back
from pacnerf_lpo.types import ParticleState
from tests import fake_run
from tests.phases.conftest import FRAMES, block, data, state  # noqa: F401
from tests.phases.test_dynamic_phases import run

FOUND = {"tau_y": 1234.56, "E": 2.0e5, "nu": 0.25, "ground_height": 0.0, "v_x": 0.0}

pytestmark = pytest.mark.usefixtures("small_threads")


class FakeLaw(fake_run.FakePhase):
    """Finds plasticine, whatever it sees."""

    def export_state(self) -> ParticleState:
        found = {name: FOUND[name] for name in VonMises.parameters}
        return super().export_state().with_(physics=found)

    def export_findings(self) -> dict[str, Any]:
        trial = {"law": "VonMises", "family": "plastic", "known": FOUND, "left_out": "", "probability": 0.98}
        return {"laws": [{**trial, "held_out": 1.1}], "chosen": "VonMises", "sentences": ["It is plasticine."]}


def fit(run_dir: Path, *more: str) -> int:
    words = fake_run.arguments(run_dir, static="steps=2", velocity="steps=2", physics="steps=2", correction="steps=2")
    words = [word for word in words if not word.startswith("--physics.material")]
    return main([*words, "--physics.material=auto", "--phases.law=FakeLaw", "--phases.law.steps=2", *more])


def main(words: list[str]) -> int:
    return __main__.guarded(lambda: cli.fit(words, fake_run.FakeData, Physics, fake_run.look_back, fake_run.finish))


def test_laws_compete_between_the_velocity_and_the_first_identification():
    roles = [step.role for step in algorithm_1(2, True, law=True)]
    assert roles == ["static", "velocity", "law", "physics", "correction", "physics", "correction"]


def test_the_run_goes_on_with_the_law_that_was_chosen_and_says_which(tmp_path, capfd):
    assert fit(tmp_path / "run") == 0
    config = yaml.safe_load((tmp_path / "run/config.yaml").read_text())
    assert config["physics"]["material"] == {
        "class_path": "pacnerf_lpo.mpm.materials.von_mises.VonMises",
        "init_args": {"E": 2.0e5, "nu": 0.25, "tau_y": 1235.0},
    }
    last = ParticleState.load(tmp_path / "run/states/04_r1_correction.pt")
    assert last.physics["tau_y"] == FOUND["tau_y"]
    said = capfd.readouterr().out
    assert "plastic       probability 98.0 %, held-out error 1.10 x noise" in said
    assert "It is plasticine." in said
    assert json.loads((tmp_path / "run/states/02_law.json").read_text())["chosen"] == "VonMises"


@pytest.mark.slow
def test_a_run_that_stopped_after_the_choice_goes_on_with_it(tmp_path):
    """Killed before the configuration was rewritten, and after."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert fit(whole) == 0
    assert fit(cut, "--phases.physics.unstable=true", "--phases.physics.steps=6") == 1
    decided = (cut / "config.yaml").read_text().replace("unstable: true", "unstable: false")
    undecided = yaml.safe_load(decided)
    undecided["physics"]["material"] = "auto"
    for content in (decided, yaml.safe_dump(undecided)):
        (cut / "config.yaml").write_text(content)
        assert main(["--resume", str(cut)]) == 0
        assert yaml.safe_load((cut / "config.yaml").read_text())["physics"]["material"]["init_args"]["tau_y"] == 1235.0
        manifest = json.loads((cut / "manifest.json").read_text())
        stems = [Path(record["state"]).stem for record in manifest["phases"]]
        assert stems == ["00_static", "01_velocity", "02_law", "03_r1_physics", "04_r1_correction"]
        manifest["phases"] = manifest["phases"][:3]
        for name in stems[3:]:
            shutil.rmtree(cut / "checkpoints" / name)
        (cut / "manifest.json").write_text(json.dumps(manifest))


@pytest.mark.parametrize("wrong", ["atuo", "elastic"])
def test_a_misspelt_auto_is_one_clear_error(wrong, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(config_errors, "LISTED", 100)  # other tests may have defined laws, too
    assert fit(tmp_path / "run", f"--physics.material={wrong}") == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert f"physics.material: there is no {wrong}" in line
    assert "known are Auto, DruckerPrager" in line
    assert not (tmp_path / "run").exists()


def test_learning_rates_of_other_laws_are_dropped_and_misspelt_ones_refused():
    """They are those of one of the laws: of which is known only later."""
    names = [physics.free_names for physics in Physics("auto").candidates]
    assert any("tau_y" in found for found in names)
    assert all("Ee" not in found for found in names)


def test_a_search_is_not_waited_for_when_the_run_is_to_stop(tmp_path):
    """A step takes minutes; what was found before it is on disk."""
    stop = StopRequest()
    checkpoint = PhaseCheckpoint(tmp_path / "last.ckpt", 1e9, stop)
    with stop:
        for phase, deferred in ((LawChoice(), False), (fake_run.FakePhase(), True)):
            checkpoint.on_train_start(None, phase)
            assert stop.deferred is deferred


def test_a_third_of_the_training_views_and_the_last_frames_are_held_out(data):  # noqa: F811
    found = held_back(data)
    assert found.views.tolist() == [True, True, False]
    assert np.flatnonzero(~found.frames).tolist() == [FRAMES - 1]
    data = type(data)(**{**vars(data), "train": [0, 2]})
    assert held_back(data).views.tolist() == [True, False, True]


@pytest.mark.slow
def test_the_phase_gives_the_state_the_parameters_of_the_law(data, state, monkeypatch):  # noqa: F811
    """Real cameras and shape errors; a body that falls freely, whatever its law."""

    def path(model: BodyModel, free: np.ndarray) -> torch.Tensor:
        c = model.physical(free)
        times = torch.arange(FRAMES)[:, None, None] / 24
        softer = 0.3 * (6 - float(np.log10(c.get("E", c.get("kappa")))))
        fallen = torch.tensor([c["v_x"], c["v_y"], c["v_z"]], dtype=torch.float32) * times
        return model.body.positions + fallen + torch.tensor([0.0, -4.9 + softer, 0.0]) * times**2

    monkeypatch.setattr(BodyModel, "path", path)
    monkeypatch.setattr(laws, "REPLICATES", 4)
    model = Physics(Auto([NeoHookean(), Newtonian()]), substep_rate=960.0)
    before = state.with_(physics={"ground_height": 0.0})
    phase = LawChoice(particles=300, jobs=1)
    after = run(phase, data, model, before)
    chosen = phase.export_findings()["chosen"]
    assert set(after.physics) == {"ground_height", *({"E", "nu"} if chosen == "NeoHookean" else {"mu", "kappa"})}
    assert torch.equal(after.velocity, before.velocity)
    assert phase.global_step == phase.steps == 9
    again = LawChoice(particles=300, jobs=1)
    again.attach(data, model)
    again.import_state(before)
    saved: dict[str, Any] = {}
    phase.on_save_checkpoint(saved)
    again.on_load_checkpoint(saved)
    assert again.export_findings() == phase.export_findings()


def test_the_loop_finds_what_the_law_phase_wrote(tmp_path):
    assert fit(tmp_path / "run") == 0
    loop = OuterLoop(str(tmp_path / "run"), rounds=1)
    loop.resume(correction=True)
    assert loop.findings("law")["chosen"] == "VonMises"
    assert loop.findings("velocity") is None
    assert loop.next_phase() is None
