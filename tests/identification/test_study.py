"""Several recordings of one object as one problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.base_fit import priors
from pacnerf_lpo.identification.forward_model import with_effects
from pacnerf_lpo.identification.problem import relative
from pacnerf_lpo.identification.study import StudyProblem, divide, view_name, without_contact
from pacnerf_lpo.mpm.effects import InitialSpin, LinearDrag, Magnus, UniformForce, YieldStress
from pacnerf_lpo.mpm.effects.base import Effect
from pacnerf_lpo.render.camera_faults import CameraShift
from validation.hidden_effects.known_shape import KnownShape
from validation.hidden_effects.setting import Setting, Size, another_drop, draw_setting

SIZE = Size(particles=300, views=4, frames=8, image_size=48)


def recording(setting: Setting, values: dict[str, float]) -> KnownShape:
    """What a setting looks like at some values, without noise."""
    return KnownShape.simulated("recording", setting, values)


@pytest.fixture(scope="module")
def drops() -> list[KnownShape]:
    random = np.random.default_rng(3)
    setting, true = draw_setting(random, SIZE, "NeoHookean")
    other, velocity = another_drop(random, SIZE, setting, true, 2.5)
    return [recording(setting, true), recording(other, {**true, **velocity})]


@pytest.fixture
def study(drops: list[KnownShape], small_threads: None) -> StudyProblem:
    return StudyProblem(drops, ["low", "high"], ["UniformForce"])


def test_what_is_shared_and_what_belongs_to_a_recording(study: StudyProblem):
    effects: list[Effect] = [LinearDrag(), study.adopt(UniformForce()), CameraShift(view=2001)]
    known = {**study.first_guess, **{name: value for effect in effects for name, value in effect.guess.items()}}
    model = study.model(effects, known)
    assert [n for n in model.names if "@" not in n] == ["E", "nu", "drag", "shift_x_view2001", "shift_y_view2001"]
    each = {"ground_height", "push_x", "push_z", "v_x", "v_y", "v_z"}
    for name in study.names:
        assert {n.partition("@")[0] for n in model.names if n.endswith("@" + name)} == each
    assert all((model.bounds[0] < model.bounds[1]).tolist())
    assert priors(study, model)[1].min() > 0
    labels = [p.label for p in model.unknowns if p.name == "v_x@high"]
    assert labels == ["initial velocity along x in high"]


def test_predicts_what_the_recordings_predict(study: StudyProblem, drops: list[KnownShape]):
    effects: list[Effect] = [LinearDrag(), study.adopt(UniformForce()), CameraShift(view=2001)]
    known = {**study.first_guess, **{name: value for effect in effects for name, value in effect.guess.items()}}
    known |= {"drag": 0.7, "push_x@high": 0.5, "shift_x_view2001": 0.01}
    model = study.model(effects, known)
    path = model.path(model.start)
    found = model.observe(path, model.start)
    assert found.shape == study.measured.shape
    np.testing.assert_allclose(model.observe(path, model.start, found), found, rtol=1e-9)
    parts = study.parts(effects, known)
    assert [sorted(type(e).__name__ for e in part.effects) for part in parts] == [
        ["LinearDrag", "UniformForce"],
        ["CameraShift", "LinearDrag", "UniformForce"],
    ]
    for number, part in enumerate(parts):
        alone = part.model
        np.testing.assert_allclose(study.part_of(found, number), alone.predict(alone.start), rtol=1e-5, atol=1e-4)
    assert parts[0].known["push_x"] == 0 and parts[1].known["push_x"] == 0.5
    assert parts[1].known["shift_x_view1"] == 0.01
    residual = study.residual(found)
    for number, drop in enumerate(drops):
        np.testing.assert_allclose(
            study.part_of(residual, number), drop.residual(study.part_of(found, number)), rtol=1e-9
        )


def test_rows_and_frames_keep_their_recording(study: StudyProblem, drops: list[KnownShape]):
    assert study.fitted.sum() == sum(drop.fitted.sum() for drop in drops)
    assert study.video.view_ids == (1000, 1001, 1002, 1003, 2000, 2001, 2002, 2003)
    layout = study.layout(study.fitted)
    assert not set(layout.frame[layout.view < SIZE.views]) & set(layout.frame[layout.view >= SIZE.views])
    stacked = study.join([np.ones((3, *drop.usable.shape)) for drop in drops], axis=1)
    assert np.isnan(stacked).sum() == 3 * SIZE.views * 11 * (drops[1].usable.shape[1] - SIZE.frames)
    difference = np.random.default_rng(0).standard_normal((2, *study.usable.shape))
    own = study.part_of(study.relative(difference), 1, axis=1)
    np.testing.assert_allclose(own, relative(study.part_of(difference, 1, axis=1)))


def test_a_spin_belongs_to_a_recording_and_a_material_to_all(study: StudyProblem):
    assert len(study.adopt(InitialSpin()).parameters) == 6
    threshold = divide(YieldStress(), study.names)
    for name in YieldStress.parameters:
        assert threshold.prior(f"{name}@high") == YieldStress().prior(name)
    assert study.adopt(LinearDrag()).parameters == LinearDrag.parameters


def test_a_coefficient_is_shared_and_a_measured_spin_is_not(drops: list[KnownShape], small_threads: None):
    """Each recording was fitted with the spin that it was measured to have; a candidate's is that of all."""
    spins = (5.0, 0.0, 0.0), (0.0, 0.0, -80.0)
    turning = [KnownShape(d.scene, d.setting, d.video, d.measured, d.noise) for d in drops]
    for drop, spin in zip(turning, spins, strict=True):
        drop.physics = with_effects(drop.physics, [Magnus(0.01, spin)], 1.0, 1.0)
    study = StudyProblem(turning, ["low", "high"])
    effects = study.physics.effects
    known = {**study.first_guess, "magnus": 0.02}
    model = study.model(effects, known)
    assert [name for name in model.names if name.startswith("magnus")] == ["magnus"]
    for part, spin in zip(study.parts(effects, known), spins, strict=True):
        (side,) = part.effects
        assert isinstance(side, Magnus) and side.spin == spin and part.known["magnus"] == 0.02
    divided = divide(Magnus(0.01), ["low", "high"])
    for part, spin in zip(study.parts([divided], {**known, "magnus@low": 0.1, "magnus@high": 0.3}), spins, strict=True):
        assert part.effects[0].constants == Magnus(spin=spin).constants
        assert part.known["magnus"] == {"low": 0.1, "high": 0.3}[part.name]
    candidate = StudyProblem(drops, ["low", "high"]).parts([Magnus(spin=(1.0, 2.0, 3.0))], known)
    assert {part.effects[0].constants["magnus_spin_y"] for part in candidate} == {2.0}


def test_every_recording_is_compared_with_its_own_first_contact(study: StudyProblem, drops: list[KnownShape]):
    model = study.model((), study.first_guess)
    parts = [part.model for part in study.parts((), study.first_guess)]
    each = [part.contact(part.start, 0.5) for part in parts]
    assert model.contact(model.start, 0.5) == min(each)
    assert study.split.last_fitted == drops[1].split.last_fitted
    assert without_contact(study) == []


def test_view_names():
    assert view_name(3) == "view 3" and view_name(2003) == "view 3 of recording 2"


def stiffer(setting: Setting) -> Setting:
    return replace(setting, material="Newtonian", guess={**setting.guess, "mu": 50.0, "kappa": 1e5})


def smaller(setting: Setting) -> Setting:
    return replace(setting, shape="Ball", arguments={"radius": 0.05})


@pytest.mark.parametrize(
    ("change", "said"), [(stiffer, "of one material: low has NeoHookean"), (smaller, "of one body")]
)
def test_recordings_of_different_objects(
    drops: list[KnownShape], change: Callable[[Setting], Setting], said: str, small_threads: None
):
    first = drops[0]
    other = KnownShape("other", change(first.setting), first.video, first.measured, first.noise)
    with pytest.raises(UserInputError, match=said) as error:
        StudyProblem([first, other], ["low", "high"])
    assert "\n" not in str(error.value)


def test_one_recording_or_one_name(drops: list[KnownShape], small_threads: None):
    with pytest.raises(UserInputError, match="at least two recordings"):
        StudyProblem(drops[:1], ["low"])
    with pytest.raises(UserInputError, match="two recordings are called low"):
        StudyProblem(drops, ["low", "low"])


def test_an_effect_without_coefficients_is_not_divided():
    class Nothing(LinearDrag):
        parameters = {}  # noqa: RUF012

    with pytest.raises(UserInputError, match="Nothing has no coefficient"):
        divide(Nothing.__new__(Nothing), ["low", "high"])


def test_a_recording_without_contact(drops: list[KnownShape], small_threads: None):
    flying = replace(drops[0].setting, guess={**drops[0].setting.guess, "v_y": 5.0})
    other = KnownShape("other", flying, drops[0].video, drops[0].measured, drops[0].noise)
    sentences = without_contact(StudyProblem([drops[0], other], ["low", "thrown"]))
    assert len(sentences) == 1 and sentences[0].startswith("thrown: the body does not reach the ground")
