"""Plans of scenes, and what the scorer makes of results that are written by hand."""

import json
from collections import Counter
from pathlib import Path

import pytest

from benchmarks.hidden_effects.known_shape import SETTING, TRUTH
from benchmarks.hidden_effects.outcomes import Outcome, outcome
from benchmarks.hidden_effects.plan import DEVELOPMENT, PHYSICS, SCORED, plan
from benchmarks.hidden_effects.run import EFFORT, FAILURE
from benchmarks.hidden_effects.score import page, share


def test_two_hundred_scenes_hold_what_the_figures_need():
    plans = [plan(seed) for seed in range(SCORED.start, SCORED.start + 200)]
    counts = Counter((p.family, p.snr) for p in plans)
    assert counts["null", 0.0] >= 59  # no false alarm in 59 bounds their rate by 5 % at 95 %: 0.95^59 = 0.0485
    assert counts["single", 20.0] == 60 and counts["single", 7.0] == 20 and counts["single", 3.0] == 10
    assert {p.effects[0] for p in plans if p.family == "single" and p.snr == 20} == set(PHYSICS)
    assert all(len(set(p.effects)) == 2 for p in plans if p.family == "pair")
    assert not set(DEVELOPMENT) & set(SCORED)


def candidate(name: str) -> dict:
    return {"name": name, "z": 1.0}


def interval(low: float, value: float, high: float) -> dict:
    return {"low": low, "value": value, "high": high}


def parameters(E: float) -> list[dict]:
    return [{"name": "E", **interval(0.9 * E, E, 1.1 * E)}, {"name": "v_x", **interval(0.1, 0.2, 0.3)}]


def refit(name: str, misfit: float, removed: float, **values: dict) -> dict:
    values = {**{entry["name"]: entry for entry in parameters(1e5)}, **values}
    return {"name": name, "misfit": misfit, "removed": removed, "values": values}


def write(
    scene: Path, truth: dict, rounds: list[dict] | None, kind: str = "missing", rest: bool = False
) -> Outcome | None:
    (scene / "diagnosis").mkdir(parents=True)
    (scene / SETTING).write_text("{}")
    (scene / TRUTH).write_text(json.dumps({"values": {"E": 1e5, "v_x": 0.5}, "snr": 20.0, "seed": 1001, **truth}))
    if rounds is None:
        (scene / FAILURE).write_text("unstable")
    else:
        (scene / EFFORT).write_text(json.dumps({"cpu_seconds": 60.0}))
        result = {"verdict": {"kind": kind, "rest": rest}, "rounds": rounds}
        (scene / "diagnosis" / "diagnosis.json").write_text(json.dumps(result))
    return outcome(scene)


def round_of(refits: list[dict], accepted: str | None, groups: list[list[str]], names: list[str], p: float) -> dict:
    return {
        "parameters": parameters(5e4),
        "refits": refits,
        "accepted": accepted,
        "screen": {"groups": groups, "candidates": [candidate(name) for name in names]},
        "omnibus": {"p_value": p},
    }


DRAG = {"family": "single", "hidden": [{"name": "LinearDrag", "values": {"drag": 1.0}, "null": {"drag": 0.0}}]}


def test_a_found_effect_is_scored(tmp_path):
    refits = [
        refit("QuadraticDrag", 100.0, 0.7, drag_per_length=interval(0.1, 0.2, 0.3)),
        refit("LinearDrag", 110.0, 0.8, drag=interval(0.8, 0.9, 0.95)),
        refit("GroundFriction", 90.0, 0.1),
    ]
    names = ["UniformForce", "GravityMagnitude", "LinearDrag"]
    found = write(tmp_path / "1001", DRAG, [round_of(refits, "QuadraticDrag", [], names, 0.3)])
    assert found.ranking == ("QuadraticDrag", "GroundFriction", "LinearDrag", "UniformForce", "GravityMagnitude")
    assert found.found("LinearDrag") and found.within(1) and not found.within(1, exact=True)
    assert not found.within(2, exact=True) and found.within(3, exact=True)
    assert found.coefficients == (False,) and found.coefficient_error == pytest.approx(0.1)
    assert found.removed == pytest.approx(0.7)
    assert found.bias == pytest.approx((0.30103, 0.0), abs=1e-5)  # log10 of 1e5 / 5e4 before, then E = 1e5
    assert found.base == (False, False)


def test_classes_count_once_in_the_ranking(tmp_path):
    names = ["GravityMagnitude", "UniformForce", "CentralForce", "QuadraticDrag"]
    groups = [["GravityMagnitude", "UniformForce"]]
    found = write(tmp_path / "1001", DRAG, [round_of([], None, groups, names, 0.3)], "nothing")
    assert found.within(3) and not found.within(3, exact=True) and not found.within(2)
    assert found.removed is None and not found.found("LinearDrag")


def test_an_effect_that_explains_too_little_is_not_a_finding(tmp_path):
    first = round_of([refit("LinearDrag", 1.0, 0.3, drag=interval(0.5, 1.0, 1.5))], "LinearDrag", [], [], 0.01)
    found = write(tmp_path / "1001", DRAG, [first, round_of([], None, [], [], 0.01)], "unknown")
    assert found.accepted == () and found.removed is None and not found.found("LinearDrag")
    assert found.within(1)


def test_two_effects_remove_together_and_what_is_left_is_noticed(tmp_path):
    first = round_of([refit("LinearDrag", 1.0, 0.5, drag=interval(0.5, 1.0, 1.5))], "LinearDrag", [], [], 0.01)
    second = round_of([refit("InitialSpin", 1.0, 0.4)], "InitialSpin", [], [], 0.01)
    last = round_of([], None, [], [], 0.01)
    found = write(tmp_path / "1001", DRAG, [first, second, last], rest=True)
    assert found.removed == pytest.approx(1 - 0.5 * 0.6)
    assert found.unexplained and found.coefficients == (True,)


def test_intervals_are_those_of_the_last_table(tmp_path):
    first = round_of([refit("LinearDrag", 1.0, 0.9, drag=interval(0.7, 0.8, 0.9))], "LinearDrag", [], [], 0.01)
    last = round_of([], None, [], [], 0.7)
    last["parameters"] = [
        {"name": "E", **interval(0.9e5, 1e5, 1.1e5)},
        {"name": "v_x", **interval(0.6, 0.7, 0.8)},
        {"name": "drag", **interval(0.8, 0.9, 1.1)},
    ]
    found = write(tmp_path / "1001", DRAG, [first, last])
    assert (found.coefficients, found.stated, found.base_stated) == ((False,), (True,), (True, False))
    assert f"| {share([True])} | {share([False])} | {share([True, False])} |" in page([found], "command", "")
    other = write(tmp_path / "1003", DRAG, [first, last], "unknown")
    assert (other.coefficients, other.stated, other.base_stated) == ((False,), (), ())


def test_a_doubtful_reconstruction_is_counted_beside_the_false_alarms(tmp_path):
    nothing = {"family": "null", "hidden": []}
    quiet = write(tmp_path / "1000", nothing, [round_of([], None, [], [], 0.7)], "nothing")
    doubtful = write(tmp_path / "1002", nothing, [round_of([], None, [], [], 0.01)], "nothing", rest=True)
    assert (quiet.in_doubt, doubtful.in_doubt) == (False, True)
    text = page([quiet, doubtful], "command", "")
    assert "| null: anything but *nothing is missing* | 0/2" in text
    assert "| null: *nothing is missing*, but the reconstruction in doubt | 1/2" in text


def test_strangers_are_counted_apart_from_those_that_known_effects_imitate(tmp_path):
    gust = {"name": "Gust", "values": {"gust": 9.0}, "null": {"gust": 0.0}}
    first = round_of([refit("UniformForce", 1.0, 0.9)], "UniformForce", [], [], 0.01)
    strange = {"family": "outside", "hidden": [{**gust, "snr": 55.0, "beyond": 19.0}]}
    clear = write(tmp_path / "1006", strange, [first, round_of([], None, [], [], 0.001)], rest=True)
    alike = write(tmp_path / "1016", {"family": "outside", "hidden": [gust]}, [first, round_of([], None, [], [], 0.7)])
    assert (clear.beyond, alike.beyond) == (19.0, None)
    text = page([clear, alike], "command", "")
    rest = "that, or an effect accepted and the rest declared more than noise"
    assert f"| outside the catalogue: {rest} | 1/1" in text
    assert f"| outside, 20 sigma beside material and velocity alone: {rest} | 0/1" in text
    assert "| outside the catalogue: a known effect accepted | 1/1" in text


def test_camera_classes_are_of_one_view():
    found = Outcome(1, "camera", 20.0, False, ("CameraShift@2",), "camera", accepted=("CameraRotation@2",))
    assert found.found("CameraShift@2")
    assert not found.found("CameraShift@3")
    assert not found.found("CameraDrift@2")


def test_failures_count_as_wrong_and_unfinished_scenes_not_at_all(tmp_path):
    null = {"family": "null", "hidden": [], "snr": 0.0}
    failed = write(tmp_path / "1000", null, None)
    assert failed.kind == "failed"
    assert "| null: an effect accepted | 1/1" in page([failed], "command", "")
    (tmp_path / "1000" / FAILURE).unlink()
    assert outcome(tmp_path / "1000") is None


def test_the_page_says_which_seeds_it_is_about():
    scored, tuned = (Outcome(seed, "null", 0.0, False, (), "nothing") for seed in (SCORED.start, DEVELOPMENT.start))
    assert "scored seeds" in page([scored], "command", "") and "development seeds" in page(
        [tuned, scored], "command", ""
    )


def test_shares_have_exact_intervals():
    """No event in 59: the upper end of the two-sided 95 % interval is 1 - 0.025^(1/59) = 6.1 %."""
    assert share([False] * 59) == "0/59 = 0% [0%, 6%]"
    assert share([]) == "-"
