"""Diagnosis of measured flights, by the commands: recordings made by another integrator, with noise."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml

from pacnerf_lpo.__main__ import main
from pacnerf_lpo.data.trajectories.scene import scenes_in
from pacnerf_lpo.diagnosis.flight_problem import problem_of_flight, problem_of_flights
from pacnerf_lpo.identification.base_fit import base_fit
from pacnerf_lpo.mpm.effects import LinearDrag, Magnus, QuadraticDrag
from pacnerf_lpo.mpm.materials.rigid import Rigid
from pacnerf_lpo.mpm.rigid_body import fly
from tests.data.trajectories.throws import BALL, flight, write, write_drops, write_throws

pytestmark = pytest.mark.slow


def diagnosed(source: Path, *options: str) -> dict:
    """What init and diagnose say of a source of positions."""
    scene = source.parent / f"{source.stem}_scene"
    assert main(["init", str(source), str(scene), *BALL, *options]) == 0
    assert main(["diagnose", str(scene), "--replicates", "8", "--jobs", "1"]) == 0
    page = (scene / "diagnosis" / "diagnosis.html").read_text()
    assert "measured less model" in page and "flight-charts" in page
    return json.loads((scene / "diagnosis" / "diagnosis.json").read_text())


def interval(result: dict, name: str) -> tuple[float, float]:
    last = result["rounds"][-1]["parameters"]
    return next((p["low"], p["high"]) for p in last if p["name"] == name)


def test_the_flight_agrees_with_closed_forms_and_with_another_integrator():
    """Free fall with linear drag is known exactly; the tolerance is that of a step times their number (about 20)."""
    times = np.linspace(0.0, 1.0, 11)
    start = np.array([0.0, 10.0, 0.0]), np.array([3.0, 1.0, -2.0])
    found = fly([LinearDrag()], {"drag": 0.7}, (0.0, -9.81, 0.0), start, (0.0, 0.0, 0.0), times)
    decay = (1 - np.exp(-0.7 * times)) / 0.7
    exact = start[0] + decay[:, None] * start[1] + ((decay - times) / 0.7)[:, None] * [0.0, 9.81, 0.0]
    np.testing.assert_allclose(found, exact, atol=5e-6)
    effects, values, spin = [QuadraticDrag(), Magnus()], {"drag_per_length": 0.14, "magnus": 3e-3}, (10.0, -120.0, 60.0)
    found = fly(effects, values, (0.0, -9.81, 0.0), start, spin, times)
    other = flight(times, tuple(start[0]), tuple(start[1]), drag=0.14, magnus=3e-3, spin=spin)
    np.testing.assert_allclose(found, other, atol=1e-5)  # midpoint steps of 1e-4 s


def test_a_spin_that_was_stated_for_the_effect_counts_as_that_of_the_body():
    times, start = np.linspace(0.0, 0.5, 6), (np.zeros(3), np.array([5.0, 3.0, 0.0]))
    spin, still, g = (0.0, 0.0, 90.0), (0.0, 0.0, 0.0), (0.0, -9.81, 0.0)
    own = fly([Magnus()], {"magnus": 5e-3}, g, start, spin, times)
    given = fly([Magnus(spin=spin)], {"magnus": 5e-3}, g, start, still, times)
    np.testing.assert_allclose(own, given, atol=1e-9)


def test_an_interrupted_diagnosis_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    """Ctrl-C after the first round, and the same command again: what was done is read, not computed."""
    scene = tmp_path / "scene"
    assert main(["init", str(write_drops(tmp_path / "ball.csv", 0.02)), str(scene), *BALL]) == 0
    command = ["diagnose", str(scene), "--replicates", "8", "--jobs", "1", "--until", "screen"]

    def interrupted(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as pressed:
        pressed.setattr("pacnerf_lpo.commands.diagnose.write", interrupted)
        assert main(command) == 130
    said = capsys.readouterr().err.splitlines()[-1]
    assert "interrupted; the same command goes on after the steps" in said and str(scene / "diagnosis") in said
    assert list((scene / "diagnosis" / "steps").iterdir())
    again = lambda *_: pytest.fail("the comparison was done twice")  # noqa: E731
    monkeypatch.setattr("pacnerf_lpo.diagnosis.diagnose.compare", again)
    assert main(command) == 0


@pytest.mark.parametrize("drag", [0.0, 0.02])
def test_drag_is_named_in_drops_that_have_it_and_a_late_release_is_none(tmp_path, drag):
    result = diagnosed(write_drops(tmp_path / "ball.csv", drag))
    if drag:
        assert result["verdict"]["effects"] == ["QuadraticDrag"]
        low, high = interval(result, "drag_per_length")
        assert low < drag < high < 2 * drag
    else:
        assert result["verdict"]["kind"] == "nothing"
    for name, release in (("ball_1", 0.21), ("ball_2", 0.12)):
        low, high = interval(result, f"release@{name}")
        assert low < release < high and high - low < 0.1
    assert all(f["measured"][0][0] is None and f["models"][0][1][0] is not None for f in result["flights"])


def test_drag_and_then_the_force_by_spin_are_named_in_throws(tmp_path):
    spins = write_throws(tmp_path / "throws", 5, drag=0.15, magnus=4e-3)
    result = diagnosed(tmp_path / "throws", "--spins", str(spins))
    assert result["verdict"]["effects"] == ["QuadraticDrag", "Magnus"]
    for name, true in [("drag_per_length", 0.15), *((f"magnus@{number:03d}", 4e-3) for number in range(5))]:
        low, high = interval(result, name)
        assert low < true < high
    assert any(detail.startswith("Direction of the force by spin") for detail in result["verdict"]["details"])


def test_a_spin_that_was_measured_with_the_wrong_sense_shows(tmp_path):
    """By the direction of the force."""
    spins = write_throws(tmp_path / "throws", 6, drag=0.15, magnus=8e-3)
    head, *rows = spins.read_text().splitlines()
    name, *parts = rows[1].split(",")
    rows[1] = ",".join([name, *(str(-float(part)) for part in parts)])
    spins.write_text("\n".join([head, *rows]) + "\n")
    result = diagnosed(tmp_path / "throws", "--spins", str(spins))
    assert set(result["verdict"]["effects"]) == {"QuadraticDrag", "Magnus"}
    signs = [1, -1, 1, 1, 1, 1]
    for name, true in [("drag_per_length", 0.15), *((f"magnus@{n:03d}", 8e-3 * sign) for n, sign in enumerate(signs))]:
        low, high = interval(result, name)
        assert low < true < high
    sides = [flight["side"] for flight in result["flights"]]
    clear = [(side["angle"], sign) for side, sign in zip(sides, signs, strict=True) if side["size"] > 3 * side["error"]]
    assert len(clear) >= 2 and all(angle < 45 if sign > 0 else angle > 135 for angle, sign in clear)
    assert any(detail.startswith("Direction of the force by spin") for detail in result["verdict"]["details"])


def test_noise_that_lasts_is_known_and_not_learnt_from_replicates(tmp_path):
    """The covariance of the noise model is that of the scene, in every recording of a study by itself."""
    write_drops(tmp_path / "ball.csv", 0.0)
    assert main(["init", str(tmp_path / "ball.csv"), str(tmp_path / "scene"), *BALL]) == 0
    study, _ = problem_of_flights(scenes_in(tmp_path / "scene"), ())
    own, shared = (values[study.usable] for values in study.noise_parts(study.sensor))
    found = own @ own.T * np.eye(len(own)) + shared @ shared.T
    at = 0
    for part in study.parts((), study.first_guess):
        flight = part.recording.flight
        expected = 1e6 * flight.noise[1].covariance(flight.times)
        size = len(flight.times)
        np.testing.assert_allclose(found[at : at + size, at : at + size], expected, atol=1e-6 * expected.max())
        at += size


def test_a_body_may_be_let_go_before_the_first_sample(tmp_path):
    times = np.arange(0.1, 2.6, 1 / 15)
    heights = flight(times, (0.0, 40.0, 0.0))[:, 1] + 0.01 * np.random.default_rng(0).standard_normal(len(times))
    write(tmp_path / "ball.csv", {"time_s": times - 0.1, "height_m": heights})
    assert main(["init", str(tmp_path / "ball.csv"), str(tmp_path / "scene"), *BALL]) == 0
    problem = problem_of_flight(scenes_in(tmp_path / "scene")[0])
    found = base_fit(problem, (), problem.first_guess).known
    assert found["release"] == pytest.approx(-0.1, abs=0.03)
    assert found["y_0"] == pytest.approx(40.0, abs=0.05)


def test_nothing_is_named_in_throws_without_air(tmp_path):
    spins = write_throws(tmp_path / "throws", 4, drag=0.0, magnus=0.0, seed=3)
    assert diagnosed(tmp_path / "throws", "--spins", str(spins))["verdict"]["kind"] == "nothing"


def test_a_study_has_the_starts_of_every_flight_and_coefficients_in_common(tmp_path):
    write_drops(tmp_path / "ball.csv", 0.0)
    assert main(["init", str(tmp_path / "ball.csv"), str(tmp_path / "scene"), *BALL]) == 0
    folders = scenes_in(tmp_path / "scene")
    study, _ = problem_of_flights(folders, ())
    names = study.model([study.adopt(QuadraticDrag())], {**study.first_guess, "drag_per_length": 0.0}).names
    assert names == ("drag_per_length", "y_0@ball_1", "release@ball_1", "y_0@ball_2", "release@ball_2")
    probes = [probe["drag_per_length"] for probe in study.adopt(QuadraticDrag()).probes]
    assert max(probes) < 0.1  # a path of 30 m, where that of a video is 1 m
    one = problem_of_flight(folders[0])
    assert not one.usable[..., [0, 2]].any() and one.usable[..., 1].all()
    assert isinstance(one.physics.material, Rigid) and not one.deforms


def test_runs_cannot_be_mixed_with_flights_and_options_of_videos_are_refused(tmp_path, capsys):
    write_drops(tmp_path / "ball.csv", 0.0)
    assert main(["init", str(tmp_path / "ball.csv"), str(tmp_path / "scene"), *BALL]) == 0
    (tmp_path / "run").mkdir()
    assert main(["diagnose", str(tmp_path / "scene"), str(tmp_path / "run"), "--out", str(tmp_path / "out")]) == 2
    assert "is no scene of a measured flight" in capsys.readouterr().err
    assert main(["diagnose", str(tmp_path / "scene"), "--images", "false"]) == 2
    assert "are for runs" in capsys.readouterr().err
    path = tmp_path / "scene" / "ball_1" / "scene.yaml"
    content = yaml.safe_load(path.read_text())
    content["physics"]["effects"] = [{"class_path": "NoSuchEffect"}]
    path.write_text(yaml.safe_dump(content))
    assert main(["diagnose", str(tmp_path / "scene")]) == 2
    assert "a class of your own has its module before it, MODULE.NoSuchEffect" in capsys.readouterr().err
