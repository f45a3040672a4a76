"""Rows of results by round of Algorithm 1."""

from __future__ import annotations

from typing import Any

from pacnerf_lpo.evaluation.tables import markdown_table, remarks, result_phase, round_rows, view_rows
from pacnerf_lpo.report.html import found_values, parameter_table


def phase(role: str, number: int, psnr: float, young: float, **more: Any) -> dict[str, Any]:
    metrics = {"psnr": psnr, "ssim": 0.9, "lpips": 0.1}
    return {
        "stem": f"r{number}_{role}",
        "label": f"{role}, round {number}",
        "round": number,
        "phase": role,
        "parameters": {"E": {"value": young, "unit": "Pa", "label": "Young's modulus"}},
        "truth_errors": {"E": {"error": 0.01 * psnr, "true": 1e6, "measure": "log10"}},
        "image_metrics": {"train": metrics, "test": {**metrics, "psnr": psnr - 1}},
    } | more


def results(errors: tuple[float | None, ...], chosen: int | None) -> dict[str, Any]:
    phases = []
    for number, error in enumerate(errors, start=1):
        more = {} if error is None else {"held_out_error": error}
        phases += [
            phase("physics", number, 20.0, 1e5),
            phase("correction", number, 20.0 + number, 1e5 * number, **more),
        ]
        phases.append(phase("refit", number, 10.0, 1e5 * number))
    last = chosen or len(errors)
    guess = {"E": {"value": 1e4, "unit": "Pa"}}
    result, density = f"r{last}_correction", {"density_kg_m3": 1050.0, "ground": "Sticky", "effects": ["LinearDrag"]}
    return {"phases": phases, "free": ["E"], "guess": guess, "chosen_round": chosen, "result": result, **density}


def test_every_round_shows_what_its_correction_gave():
    rows = round_rows(results((None, None), None))
    assert rows == [
        ["round", "PSNR, training views [dB]", "PSNR, test views [dB]", "E [Pa]"],
        ["1", "21.00", "20.00", "1e+05 (0.210 in log10)"],
        ["2", "22.00", "21.00", "2e+05 (0.220 in log10)"],
    ]
    assert round_rows(results((None,), None)) == []


def test_a_run_without_an_identification_says_that_its_values_are_not_identified():
    static = {**results((None,), None), "phases": [phase("static", 0, 20.0, 1e4)], "result": "r0_static"}
    known, law = {**results((None,), None), "free": []}, {**static, "phases": [phase("law", 0, 20.0, 1e4)]}
    for found in (static, known):
        assert "| parameter | guess | value (physics not identified) | true |" in markdown_table(found)
        assert found_values(found) == []
    for found in (results((None,), None), {**law, "result": "r0_law"}):
        assert "| parameter | guess | identified | true |" in markdown_table(found)
        assert [name for name, _, _ in found_values(found)] == ["E"]
    page = parameter_table({**static, "phases": [{**phase("static", 0, 20.0, 1e4), "velocity": [0.0, 0.0, 0.0]}]})
    assert "<th>value (physics not identified)</th>" in page


def test_remarks_say_what_the_values_hold_for_and_what_else_was_found():
    methods = {"particles": 1500, "images": {"E": 9.8e4}, "outlines": {"E": 1.04e5}}
    last = phase("physics", 1, 20.0, 1e5, before={"E": 9e4}, methods=methods)
    own = {"value": 1.1e5, "low": 1e5, "high": 1.2e5, "determined": True}
    fit = {"phase": "r1_physics", "level": 0.9, "parameters": {"E": own}}
    found = {**results((None,), None), "phases": [last], "result": "r1_physics", "intervals": fit}
    density, before, acting, against = remarks(found)
    assert "for a density of 1050 kg/m³" in density
    assert before.startswith("Values and intervals are") and before.endswith("Before it the phase had E = 90 kPa.")
    later = {**found, "phases": [last, phase("physics", 2, 20.0, 1.15e5)], "result": "r2_physics"}
    assert "It has E = 110 kPa. Before it the phase had E = 90 kPa." in remarks(later)[1]
    assert found_values(found) == [("E", "100 kPa", "90 %: 100 kPa to 120 kPa")]
    own |= {"determined": False, "with_solver": [8e4, 1.4e5]}
    assert found_values(found) == [("E", "?", "90 %: 80 kPa to 140 kPa")]
    assert "E = 98 kPa by images alone, E = 104 kPa by outlines alone" in against
    assert "a ground of the kind Sticky, and as effects: LinearDrag." in acting
    assert all(sentence in markdown_table(found) for sentence in remarks(found))
    assert "| parameter | guess |" in markdown_table(found)
    assert "| parameter | law comparison |" in markdown_table({**found, "laws": {"laws": []}})


def test_the_chosen_round_is_marked_and_is_the_result():
    found = results((3.0, 2.0, 2.5), 2)
    assert [row[0] for row in round_rows(found)] == ["round", "1", "2 (chosen)", "3"]
    assert [row[-1] for row in round_rows(found)] == ["held-out error", "3", "2", "2.5"]
    assert result_phase(found)["parameters"]["E"]["value"] == 2e5
    table = markdown_table(found)
    assert "| E | 1e+04 Pa | 2e+05 Pa |" in table and "| 3 | 23.00 | 22.00 |" in table


def test_a_view_that_is_trained_on_and_tested_has_one_row():
    """As of the baseline with all views: rows are those of the video, which has each view once."""
    views = {"train": [0, 4, 8], "test": [2, 4, 7]}
    order, train, test = view_rows({"views": views})
    assert order == [0, 2, 4, 7, 8]
    assert [order[row] for row in train] == views["train"] and [order[row] for row in test] == views["test"]
