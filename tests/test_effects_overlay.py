"""The overlay that diagnose writes goes into ``fit``: effects and material are identified together, LPO goes on."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
import yaml
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import pacnerf_lpo.commands.fit  # noqa: F401  (makes the short class names known)
from pacnerf_lpo.__main__ import main
from pacnerf_lpo.cli import PhaseCLI
from pacnerf_lpo.data.video_module import VideoModule
from pacnerf_lpo.diagnosis.catalogue import as_config, name_of, read_candidates
from pacnerf_lpo.diagnosis.overlay import overlay
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.mpm.effects import CentralForce, LinearDrag, Magnus, ShearThinning
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.mpm.materials import NeoHookean, ViscoplasticVonMises
from pacnerf_lpo.mpm.physics import Physics
from pacnerf_lpo.phases import GaussNewton, LPOModule, PhysicsIDModule
from pacnerf_lpo.render.camera_faults import (
    CameraDrift,
    CameraShift,
)
from tests.phases.conftest import FRAMES, TRUTH, block, film
from tests.phases.test_dynamic_phases import HIT, run
from tests.test_docs import CONTRIBUTING, blocks

ROOT = Path(__file__).resolve().parents[1]
DRAG, MODULUS = 1.5, 7e4


def found_overlay(physics: Physics, effects: list[Effect], values: dict[str, float], path: Path) -> Path:
    """effects.yaml as a diagnosis writes it whose last model has these effects, too, with these values."""
    known = {**physics.guess, **{name: null for effect in effects for name, null in effect.null.items()}, **values}
    path.write_text(overlay(SimpleNamespace(physics=physics), [*physics.effects, *effects], known))
    return path


def configured(*files: Path, options: tuple[str, ...] = ()) -> PhaseCLI:
    """``fit`` with these configs, parsed."""
    return PhaseCLI([*(word for file in files for word in ("--config", str(file))), *options], VideoModule, Physics)


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """config.yaml of a run in which Poisson's ratio was known and the ground slippery."""
    folder = tmp_path_factory.mktemp("before")
    mine = folder / "mine.yaml"
    friction = {"class_path": "GroundFriction", "init_args": {"ground_friction": 0.4}}
    mine.write_text(
        yaml.safe_dump({"physics": {"material": {"init_args": {"nu": 0.2, "known": ["nu"]}}, "effects": [friction]}})
    )
    whole = folder / "config.yaml"
    whole.write_text(configured(ROOT / "configs/fit.yaml", ROOT / "configs/demo.yaml", mine).dump())
    return whole


def test_it_adds_what_was_accepted_and_leaves_the_rest(before: Path, tmp_path: Path):
    model = configured(before).physics
    values = {"E": MODULUS, "drag": DRAG, "shift_x_view3": 0.02, "ground_friction": 0.25}
    effects = found_overlay(model, [LinearDrag(), CameraShift(view=3)], values, tmp_path / "effects.yaml")
    after = configured(before, effects).physics
    assert [name_of(effect) for effect in after.effects] == ["GroundFriction", "LinearDrag", "CameraShift@3"]
    assert after.guess == {**model.guess, "shift_y_view3": 0.0, **values}
    assert after.free_names == ["E", "ground_height", "ground_friction", "drag", "shift_x_view3", "shift_y_view3"]
    assert (after.rho, after.substep_rate, after.mass_from) == (model.rho, model.substep_rate, "opacity")


def test_classes_of_the_user_are_found_again(before: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Their modules are imported by nothing but the path in the configuration."""
    material, effect = (text for text in blocks(CONTRIBUTING, "python") if re.search(r"\((Material|BodyForce)\)", text))
    for module, text in (("damped_solid", material), ("charged", effect)):
        (tmp_path / f"{module}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    own = tmp_path / "own.yaml"
    own.write_text(yaml.safe_dump({"physics": {"material": {"class_path": "damped_solid.KelvinVoigt"}, "effects": []}}))
    model = configured(before, own).physics
    from charged import Lorentz

    path = found_overlay(model, [Lorentz()], {"E": MODULUS, "eta": 5.0, "gyration": 0.3}, tmp_path / "effects.yaml")
    for name in ("damped_solid", "charged"):
        sys.modules.pop(name)
    after = configured(before, own, path).physics
    assert [type(after.material).__name__, *(type(e).__name__ for e in after.effects)] == ["KelvinVoigt", "Lorentz"]
    assert after.guess["gyration"] == 0.3 and after.guess["eta"] == 5.0 and after.guess["E"] == MODULUS


@pytest.mark.parametrize(
    "effect",
    [
        CentralForce(2.0, 0.5, centre=(0.1, 0.7, -0.2)),
        ShearThinning(0.8, onset_rate=3.0),
        Magnus(0.01),
        Magnus(0.01, spin=(0.0, 150.0, -3.5)),
        CameraDrift(0.01, view=2),
    ],
    ids=name_of,
)
def test_an_effect_comes_back_with_all_its_arguments(effect: Effect, tmp_path: Path):
    path = tmp_path / "list.yaml"
    path.write_text(yaml.safe_dump([as_config(effect, effect.guess)]))
    (again,) = read_candidates(path, ViscoplasticVonMises(), ())
    assert type(again.effect) is type(effect) and again.name == name_of(effect)
    assert again.effect.guess == effect.guess and again.effect.constants == effect.constants


def test_an_effect_that_forgets_an_argument_is_one_clear_error():
    class Forgetful(LinearDrag):
        def __init__(self, drag: float = 0.0, medium: str = "air"):
            super().__init__(drag)

    with pytest.raises(UserInputError, match=r"Forgetful: its argument medium is no coefficient"):
        as_config(Forgetful(), {"drag": 1.0})


@pytest.mark.slow
def test_drag_and_stiffness_are_identified_together_and_lpo_goes_on():
    """Filmed by the model that is fitted, so what stays is a few times the longest last step: a hundredth of five
    scales, 0.005 for both.
    """
    state = block()
    true = Physics(NeoHookean(E=TRUTH["E"], nu=0.3), effects=[LinearDrag(DRAG)], substep_rate=960.0)
    data = film(state, true.simulate(state, FRAMES))
    model = Physics(NeoHookean(E=2e4, nu=0.3, known=["nu"]), effects=[LinearDrag(0.5)], substep_rate=960.0)
    method = GaussNewton(coarse_iterations=0, iterations=12, scan_decades=0, pool=1, fits_velocity=False)
    phase = PhysicsIDModule(HIT, method, silhouette_weight=1.0)
    found = run(phase, data, model, state.with_(physics={}))
    assert set(phase.progress_metrics()) == {"E", "drag"}
    assert math.log10(found.physics["E"] / TRUTH["E"]) == pytest.approx(0.0, abs=0.02)
    assert found.physics["drag"] == pytest.approx(DRAG, abs=0.02)
    noise = 0.015 * torch.randn(found.positions.shape, generator=torch.Generator().manual_seed(2))
    found = found.with_(positions=found.positions + noise)
    corrected = run(LPOModule(4), data, model, found)
    assert corrected.physics == found.physics and not corrected.positions.equal(found.positions)


@pytest.mark.slow
def test_fit_runs_with_it_to_its_results(before: Path, tmp_path: Path, small_threads: None):
    model = configured(before).physics
    effects = found_overlay(model, [LinearDrag()], {"E": MODULUS, "drag": DRAG}, tmp_path / "effects.yaml")
    run_dir = tmp_path / "again"
    files = [word for file in (before, effects, ROOT / "tests/smoke.yaml") for word in ("--config", str(file))]
    contact = ["--phases.physics.init_args.hit_frame", "2"]  # three frames; the configuration as run has a number
    assert main(["fit", *files, *contact, "--outer_loop.run_dir", str(run_dir)]) == 0
    results = json.loads((run_dir / "results.json").read_text())
    assert results["free"] == ["E", "ground_height", "ground_friction", "drag"]
    assert results["guess"]["drag"] == {"value": DRAG, "unit": "1/s", "label": "drag rate"}
    assert [phase["phase"] for phase in results["phases"]] == ["static", "velocity", "physics", "correction"]
    identified, corrected = (phase["parameters"]["drag"] for phase in results["phases"][2:])
    assert identified["unit"] == "1/s" and identified["value"] != DRAG and corrected == identified
    scalars = EventAccumulator(str(run_dir / "tensorboard")).Reload().Tags()["scalars"]
    assert "physics/drag [1|s]" in scalars
