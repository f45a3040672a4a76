"""Plans of scenes, and what the scorer makes of results that are written by hand."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from validation.hidden_effects.known_shape import SETTING, TRUTH
from validation.hidden_effects.outcomes import Outcome, outcome
from validation.hidden_effects.plan import DEVELOPMENT, PHYSICS, SCORED, plan
from validation.hidden_effects.run import EFFORT, FAILURE
from validation.hidden_effects.score import compact, page, share, together, written


def test_two_hundred_scenes_hold_what_the_figures_need():
    plans = [plan(seed) for seed in range(SCORED.start, SCORED.start + 200)]
    counts = Counter((p.family, p.snr) for p in plans)
    assert counts["null", 0.0] >= 59  # no false alarm in 59 bounds their rate by 5 % at 95 %: 0.95^59 = 0.0485
    assert counts["single", 20.0] == 60 and counts["single", 7.0] == 20 and counts["single", 3.0] == 10
    assert {p.effects[0] for p in plans if p.family == "single" and p.snr == 20} == set(PHYSICS)
    assert all(len(set(p.effects)) == 2 for p in map(plan, SCORED) if p.family == "pair")
    assert not set(DEVELOPMENT) & set(SCORED)


def interval(name: str, low: float, value: float, high: float) -> dict:
    return {"name": name, "low": low, "value": value, "high": high}


def scored(name: str, factor: float, p_value: float = 0.5, **more: float) -> dict:
    return {"name": name, "log_bayes_factor": factor, "p_value": p_value, **more}


TABLE = [interval("E", 0.9e5, 1e5, 1.1e5), interval("nu", 0.1, 0.15, 0.2), interval("v_x", 0.1, 0.2, 0.3)]
FORCE = {"UnknownForce": {"log_bayes_factor": 1.0, "p_value": 0.04}}
VALUES = {"E": 1e5, "nu": 0.3, "v_x": 0.2}
DRAG = {"name": "LinearDrag", "values": {"drag": 1.0}, "null": {"drag": 0.0}}
WIND = {
    "name": "UniformForce",
    "values": {"push_x": 2.0, "push_z": 0.0},
    "null": {"push_x": 0.0, "push_z": 0.0},
}


def round_of(
    accepted: str | None = None,
    indistinguishable: tuple[str, ...] = (),
    refits: tuple[dict, ...] = (),
    candidates: tuple[dict, ...] = (),
    table: tuple[dict, ...] = (),
) -> dict:
    screen = {"candidates": list(candidates), "discrepancies": FORCE}
    parameters = [*TABLE, *table]
    return {
        "parameters": parameters,
        "refits": list(refits),
        "accepted": accepted,
        "indistinguishable": list(indistinguishable),
        "screen": screen,
    }


def write(
    scene: Path,
    family: str,
    hidden: list[dict],
    rounds: list[dict] | None,
    kind: str,
    *effects: str,
    more_than_noise: bool = False,
) -> Outcome:
    (scene / "diagnosis").mkdir(parents=True)
    (scene / SETTING).write_text("{}")
    truth = {"seed": int(scene.name), "family": family, "snr": 20.0 if hidden else 0.0, "values": VALUES}
    (scene / TRUTH).write_text(json.dumps({**truth, "hidden": hidden}))
    if rounds is None:
        (scene / FAILURE).write_text("unstable")
    else:
        (scene / EFFORT).write_text(json.dumps({"cpu_seconds": 60.0}))
        verdict = {"kind": kind, "effects": list(effects), "nearest": [], "more_than_noise": more_than_noise}
        (scene / "diagnosis" / "diagnosis.json").write_text(json.dumps({"verdict": verdict, "rounds": rounds}))
    found = outcome(scene)
    assert found is not None
    return found


def record(outcomes: list[Outcome]) -> dict:
    return {"date": "today", "commit": "0", "machine": "this", "note": "", "outcomes": compact(outcomes)}


def rows(outcomes: list[Outcome]) -> list[str]:
    return page(record(outcomes)).splitlines()


FIRST = round_of(
    "QuadraticDrag",
    ("QuadraticDrag", "LinearDrag"),
    (scored("LinearDrag", 31.0, 1.23456e-6, log_odds=-1.0), scored("QuadraticDrag", 30.0, 1e-5, log_odds=0.0)),
    (scored("GravityMagnitude", 25.0, 1e-4), scored("LinearDrag", 24.0), scored("UniformForce", 26.0)),
)
LAST = round_of(table=(interval("drag", 0.8, 0.9, 1.1),))


def test_an_effect_is_found_by_its_class(tmp_path):
    found = write(tmp_path / "1001", "single", [DRAG], [FIRST, round_of()], "missing", "QuadraticDrag")
    assert found.ranking == ("QuadraticDrag", "LinearDrag", "UniformForce", "GravityMagnitude")
    assert found.found("LinearDrag") and found.top(3) and not found.top(1)
    assert found.fitted == pytest.approx(1.23e-6, rel=1e-3)
    assert found.covered == {}  # another effect than the true one bends the material, and has no such coefficient
    text = rows([found])
    assert "### Single effects at 20 sigma: 1" in text
    assert f"| class named | {share([True])} |" in text and f"| named | {share([False])} |" in text
    assert f"| something else named, and not the class | {share([False])} |" in text
    assert not any("7 sigma" in line for line in text)


def test_intervals_are_those_of_the_last_table(tmp_path):
    first = {**FIRST, "accepted": "LinearDrag", "indistinguishable": ["LinearDrag"]}
    found = write(tmp_path / "1001", "single", [DRAG], [first, LAST], "missing", "LinearDrag")
    assert found.covered == {"drag": True, "E": True, "nu": False, "v_x": True} and found.hidden == ("drag",)
    text = rows([found])
    assert f"| hidden coefficients, where an effect was hidden | {share([True])} |" in text
    assert f"| material, where an effect was hidden | {share([True, False])} |" in text
    assert f"| velocity, where an effect was hidden | {share([True])} |" in text
    assert f"| named | {share([True])} |" in text


def test_an_unknown_cause_is_no_finding(tmp_path):
    found = write(tmp_path / "1001", "single", [DRAG], [FIRST, LAST], "unknown", more_than_noise=True)
    assert not found.found("LinearDrag") and found.named == () and found.inside("coefficient") == [True]


def test_a_pair_may_be_found_by_half(tmp_path):
    wind = round_of("UniformForce", ("UniformForce",))
    half = write(tmp_path / "1009", "pair", [DRAG, WIND], [wind, round_of()], "missing", "UniformForce")
    whole = write(
        tmp_path / "1029", "pair", [DRAG, WIND], [FIRST, wind, LAST], "missing", "QuadraticDrag", "UniformForce"
    )
    text = rows([half, whole])
    assert f"| classes of both named | {share([False, True])} |" in text
    assert f"| class of at least one named | {share([True, True])} |" in text
    assert whole.hidden == ("drag",)  # the second component of the wind is at its null; the first is in no table here


def test_nulls_are_false_alarms_or_not_and_their_p_values_are_tested(tmp_path):
    quiet = write(tmp_path / "1000", "null", [], [round_of(candidates=(scored("LinearDrag", 1.0, 0.6),))], "nothing")
    doubtful = write(tmp_path / "1002", "null", [], [round_of()], "nothing", more_than_noise=True)
    alarm = write(tmp_path / "1005", "null", [], [FIRST, LAST], "missing", "QuadraticDrag")
    unknown = write(tmp_path / "1010", "null", [], [round_of()], "unknown")
    failed = write(tmp_path / "1012", "null", [], None, "")
    assert quiet.p_value == quiet.fitted == 0.04  # of the unknown force
    assert alarm.p_value == 1e-4 and alarm.fitted == pytest.approx(1.23e-6, rel=1e-3)  # of a straight line; of a refit
    assert quiet.inside("material") == [True, False] and alarm.inside("material") == []
    text = rows([quiet, doubtful, alarm, unknown, failed])
    named = [False, False, True, False, True]
    assert f"| false alarm: an effect or a camera named | {share(named)} |" in text
    assert f"| false alarm: *none of the known effects* | {share([False, False, False, True, False])} |" in text
    assert f"| *nothing is missing*, but what is left is more than predicted | {share([0, 1, 0, 0, 0])} |" in text
    assert any(line.startswith("p-values of 4 nulls: median 0.04") for line in text)
    uniform = [replace(quiet, p_value=(k + 0.5) / 40) for k in range(40)]
    small = [replace(quiet, p_value=(k + 0.5) / 400) for k in range(40)]
    fine, bad = (next(line for line in rows(group) if "Kolmogorov" in line) for group in (uniform, small))
    # D = 1/80 for the middles of 40 steps, where exp(-2 * 40 D^2) = 0.99; 0.9 for values in the first tenth
    assert "D = 0.01 (p = 1);" in fine and "too many small ones: p = 0.98." in fine
    assert "D = 0.90" in bad and "(p = 1)" not in bad


def test_effects_outside_the_catalogue_are_counted_apart_from_those_that_known_effects_imitate(tmp_path):
    gust = {"name": "Gust", "values": {"gust": 9.0}, "null": {"gust": 0.0}}
    measured = [{**gust, "beyond": 19.04}]
    clear = write(tmp_path / "1006", "outside", measured, [FIRST, LAST], "missing", "LinearDrag", more_than_noise=True)
    alike = write(tmp_path / "1016", "outside", [gust], [FIRST, LAST], "missing", "LinearDrag")
    unknown = write(tmp_path / "1026", "outside", [{**gust, "beyond": 21.0}], [round_of()], "unknown")
    assert (clear.beyond, alike.beyond) == (19.0, None)
    text = rows([clear, alike, unknown])
    outside, imitated = (text.index(line) for line in text if line.startswith("### Outside"))
    assert f"| *none of the known effects* | {share([False, True])} |" in text[outside:imitated]
    either = "that, or an effect named and the rest declared more than predicted"
    assert f"| {either} | {share([True, True])} |" in text[outside:imitated]
    assert f"| {either} | {share([False])} |" in text[imitated:]


def test_failures_count_as_wrong_and_unfinished_scenes_not_at_all(tmp_path):
    failed = write(tmp_path / "1001", "single", [DRAG], None, "")
    assert failed.failed and f"| class named | {share([False])} |" in rows([failed])
    (tmp_path / "1001" / FAILURE).unlink()
    assert outcome(tmp_path / "1001") is None


def test_the_page_says_which_seeds_it_is_about():
    scored_, tuned = (Outcome(seed, "null", 0.0, None, (), "nothing") for seed in (SCORED.start, DEVELOPMENT.start))
    assert "scored seeds" in page(record([scored_]))
    assert "development seeds" in page(record([tuned, scored_]))


def test_intervals_that_contain_another_solver_are_counted_beside_those_of_this_one(tmp_path):
    wider = {**LAST, "parameters": [{**one, "with_solver": [0.05, 0.35]} for one in LAST["parameters"][1:2]]}
    found = write(tmp_path / "1001", "single", [DRAG], [FIRST, wider], "missing", "LinearDrag")
    assert found.covered == {"nu": True} and found.covered_alone == {"nu": False}
    text = rows([found])
    assert f"| material, where an effect was hidden | {share([True])} |" in text
    assert f"| material, where an effect was hidden; by this solver alone | {share([False])} |" in text


def test_a_draw_goes_on_and_what_was_found_again_is_as_found_last():
    first, second = (Outcome(seed, "null", 0.0, None, (), "nothing") for seed in (1001, 1003))
    again = replace(second, kind="unknown")
    later = [again, None, replace(first, views="3 views"), replace(first, seed=1002)]
    assert [(o.seed, o.views, o.kind) for o in together([first, second], later)] == [
        (1001, None, "nothing"), (1002, None, "nothing"), (1003, None, "unknown"), (1001, "3 views", "nothing"),
    ]  # fmt: skip


def test_shares_have_exact_intervals():
    """No event in 59: the upper end of the two-sided 95 % interval is 1 - 0.025^(1/59) = 6.1 %."""
    assert share([False] * 59) == "0/59 = 0% [0%, 6%]"
    assert share([]) == "-"


def test_the_outcomes_of_three_hundred_scenes_are_a_small_file(tmp_path):
    found = write(tmp_path / "1009", "pair", [DRAG, WIND], [FIRST, LAST], "missing", "LinearDrag", "UniformForce")
    long = tuple(f"CameraRotation@{k}" for k in range(5))
    found = replace(found, classes=(long[:3], long[3:]), ranking=long, views="all views")
    text = written(record([found] * 300))
    assert len(text) < 200_000
    assert json.loads(text)["outcomes"][0]["covered"] == {n: int(covers) for n, covers in found.covered.items()}
    assert compact([Outcome(1, "null", 0.0, None, (), "nothing")]) == [
        {"seed": 1, "family": "null", "snr": 0.0, "views": None, "truth": [], "kind": "nothing"}
    ]
