"""A session as a script uses it: change, look, undo, compare; clear errors; several recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.errors import Stopped, UserInputError
from pacnerf_lpo.explore import Session
from tests.data.trajectories.throws import BALL, write_drops
from tests.diagnosis.falling import CENTRE, FRAMES, GUESS, RADIUS, SIZE, SPACING, VIEWS, install
from tests.explore.falling import DRAG, session_of, study_of


def test_a_change_moves_the_body_and_its_error(falling: Session):
    first = falling.current
    assert first.values == GUESS and first.effects == () and first.resolution == "coarse"
    step = falling.set("drag", DRAG)
    assert step.name == "LinearDrag 2 1/s" and step.effects == ("LinearDrag",) and step.parent == first.number
    better = falling.set({"E": 6e4, "v_x": 0.4, "v_y": -1.0, "v_z": 0.2})
    assert better.name.startswith("E 6e+04 Pa, v_x 0.4 m/s")
    assert better.held_out < 0.5 * first.held_out and better.fitted < 0.5 * first.fitted
    fine = falling.refine()
    assert fine.number == better.number and fine.resolution == "refined" and fine.held_out < better.held_out
    assert len(falling.motion().positions[0]) > len(falling.motion(first.number).positions[0])


def test_errors_by_camera_and_frame_are_those_of_the_steps(falling: Session):
    step, found = falling.current, falling.error()
    assert found.unit == "px" and found.table.shape == found.held.shape == (VIEWS, FRAMES)
    assert found.held[2].all() and found.held[:, -2:].all() and not found.held[0, :-2].any()
    for mask, mean in ((found.held, step.held_out), (~found.held, step.fitted)):
        assert mean == pytest.approx(np.sqrt(np.nanmean(found.table[mask] ** 2)))
    late = np.sqrt(np.nanmean(found.table[:, -1] ** 2))
    assert found.by_frame_held_out[-1] == pytest.approx(late) and np.isnan(found.by_frame_fitted[-1])
    assert found.rows[2] == "view 2" and found.floor is None


def test_what_a_person_looks_at(falling: Session):
    falling.set("drag", DRAG)
    moving = falling.motion()
    assert moving.positions.shape == (FRAMES, moving.positions.shape[1], 3) and moving.speed.max() < 10
    wide = np.ptp(moving.positions[..., 0], axis=1) / np.ptp(moving.positions[0, :, 0])
    assert wide.max() > 1.03, "the ball is flat where it touches, and flat everywhere"
    np.testing.assert_allclose(falling.stretch(), np.broadcast_to(wide[:, None], moving.speed.shape), rtol=1e-3)
    outline = falling.outlines(1, 7)
    assert outline.measured.shape == outline.model.shape == (SIZE, SIZE)
    assert 0.3 < np.abs(outline.residual).max() <= 1, "with another velocity it is elsewhere"
    area = [np.abs((o.measured > 0.5) ^ (o.model > 0.5)).sum() for o in (falling.outlines(v, 7) for v in range(VIEWS))]
    assert falling.particle_errors()[7].sum() == pytest.approx(np.mean(area))
    sides = falling.regions()
    assert sum(sides.values()) == pytest.approx(falling.particle_errors().sum(1))
    hull = falling.measured(0)
    assert np.abs(hull.hull.mean(0) - CENTRE).max() < 0.04
    assert np.ptp(hull.hull, axis=0) == pytest.approx(2 * RADIUS, abs=0.15), "of four cameras, a pixel is 4 cm"
    assert [camera.held_out for camera in falling.cameras()] == [False, False, True, False]


def test_undo_redo_and_any_two_steps(falling: Session):
    first, drag = falling.current, falling.set("drag", 1.0)
    soft = falling.set("E", 5e4)
    assert falling.undo().number == drag.number and falling.undo().number == first.number
    with pytest.raises(UserInputError, match="first step"):
        falling.undo()
    assert falling.redo().number == drag.number and falling.redo().number == soft.number
    with pytest.raises(UserInputError, match="nothing to redo"):
        falling.redo()
    falling.undo()
    other = falling.set("E", 7e4)
    assert other.parent == drag.number and [step.number for step in falling.steps] == [0, 1, 2, 3]
    found = falling.compare(first.number, other.number)
    assert found.changed == {"E": (9e4, 7e4), "drag": (None, 1.0)}
    assert found.held_out == (first.held_out, other.held_out)
    tables = [falling.error(number).table for number in (first.number, other.number)]
    np.testing.assert_allclose(found.change, tables[1] - tables[0], atol=1e-5)


def test_a_moving_hand_makes_one_step(falling: Session):
    for value in (0.5, 1.0, 1.5):
        step = falling.set("drag", value, dragging=True)
    assert len(falling.steps) == 2 and step.values["drag"] == 1.5 and step.parent == 0
    assert falling.error().held_out == pytest.approx(step.held_out)
    falling.set("E", 5e4, dragging=True)
    falling.set("drag", 1.0, dragging=True)
    assert [s.number for s in falling.steps] == [0, 1, 2, 3]


def test_effects_come_and_go(falling: Session):
    added = falling.add("LinearDrag", {"drag": 1.0})
    assert added.name == "+ LinearDrag 1 1/s"
    sliders = {setting.name: setting for setting in falling.settings}
    assert sliders["drag"].active and sliders["drag"].low == 0 and sliders["drag"].slider == (0.0, 3.0)
    assert not sliders["push_x"].active and sliders["push_x"].value == 0 == sliders["push_x"].null
    assert sliders["E"].logarithmic and sliders["E"].slider[0] < 9e4 < sliders["E"].slider[1]
    assert sliders["shift_x_view1"].group == "CameraShift@1"
    gone = falling.remove("LinearDrag")
    assert gone.values == GUESS and gone.held_out == pytest.approx(falling.steps[0].held_out)
    unchanged = falling.set("drag", 0.0)
    assert unchanged.effects == () and "drag" not in unchanged.values


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda s: s.set("dragg", 1.0), "no setting dragg; did you mean drag"),
        (lambda s: s.set("drag", float("nan")), "not a possible drag rate"),
        (lambda s: s.set("drag", "fast"), "give a number"),
        (lambda s: s.set("drag", -1.0), "where LinearDrag vanishes"),
        (lambda s: s.set({"E": 5e4, "nu": 0.7}), "not a possible Poisson's ratio"),
        (lambda s: s.set({}), "at least one setting"),
        (lambda s: s.add("Drag"), "no effect Drag; did you mean"),
        (lambda s: s.add("LinearDrag", {"push_x": 1.0}), "LinearDrag has no push_x; it has drag"),
        (lambda s: s.add("nowhere.Lorentz"), "nowhere.Lorentz cannot be imported"),
        (lambda s: s.remove("Magnus"), "the model has no Magnus"),
        (lambda s: s.fit([]), "tick at least one"),
        (lambda s: s.fit(["drag"]), "which the model has not"),
        (lambda s: s.go_to(7), "no step 7; give 0 to 0"),
        (lambda s: s.error(True), "no step True"),
        (lambda s: s.outlines(9, 0), "no camera 9; it has 0, 1, 2, 3"),
        (lambda s: s.outlines(1, FRAMES), "no frame 9; give a number from 0 to 8"),
        (lambda s: s.motion(recording="high"), "no recording high; there are falling"),
    ],
)
def test_mistakes_say_what_is_wrong_and_change_nothing(falling: Session, call, said: str):
    with pytest.raises(UserInputError, match=said):
        call(falling)
    assert len(falling.steps) == 1 and falling.current.effects == () and not falling.busy


def test_a_second_ground_does_not_fit(falling: Session):
    falling.add("GroundFriction", {"ground_friction": 0.3})
    with pytest.raises(UserInputError, match="Adhesion cannot be added to a model with GroundFriction"):
        falling.add("Adhesion")


def test_an_unstable_motion_stays_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    install(monkeypatch, lambda model, free: model.physical(free).get("drag", 0.0) > 5)
    session = session_of(tmp_path)
    step = session.set("drag", 6.0)
    assert "made unstable by a test" in step.trouble and step.fitted is None and session.current == step
    assert session.refine() == step
    with pytest.raises(UserInputError, match=r"step 1, LinearDrag 6 1/s, has no motion: .*made unstable"):
        session.error()
    assert np.isnan(session.compare(0, 1).change).all()
    assert session.set("drag", 2.0).trouble is None and len(session.steps) == 3


def test_a_fine_motion_that_is_unstable_leaves_the_coarse_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    install(monkeypatch, lambda model, free: model.body.spacing < 1.2 * SPACING)
    session = session_of(tmp_path, {})
    before = session.current
    after = session.refine()
    assert after.resolution == "coarse" and after.held_out == before.held_out
    assert "on the fine body the motion is unstable" in after.notes[0]


def test_a_body_that_is_out_of_sight_is_said_to_be(falling: Session):
    step = falling.set("v_x", 30.0)
    assert step.notes and "out of sight" in step.notes[0]
    assert not falling.set("v_x", 0.4).notes


def test_several_recordings_share_the_material_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    install(monkeypatch)
    session = study_of(tmp_path)
    assert session.recordings == ("low", "high") and len(session.cameras("high")) == VIEWS
    first = session.current
    sliders = {setting.name: setting for setting in session.settings}
    assert sliders["E"].recording is None and sliders["v_x@high"].recording == "high"
    step = session.set("v_y@high", -1.0)
    before, after = session.error(first.number), session.error(step.number)
    own = np.array([name == "low" for name in before.recordings])
    np.testing.assert_array_equal(before.table[own], after.table[own])
    assert (np.nan_to_num(before.table[~own]) != np.nan_to_num(after.table[~own])).any()
    assert before.rows[VIEWS] == "view 0 of high"
    still = [session.motion(n, "low").positions for n in (first.number, step.number)]
    np.testing.assert_array_equal(*still)
    assert session.outlines(1, 2, recording=1).model.shape == (SIZE, SIZE)
    assert "LinearDrag" in session.overlay(session.set("drag", 2.0).number, "high")


def test_stop_without_a_question_does_no_harm(falling: Session):
    falling.stop()
    falling.set("drag", 1.0)
    with pytest.raises(Stopped):
        falling.suggest(stop=lambda: True)
    assert not falling.busy


@pytest.mark.slow
def test_measured_flights_have_no_cameras(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Balls that fall with a drag that grows with the square of the speed, made by another integrator."""
    scenes = tmp_path / "scenes"
    assert main(["init", str(write_drops(tmp_path / "ball.csv", 0.02)), str(scenes), *BALL]) == 0
    session = Session.open(scenes, jobs=1)
    assert session.unit == "mm" and len(session.recordings) == 2 and session.cameras(0) == []
    assert not any(setting.group == "ground" for setting in session.settings)
    assert session.measured(3).centre.shape == (3,) and not len(session.measured(3).hull)
    best = session.suggest()[0]
    session.add(best.effect, best.values)
    starts = [setting.name for setting in session.settings if setting.group == "motion"]
    fitted = session.fit([*best.values, *starts])
    assert fitted.held_out < session.steps[0].held_out / 2
    assert (session.stretch() == 1).all() and not session.particle_errors().any()
    kept = session.save(session.folder)
    assert Session.open(kept.parent).steps == session.steps
